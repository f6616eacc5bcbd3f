"""What the commands here share with those of the other packages."""

from slam.cli import POSE, BadInput, Pose, main, nearest, parse

__all__ = ["POSE", "BadInput", "Pose", "main", "nearest", "parse"]
