"""Our matchers, and the default with one of its parts taken away at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenarios.bench.matching.scores import Matcher
from slam.matching import RAW_WSM, LocalMap, Match, MatchConfig, NoMatch, Reference, match
from slam.matching.config import CovarianceMode, Method
from slam.se2 import Array

DEFAULT = MatchConfig()


@dataclass(frozen=True)
class Variant:
    """One way to call `slam.matching.match`."""

    name: str
    method: Method = "plicp"
    covariance: CovarianceMode = "p2l"
    config: MatchConfig = DEFAULT

    @property
    def matcher(self) -> Matcher:
        """The variant as the scores take it."""
        return Matcher(lambda pair, which: pair.scans[which], Reference, self.match)

    def match(self, reference: Reference | LocalMap, scan: Reference, guess: Array) -> Match | NoMatch:
        """A match from a guess ``(3,)``."""
        return match(reference, scan, guess, self.method, self.covariance, config=self.config)


OURS = Variant("plicp")
"""The default, which the others are compared with."""

VARIANTS = (
    OURS,
    Variant("wsm", "wsm"),
    Variant("icp", "icp", "joint"),
    Variant("raw wsm", "wsm", "pfister_block", RAW_WSM),
)


def _without(name: str, **settings: object) -> Variant:
    return replace(OURS, name=f"− {name}", config=replace(OURS.config, **settings))  # type: ignore[arg-type]


ABLATION = (
    _without("coarse to fine", levels=((0.5, 1),)),
    _without("robust weights", robust=np.inf),
    _without("one-way pairs (mutual)", mutual=True),
    _without("oriented normals", oriented=False),
    _without("search where it fits badly", least_share=0.0, most_misfit=np.inf),
    _without("search along open directions", open_direction=-np.inf),
    _without("both searches", search_shift=0.0),
    _without("frozen directions", freeze_ratio=0.0),
    replace(OURS, name="− p2l (joint)", covariance="joint"),
    replace(OURS, name="− p2l (pfister_block)", covariance="pfister_block"),
)
"""The default without one of its parts, each."""
