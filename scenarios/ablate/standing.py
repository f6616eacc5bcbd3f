"""Rows of drives into medians, worst cases and paired comparisons, by scenario and method."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.ablate.contestants import OURS, Contestant
from scenarios.ablate.drives import LAST, Drive
from scenarios.evaluation.consistency import band

EVERYWHERE = "all"
"""The scenario of all scenarios together."""
BETTER_OF = ("ins", "wsm")
"""Never to be worse than the better of these is what a drive asks of us."""
ERROR = "ate_rmse"
RESAMPLES = 4000
"""Of the drives, drawn with replacement for an interval."""
NAN = float("nan")


@dataclass(frozen=True)
class Standing:
    """One contestant in one scenario: medians over ``drives``, and the worst, which is named.

    ``accepted`` and ``false`` stitches of all drives together, None where it does not stitch. ``anees`` is
    the mean over drives, each the average over its poses, / 3; ``anees_last`` that of the last poses, which
    are independent and of which 95 % lie within ``band`` if the covariances are honest. NaN where there is
    nothing.
    """

    scenario: str
    method: str
    drives: int
    failed: int
    ate_rmse: float
    worst_ate_rmse: float
    worst_ate_drive: str
    map_f1: float
    worst_map_f1: float
    worst_map_drive: str
    accepted: int | None
    false: int | None
    anees: float
    anees_last: float
    band: tuple[float, float]
    seconds: float


@dataclass(frozen=True)
class Comparison:
    """``method`` against ``against`` on the same drives: ratios of ``ate_rmse``, below 1 where it is better.

    The median ratio with its 95 % interval (bootstrap over the drives, NaN of a single one), the share of
    drives on which it is better, and the worst drive.
    """

    scenario: str
    method: str
    against: str
    drives: int
    ratio: float
    interval: tuple[float, float]
    better: float
    worst: float
    worst_drive: str


def grouped(rows: Sequence[Drive]) -> Iterator[tuple[str, list[Drive]]]:
    """The rows of each scenario, in their order, and of all together where there are several."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    for scenario in scenarios:
        yield scenario, [row for row in rows if row.scenario == scenario]
    if len(scenarios) > 1:
        yield EVERYWHERE, list(rows)


def standings(rows: Sequence[Drive]) -> list[Standing]:
    """A standing per scenario and method, and per method over all scenarios."""
    return [
        standing(scenario, method, [row for row in inside if row.method == method])
        for scenario, inside in grouped(rows)
        for method in dict.fromkeys(row.method for row in inside)
    ]


def standing(scenario: str, method: str, rows: Sequence[Drive]) -> Standing:
    """What one contestant did on some drives."""
    done = [row for row in rows if not row.error]
    worst_ate = _worst(done, ERROR, 1.0)
    worst_map = _worst(done, "map_f1", -1.0)
    last = _finite(done, LAST)
    return Standing(
        scenario=scenario,
        method=method,
        drives=len(done),
        failed=len(rows) - len(done),
        ate_rmse=_median(_finite(done, ERROR)),
        worst_ate_rmse=NAN if worst_ate is None else worst_ate.value(ERROR),
        worst_ate_drive="" if worst_ate is None else worst_ate.name,
        map_f1=_median(_finite(done, "map_f1")),
        worst_map_f1=NAN if worst_map is None else worst_map.value("map_f1"),
        worst_map_drive="" if worst_map is None else worst_map.name,
        accepted=_total(done, "stitches_accepted"),
        false=_total(done, "stitches_false"),
        anees=_mean(_finite(done, "anees")),
        anees_last=_mean(last) / 3.0,
        band=band(len(last)) if len(last) else (NAN, NAN),
        seconds=_median(np.array([row.seconds for row in done])),
    )


def comparisons(
    rows: Sequence[Drive], contestants: Sequence[Contestant], rng: np.random.Generator
) -> list[Comparison]:
    """Our first contestant against all others and the better of ins and wsm, and every contestant with false
    stitches against itself without; by scenario, and over all. ``rng`` draws the bootstrap."""
    found = []
    for scenario, inside in grouped(rows):
        errors = {one.name: _errors(inside, one.name) for one in contestants}
        for method, against in _couples(contestants):
            other = _least(errors) if against == _better_of() else errors[against]
            if both := compared(errors[method], other, rng):
                found.append(Comparison(scenario, method, against, *both))
    return found


def _couples(contestants: Sequence[Contestant]) -> Iterator[tuple[str, str]]:
    """Names of who is compared with whom."""
    names = [one.name for one in contestants]
    ours = next((one.name for one in contestants if one.method == OURS), None)
    if ours is not None:
        yield from ((ours, one.name) for one in contestants if one.clean is None and one.name != ours)
        if set(BETTER_OF) <= set(names):
            yield ours, _better_of()
    yield from ((one.name, one.clean) for one in contestants if one.clean is not None)


def _better_of() -> str:
    return f"better of {' and '.join(BETTER_OF)}"


Errors = Mapping[tuple[str, int], float]
"""``ate_rmse`` by drive, its scenario and seed."""


def _errors(rows: Sequence[Drive], method: str) -> Errors:
    own = (row for row in rows if row.method == method and np.isfinite(row.value(ERROR)))
    return {(row.scenario, row.seed): row.value(ERROR) for row in own}


def _least(errors: Mapping[str, Errors]) -> Errors:
    """On every drive that all of `BETTER_OF` finished, the least of their errors."""
    first, *others = (errors[name] for name in BETTER_OF)
    shared = [drive for drive in first if all(drive in other for other in others)]
    return {drive: min(first[drive], *(other[drive] for other in others)) for drive in shared}


def compared(
    own: Errors, other: Errors, rng: np.random.Generator
) -> tuple[int, float, tuple[float, float], float, float, str] | None:
    """Number of drives both finished, median ratio, its interval, share better, worst ratio and its drive;
    None without such a drive."""
    shared = [drive for drive in own if drive in other]
    if not shared:
        return None
    ratios = np.array([own[drive] / other[drive] for drive in shared])
    scenario, seed = shared[int(np.argmax(ratios))]
    return (
        len(ratios),
        float(np.median(ratios)),
        interval(ratios, rng),
        float(np.mean(ratios < 1.0)),
        float(ratios.max()),
        f"{scenario} {seed}",
    )


def interval(ratios: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % interval of the median of ``ratios (n,)``: percentiles of its bootstrap (Efron 1979)."""
    if len(ratios) < 2:
        return NAN, NAN
    drawn = rng.integers(len(ratios), size=(RESAMPLES, len(ratios)))
    low, high = np.quantile(np.median(ratios[drawn], axis=1), [0.025, 0.975])
    return float(low), float(high)


def _finite(rows: Sequence[Drive], name: str) -> np.ndarray:
    values = np.array([row.value(name) for row in rows])
    return values[np.isfinite(values)]


def _worst(rows: Sequence[Drive], name: str, sign: float) -> Drive | None:
    known = [row for row in rows if np.isfinite(row.value(name))]
    return max(known, key=lambda row: sign * row.value(name), default=None)


def _total(rows: Sequence[Drive], name: str) -> int | None:
    values = _finite(rows, name)
    return int(values.sum()) if len(values) else None


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else NAN


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else NAN
