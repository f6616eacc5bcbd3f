"""Who takes part: methods as they are, and ours with another back end or with false stitches injected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scenarios.methods.config import MethodConfig
from stitch.mapping.loop_closure import BackEnd

OURS = "slamstitch"
DEFAULT_BACK_END: BackEnd = "gnc"


@dataclass(frozen=True)
class Contestant:
    """A method under the ``name`` that tables call it by.

    ``back_end`` and the share of stitches ``injected`` are read by our method only; ``clean`` names the same
    contestant without injection, None where nothing is injected.
    """

    name: str
    method: str
    back_end: BackEnd = DEFAULT_BACK_END
    injected: float = 0.0
    clean: str | None = None

    def config(self, seed: int) -> MethodConfig:
        """The method's settings for a drive; ``seed`` draws what is injected."""
        default = MethodConfig()
        loops = replace(default.loops, back_end=self.back_end, injected=self.injected, injected_seed=seed)
        return replace(default, loops=loops) if self.method == OURS else default


def contestants(
    methods: Sequence[str], back_ends: Sequence[BackEnd], injected: float
) -> tuple[Contestant, ...]:
    """Every method; ours with each back end, and again with a share of ``injected`` false stitches if any."""
    found = []
    for method in methods:
        if method != OURS:
            found.append(Contestant(method, method))
            continue
        for back_end in back_ends:
            name = OURS if back_end == DEFAULT_BACK_END else f"{OURS} {back_end}"
            found.append(Contestant(name, OURS, back_end))
            if injected > 0.0:
                found.append(Contestant(f"{name} +{injected:.0%}", OURS, back_end, injected, name))
    return tuple(found)
