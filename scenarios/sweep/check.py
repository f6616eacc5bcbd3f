"""Whether a sweep can be what was asked for, before anything is done."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlsplit

from scenarios.cli import BadInput


def check(scheduler: str | None, workers: int, out: Path) -> None:
    """The options that every study shares. Raises `BadInput`."""
    if workers < 0:
        raise BadInput(f"expected --workers >= 0, got {workers}")
    if scheduler is not None:
        if workers:
            raise BadInput("--workers is for this machine alone: expected either it or --scheduler")
        if not _is_address(scheduler):
            raise BadInput(f"--scheduler {scheduler!r}: expected an address like tcp://host:8786")
    if out.is_file():
        raise BadInput(f"--out {out}: expected a folder, found a file")


def _is_address(text: str) -> bool:
    try:
        parts = urlsplit(text)
        return parts.scheme in ("tcp", "tls", "ws", "wss", "ucx") and bool(parts.hostname and parts.port)
    except ValueError:
        return False
