"""Aligning two maps whose relative pose is unknown or only guessed. Imports only `slam`."""

from stitch.align import NoStitch, Prior, Stitch, align

__all__ = ["NoStitch", "Prior", "Stitch", "align"]
