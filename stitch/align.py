"""Two submaps whose relative pose is unknown, or only guessed: how do they fit together?"""

from __future__ import annotations

from pkgutil import resolve_name

from slam.mapping.submap import Submap
from stitch.alignment.config import METHODS, AlignConfig
from stitch.alignment.result import Alternative, NoStitch, Prior, Stitch

__all__ = ["METHODS", "AlignConfig", "Alternative", "NoStitch", "Prior", "Stitch", "align"]

DEFAULT = AlignConfig()


def align(
    a: Submap, b: Submap, prior: Prior | None = None, config: AlignConfig = DEFAULT
) -> Stitch | NoStitch:
    """Submap b in the frame of submap a, or why there is no answer.

    ``config.method`` is one of `METHODS`. With "joint" rotations come from Hough spectra (Carpin 2008) or
    from around the prior, translations from a joint correlation that penalises walls in free space, and an
    answer is only given when it passes `stitch.alignment.config.Acceptance`; where it does not and
    ``config.tolerant.enabled``, the maps are taken for bent ones (`stitch.alignment.tolerant`). The others
    are the methods of the literature, which have no covariance; each tells when it refuses. All are
    deterministic.
    """
    for name, submap in (("a", a), ("b", b)):
        if not submap.grid.occupied.any():
            return NoStitch(f"submap {name} has no occupied cells")
    method = METHODS[config.method]
    aligner = resolve_name(method) if isinstance(method, str) else method
    tolerant = config.tolerant.enabled and config.method == "joint"
    if tolerant and config.tolerant.free_scale:
        result: Stitch | NoStitch = NoStitch("the scale is free")
    else:
        result = aligner(a, b, prior, config)
    if isinstance(result, NoStitch) and tolerant:
        from stitch.alignment.tolerant import align_tolerant

        return align_tolerant(a, b, prior, config, result)
    return result
