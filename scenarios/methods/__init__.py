"""The methods that are compared: each turns a recording into an estimate. Only the oracle sees the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scenarios.methods.config import MethodConfig
    from slam.recording import Recording
    from stitch.mapping.estimate import Estimate, NoEstimate

    System = Callable[[Recording, MethodConfig], Estimate | NoEstimate]


@dataclass(frozen=True)
class Method:
    """A method of the comparison: called with a recording and a `MethodConfig` it answers with an `Estimate`,
    or a `NoEstimate` that says why it has none."""

    name: str
    """What it is called everywhere."""
    system: System | str
    """The function behind it, or "module:function", imported when it is called."""
    colour: int | None = None
    """Index of the colour that it keeps on every page; None: one of those for others."""
    needs_dead_reckoning: str = ""
    """Why it has no answer without dead reckoning; empty where it has one."""
    sees_truth: bool = False
    """Whether it is told the truth: then it runs only where it is named."""
    online: bool = False
    """Whether it answers scan by scan: then it runs only with ``--online``."""
    in_sequence: bool = False
    """Whether it aligns each submap to the map of all before it, in the frame of the first."""

    def __call__(self, recording: Recording, config: MethodConfig) -> Estimate | NoEstimate:
        """What the method says of a recording, or why it has nothing to say."""
        from stitch.mapping.estimate import NoEstimate, rejection_reason

        if recording.source == "none" and self.needs_dead_reckoning:
            return NoEstimate(self.name, self.needs_dead_reckoning)
        estimate = self._load()(recording, config)
        if isinstance(estimate, NoEstimate) or recording.source != "none":
            return estimate
        reason = rejection_reason(estimate, config.slam.rejection)
        return estimate if reason is None else NoEstimate(self.name, reason)

    def _load(self) -> System:
        if not isinstance(self.system, str):
            return self.system
        module, _, function = self.system.partition(":")
        system: System = getattr(import_module(module), function)
        return system


BASELINE = "ins"
"""The method that the others are compared with: dead reckoning."""
OURS = "slamstitch"
"""The method that this project is about."""
ONLINE = "slamstitch_online"
"""The same, scan by scan."""

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(
            BASELINE,
            "scenarios.methods.baselines:ins",
            colour=1,
            needs_dead_reckoning="the recording has no dead reckoning",
        ),
        Method("icp", "scenarios.methods.baselines:icp", colour=4),
        Method(
            "wsm",
            "scenarios.methods.baselines:wsm",
            colour=2,
            needs_dead_reckoning="ManifoldSLAM starts every match at the dead-reckoned pose, and the "
            "recording has none",
        ),
        Method(
            "htms",
            "scenarios.methods.htms:stitch_in_sequence",
            colour=3,
            needs_dead_reckoning="it stitches ManifoldSLAM's map, which needs dead reckoning, and the "
            "recording has none",
            in_sequence=True,
        ),
        Method(OURS, "scenarios.methods.ours:offline", colour=0),
        Method(ONLINE, "scenarios.methods.ours:online", online=True),
        Method("oracle", "scenarios.methods.oracle:run", colour=5, sees_truth=True),
    )
}
"""Name → method; one entry is all that a new one takes."""

COMPARED: tuple[str, ...] = tuple(m.name for m in METHODS.values() if not (m.sees_truth or m.online))
"""Methods that know what a robot knows: those that run when nobody asks for others."""


def load_kernels(name: str, short: Recording, config: MethodConfig) -> None:
    """Load a method's kernels; a warm-up knows no truth, so a method that sees it is stood in for by ours."""
    METHODS[OURS if METHODS[name].sees_truth else name](short, config)
