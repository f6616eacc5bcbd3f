"""Scan matching: the Weighted Scan Matcher and the ICP baselines under one call."""

from slam.matching.match import Match, MatchConfig, NoMatch, Reference, match

__all__ = ["Match", "MatchConfig", "NoMatch", "Reference", "match"]
