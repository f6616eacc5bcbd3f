"""Two submaps whose relative pose is unknown, or only guessed: how do they fit together?"""

from __future__ import annotations

from slam.mapping.submap import Submap
from stitch.alignment.config import METHODS, AlignConfig
from stitch.alignment.joint import align_joint
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch
from stitch.published.features import align_features
from stitch.published.spectra import align_carpin, align_censi, align_htms

__all__ = ["METHODS", "AlignConfig", "Alternative", "NoStitch", "Prior", "Stitch", "align"]

METHODS.update(joint=align_joint, htms=align_htms, carpin=align_carpin, censi=align_censi)
METHODS.update(akaze=align_features, orb=align_features)

DEFAULT = AlignConfig()


def align(
    a: Submap, b: Submap, prior: Prior | None = None, config: AlignConfig = DEFAULT
) -> Stitch | NoStitch:
    """Submap b in the frame of submap a, or why there is no answer.

    ``config.method`` is one of `METHODS`. With "joint" rotations come from Hough spectra (Carpin 2008) or
    from around the prior, translations from a joint correlation that penalises walls in free space, and an
    answer is only given when it passes `stitch.alignment.config.Acceptance`. The others are the methods of
    the literature; each tells when it refuses. None of them has a covariance. All are
    deterministic.
    """
    for name, submap in (("a", a), ("b", b)):
        if not submap.grid.occupied.any():
            return NoStitch(f"submap {name} has no occupied cells")
    return METHODS[config.method](a, b, prior, config)
