"""Whether a sweep can be what was asked for, before anything is done."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

from slam.cli import InputError


def check(scheduler: str | None, workers: int, out: Path) -> None:
    """The options that every study shares. Raises `InputError`."""
    if workers < 0:
        raise InputError(f"expected --workers >= 0, got {workers}")
    if scheduler is not None:
        if workers:
            raise InputError("--workers is for this machine alone: expected either it or --scheduler")
        if not _is_address(scheduler):
            raise InputError(f"--scheduler {scheduler!r}: expected an address like tcp://host:8786")
    if out.is_file():
        raise InputError(f"--out {out}: expected a folder, found a file")


def _is_address(text: str) -> bool:
    try:
        parts = urlsplit(text)
        return parts.scheme in ("tcp", "tls", "ws", "wss", "ucx") and bool(parts.hostname and parts.port)
    except ValueError:
        return False
