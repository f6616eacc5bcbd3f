"""Which code a result was made with."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("scenarios", "sim", "slam", "stitch")
KINDS = (".py", ".npz", ".npy", ".yaml")
"""Code, and what was learnt or written down and is read by it."""
SHOWS_ONLY = (
    "scenarios/bench/",
    "scenarios/report/",
    "scenarios/run_folder/",
    "scenarios/export.py",
    "scenarios/gallery.py",
    "scenarios/run.py",
)
"""What no trial imports: it shows or exports results, and may change without making old ones stale."""


@cache
def code_version() -> str:
    """Version of the distribution and a hash of the code as this process found it first.

    The hash is over the source files themselves, so that it is the same in a checkout, in a wheel and on
    another machine, and another one as soon as a line is edited that a trial could run.
    """
    try:
        distribution = version("slamstitch")
    except PackageNotFoundError:
        distribution = "0"
    return f"{distribution}+{_hash(Path(__file__).resolve().parents[2])[:12]}"


def sources(root: Path) -> list[Path]:
    """The files that count, by name."""
    found = (path for name in PACKAGES for path in (root / name).rglob("*.*") if path.suffix in KINDS)
    names = (path.relative_to(root) for path in found)
    return sorted(name for name in names if not name.as_posix().startswith(SHOWS_ONLY))


def _hash(root: Path) -> str:
    digest = hashlib.sha256()
    for path in sources(root):
        content = (root / path).read_bytes()
        digest.update(f"{path.as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()
