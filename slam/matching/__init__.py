"""Scan matching: the Weighted Scan Matcher, its point-to-line form, ICP, and whatever is registered."""

from slam.matching.config import RAW_WSM, MatchConfig
from slam.matching.match import MATCHERS, Bias, match
from slam.matching.reference import LocalMap, Reference
from slam.matching.result import Match, NoMatch

__all__ = ["MATCHERS", "RAW_WSM", "Bias", "LocalMap", "Match", "MatchConfig", "NoMatch", "Reference", "match"]
