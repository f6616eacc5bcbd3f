"""Two submaps whose relative pose is unknown, or only guessed: how do they fit together?"""

from __future__ import annotations

from slam.submap import Submap
from stitch.config import AlignConfig
from stitch.htms import align_htms
from stitch.joint import align_joint
from stitch.result import Alternative, NoStitch, Prior, Stitch

__all__ = ["AlignConfig", "Alternative", "NoStitch", "Prior", "Stitch", "align"]

DEFAULT = AlignConfig()


def align(
    a: Submap, b: Submap, prior: Prior | None = None, config: AlignConfig = DEFAULT
) -> Stitch | NoStitch:
    """Submap b in the frame of submap a, or why there is no answer.

    With ``config.method = "joint"`` rotations come from Hough spectra (Carpin 2008) or from around the prior,
    translations from a joint correlation that penalises walls in free space, and an answer is only given when
    it stands the tests of `stitch.verification.Acceptance`. ``"htms"`` is the report's method (Formsma): it
    always answers when both maps have walls, reads of the prior only its rotation, and has no covariance.
    """
    return align_htms(a, b, prior, config) if config.method == "htms" else align_joint(a, b, prior, config)
