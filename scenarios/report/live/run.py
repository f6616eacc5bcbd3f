"""Everything the live map is told about a run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from scenarios.report.live.drive import drive
from scenarios.report.live.method import method
from scenarios.report.live.shown import Shown
from scenarios.report.live.stitches import stitches
from scenarios.report.live.surroundings import surroundings
from scenarios.report.verdict import colours
from slam.recording import Recording
from stitch.alignment.config import AlignConfig
from stitch.mapping.estimate import Estimate

if TYPE_CHECKING:
    from sim.record import SimulatedRun


def told(
    recording: Recording, estimates: Sequence[Estimate], best: str | None, simulated: SimulatedRun | None
) -> dict[str, object]:
    """The run as plain JSON; ``best`` is the method that is shown first."""
    shown, config = Shown.of(recording), AlignConfig()
    return {
        "drive": drive(shown, simulated),
        "world": surroundings(simulated),
        "methods": [
            {
                **method(shown, estimate),
                "colour": colour,
                "stitches": stitches(estimate, recording.truth, config),
            }
            for estimate, colour in zip(estimates, colours([e.method for e in estimates]), strict=True)
        ],
        "best": best,
    }


def script_safe(content: object) -> str:
    """JSON that cannot end the script element it stands in, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
