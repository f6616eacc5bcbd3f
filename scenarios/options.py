"""Options that commands share: seeds, lists of names, and the option block of a study."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from scenarios.catalogue import CATALOGUE
from slam.cli import InputError, nearest

if TYPE_CHECKING:
    from scenarios.sweep import SweepResult, Trial

REPORTED = range(100)
"""Seeds that results are reported on: nothing is learnt from them."""


@dataclass(frozen=True)
class StudyOptions:
    """What every study over simulated drives can be told; each has defaults of its own."""

    scenarios: str = ""
    """Scenarios of the catalogue, with commas between."""
    seeds: str = ""
    """Seeds: first-last, or numbers with commas between."""
    workers: int = 0
    """Processes; 0 takes a process for each core. The results do not depend on it."""
    scheduler: Annotated[str | None, arg(metavar="tcp://HOST:PORT")] = None
    """A running Dask scheduler whose workers do the trials, instead of processes of this machine."""
    out: Annotated[Path, arg(aliases=["-o"])] = Path("runs/ablate")
    """A folder for sweep.sqlite, from which a sweep that was interrupted goes on."""
    fresh: bool = False
    """Forget the trials that the folder holds and run them again."""

    @property
    def store(self) -> Path:
        """The file that keeps the trials."""
        return self.out / "sweep.sqlite"

    def checked(self, count: bool = False) -> tuple[list[str], list[int]]:
        """Scenarios and seeds, a plain number being how many where ``count``. Raises `InputError` for these
        and for options of the sweep that cannot be used."""
        from scenarios.sweep import check

        scenarios, seeds = parse_names(self.scenarios, CATALOGUE, "scenario"), parse_seeds(self.seeds, count)
        check(self.scheduler, self.workers, self.out)
        return scenarios, seeds

    def checked_for_training(self) -> tuple[list[str], list[int]]:
        """The same, of seeds that may be learnt from. Raises `InputError`."""
        scenarios, seeds = self.checked()
        if min(seeds) in REPORTED:
            raise InputError(
                f"--seeds {self.seeds!r}: expected seeds from 100 on, the others are reported on"
            )
        return scenarios, seeds

    def sweep(self, trials: Iterable[Trial], evaluate: Callable[..., Any], **hooks: Any) -> SweepResult:
        """`scenarios.sweep.sweep` with these options; ``hooks`` are its ``prepare`` and ``each``."""
        from scenarios.sweep import sweep

        where: dict[str, Any] = {"scheduler": self.scheduler, "workers": self.workers, "fresh": self.fresh}
        return sweep(trials, evaluate, self.store, **where, **hooks)


def parse_names(text: str, known: Iterable[str], what: str, option: str = "") -> list[str]:
    """Names with commas between, each once, in their order. Raises `InputError` unless all are ``known``.

    ``what`` they are; the ``option`` is called that in the plural where nothing else is said.
    """
    known = list(known)
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names:
        if name not in known:
            raise InputError(f"unknown {what} {name!r}: {nearest(name, known)}")
    if not names:
        raise InputError(f"{option or f'--{what}s'}: expected one or more of {', '.join(known)}")
    return names


def parse_seeds(text: str, count: bool = False) -> list[int]:
    """Seeds of ``first-last`` or of numbers with commas between; a plain number is how many, from 0, where
    ``count`` says so. Raises `InputError`."""
    if count and text.strip().isdecimal():
        if int(text) < 1:
            raise InputError(f"--seeds {text!r}: expected at least one")
        return list(range(int(text)))
    try:
        numbers: Sequence[int]
        if "-" in text:
            first, last = (int(word) for word in text.split("-"))
            numbers = range(first, last + 1)
        else:
            numbers = [int(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or min(numbers) < 0:
        raise InputError(
            f"--seeds {text!r}: expected first-last or numbers with commas between, as 0-9 or 3,5"
        )
    return list(numbers)


def check_seed(seed: int) -> None:
    """Raises `InputError` for a ``--seed`` below 0."""
    if seed < 0:
        raise InputError(f"--seed: expected 0 or more, got {seed}")
