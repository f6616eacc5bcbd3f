"""Readers that do what a reader must not, for the fuzz bench to find."""

from __future__ import annotations

import os
import time
from pathlib import Path

from scenarios.bench.fuzzing.samples import Sample
from slam.cli import InputError

GOOD = b"1 2 3\n"


def damaged(path: Path) -> bool:
    return path.read_bytes() != GOOD


def refuse(path: Path) -> None:
    if damaged(path):
        raise InputError("no")


def fail(path: Path) -> None:
    if damaged(path):
        raise KeyError("nobody caught this")


def hang(path: Path) -> None:
    while damaged(path):
        time.sleep(0.1)


def swallow(path: Path) -> bytes:
    return bytes(10_000_000_000) if damaged(path) else b""


def crash(path: Path) -> None:
    if damaged(path):
        os.abort()


def make(folder: Path) -> dict[str, Sample]:
    readers = {"refused": refuse, "traceback": fail, "hang": hang, "memory": swallow, "crash": crash}
    return {name: Sample({"a.txt": GOOD}, "a.txt", read) for name, read in readers.items()}
