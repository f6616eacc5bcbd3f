"""Every setting of an alignment changes an answer, and numbers without sense are refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from slam import se2
from slam.mapping.submap import Submap
from slam.matching import MatchConfig
from stitch.align import METHODS, AlignConfig, NoStitch, Prior, Stitch, align
from stitch.alignment.config import Acceptance, DirectionConfig, RotationConfig, TolerantConfig
from stitch.alignment.tolerant import scaled
from stitch.alignment.walls import SurfaceConfig, surfaces

Maps = tuple[Submap, Submap, Prior | None]
MANY_DIRECTIONS = {"directions": DirectionConfig(min_strength=0.0, min_background_ratio=0.0)}
BENT = {
    "acceptance": Acceptance(min_belief=1e4),
    "tolerant": TolerantConfig(enabled=True, candidates=4, min_margin=1.0),
}
"""Joint refuses, and then the maps are taken for bent ones."""
FREE = {
    "tolerant": TolerantConfig(
        enabled=True, free_scale=True, candidates=1, min_margin=1.0, scale_step=0.2, max_ambiguity=1.0
    )
}


def changes(value: object, maps: str = "near", **base: Any) -> tuple[object, str, dict[str, Any], str]:
    """A value with which the maps are still stitched, but not as before; ``base``: what else is set."""
    return value, maps, base, ""


def refuses(value: object, reason: str, maps: str = "near", **base: Any) -> tuple[Any, ...]:
    """A value of a limit that the maps break: refused, and by that limit."""
    return value, maps, base, reason


CASES = {
    "method": changes("censi"),
    "resolution": changes(0.2),
    "walls.furniture_weight": changes(0.5),
    "walls.furniture_length": changes((2.4, 3.6)),
    "walls.run_directions": changes(8),
    "directions.min_crest": changes(1e3),
    "directions.min_variation": changes(1e3),
    "directions.separation": changes(0.9, method="carpin"),
    "directions.min_strength": refuses(0.9, "one direction", method="censi"),
    "directions.min_background_ratio": changes(2.0, "most", method="censi", **MANY_DIRECTIONS),
    "rotation.n_theta": changes(180),
    "rotation.n_peaks": changes(1),
    "rotation.min_peaks": changes(1, rotation=RotationConfig(min_peak_ratio=1.0)),
    "rotation.min_peak_ratio": changes(1.0, rotation=RotationConfig(min_peaks=1, min_peak_ratio=0.5)),
    "rotation.smoothing": changes(0.0),
    "rotation.sweep_step": changes(0.07, "stones"),
    "rotation.sweep_limit": changes(0.0, "stones"),
    "search.resolution": changes(0.4),
    "search.free_penalty": changes(20.0),
    "search.lenient_penalty": changes(6.0),
    "search.blur": changes(0.5),
    "search.facing_share": changes(0.25),
    "search.shifts_per_rotation": changes(1),
    "search.separation": changes((1.0, 0.2)),
    "search.candidates": changes(4),
    "prior.weight": changes(10.0, "guessed"),
    "prior.sigmas": changes(1.5, "guessed"),
    "prior.margin": changes((1.0, 0.07), "guessed"),
    "prior.confidence": refuses(1e-3, "distance from the prior", "guessed"),
    "climb.coarse_step": changes((0.2, 0.03)),
    "climb.fine_step": changes((0.05, 0.01)),
    "climb.halvings": changes(2),
    "climb.max_steps": changes(1),
    "climb.stride": changes(1),
    "climb.finalists": changes(3),
    "refinement.enabled": changes(False),
    "refinement.method": changes("icp"),
    "refinement.points": changes(500),
    "refinement.max_correction": refuses((1e-6, 1e-6), "left the peak"),
    "refinement.matcher": changes(MatchConfig(levels=((0.1, 1),), search_shift=0.0)),
    "covariance.temperature": changes(500.0),
    "covariance.step": changes((0.1, 0.02)),
    "covariance.warp": changes((0.03, 0.01)),
    "acceptance.min_overlap": refuses(1e4, "overlap"),
    "acceptance.min_open": refuses(1e4, "space free in both"),
    "acceptance.min_lead": refuses(1e4, "lead over a rival"),
    "acceptance.max_ambiguity": refuses(-1.0, "of the log-odds, expected at most -1"),
    "acceptance.equal_walls": refuses(
        -1.0, "turned, it would fit as well", acceptance=Acceptance(equal_conflict=np.inf, equal_turn=0.0)
    ),
    "acceptance.equal_conflict": refuses(
        np.inf,
        "turned, it would fit as well",
        acceptance=Acceptance(equal_walls=-1.0, equal_conflict=-np.inf, equal_turn=0.0),
    ),
    "acceptance.equal_turn": refuses(
        0.0,
        "turned, it would fit as well",
        acceptance=Acceptance(equal_walls=-1.0, equal_conflict=np.inf, equal_turn=7.0),
    ),
    "acceptance.min_belief": refuses(1e4, "belief"),
    "acceptance.slide": changes(0.05),
    "acceptance.sliding": refuses(np.inf, "slides along its walls", acceptance=Acceptance(min_belief=1e4)),
    "acceptance.close_lead": refuses(np.inf, "a rival has", acceptance=Acceptance(min_belief=1e4)),
    "tolerant.enabled": refuses(False, "belief", "most", **BENT),
    "tolerant.free_scale": refuses(True, "scale", "most", **BENT),
    "tolerant.scale_step": changes(0.1, "enlarged", **FREE),
    "tolerant.scale_rounds": changes(1, "enlarged", tolerant=replace(FREE["tolerant"], bend_steps=1)),
    "tolerant.max_scale": changes(0.3, "enlarged", **FREE),
    "tolerant.unknown_weight": changes(0.6, "most", **BENT),
    "tolerant.width": changes(0.5, "most", **BENT),
    "tolerant.conflict": changes(2.0, "most", **BENT),
    "tolerant.min_rotation": changes(0.99, "most", **BENT),
    "tolerant.peaks": changes(1, "most", **BENT),
    "tolerant.separation": changes((4.0, 0.5), "most", **BENT),
    "tolerant.candidates": changes(2, "most", **BENT),
    "tolerant.settle_widths": changes((0.5, 0.2), "most", **BENT),
    "tolerant.settle_steps": changes(2, "most", **BENT),
    "tolerant.spacing": changes(6.0, "most", **BENT),
    "tolerant.spring": changes((0.1, 0.02), "most", **BENT),
    "tolerant.stiffness": changes(0.2, "most", **BENT),
    "tolerant.bend_widths": changes((1.0, 0.2), "most", **BENT),
    "tolerant.bend_steps": changes(4, "most", **BENT),
    "tolerant.judged_width": changes(0.2, "most", **BENT),
    "tolerant.judged_conflict": changes(2.0, "most", **BENT),
    "tolerant.rival": changes((4.0, 0.5), "most", **BENT),
    "tolerant.min_margin": refuses(1e4, "margin", "most", **BENT),
    "tolerant.max_ambiguity": refuses(-1.0, "ambiguity: a rival", "most", **BENT),
    "tolerant.min_jacobian": refuses(1.5, "the bend would fold", "most", **BENT),
    "tolerant.belief_scale": changes(1.0, "most", **BENT),
    "tolerant.alternatives": changes(1, "most", **BENT),
    "tolerant.piece": changes(2.0, "most", **BENT),
    "tolerant.related_pieces": changes(1.0, "most", **BENT),
    "tolerant.piece_sigma": changes(0.2, "most", **BENT),
    "tolerant.max_sigma": changes((0.1, 0.01), "most", **BENT),
    "carpin.n_theta": changes(180, method="carpin"),
    "carpin.n_peaks": changes(1, method="carpin"),
    "carpin.min_acceptance_index": refuses(1.0, "acceptance index", method="carpin"),
    "censi.n_theta": changes(180, method="censi"),
    "censi.n_peaks": changes(1, method="censi"),
    "censi.smoothing": changes(0.0, method="censi"),
    "censi.directions": changes(2, "most", method="censi", **MANY_DIRECTIONS),
    "censi.lags": changes(2, method="censi"),
    "censi.max_residual": changes(0.0, method="censi"),
    "features.margin": changes(4, "stones", method="akaze"),
    "features.orb_features": changes(750, "most", method="orb"),
    "features.ratio": changes(0.9, "most", method="akaze"),
    "features.max_matches": changes(20, "most", method="orb"),
    "features.proposers": changes(10, "most", method="orb"),
    "features.reach": changes(1.5, "most", method="akaze"),
    "features.min_arm": changes(100.0, "most", method="orb"),
    "features.min_confidence": refuses(10.0, "features agree, expected at least", "most", method="akaze"),
}
SURFACE_CASES = {"radius": 0.5, "radius_cells": (1.0, 2.0), "min_neighbours": 30, "max_scatter_ratio": 0.01}


def leaves(config: object, path: str = "") -> Iterator[str]:
    """Dotted names of all fields; the scan matcher's own have tests of their own."""
    for field in fields(config):  # type: ignore[arg-type]
        value = getattr(config, field.name)
        if is_dataclass(value) and not isinstance(value, MatchConfig):
            yield from leaves(value, f"{path}{field.name}.")
        else:
            yield path + field.name


def with_value(config: Any, name: str, value: object) -> Any:
    """The configuration with one field, given by its dotted name, changed."""
    head, _, rest = name.partition(".")
    return replace(config, **{head: with_value(getattr(config, head), rest, value) if rest else value})


@pytest.fixture(scope="module")
def situations(plan: dict[str, Callable[..., Any]]) -> dict[str, Maps]:
    """Maps to align, by name."""

    def guess(T: np.ndarray) -> Prior:
        return Prior(se2.compose(T, [0.3, -0.3, 0.05]), np.diag([0.5, 0.5, 0.1]) ** 2)

    a, b, T_near = plan["pair"](0, 8.0)
    most_a, most_b, _ = plan["pair"](5, 24.0)
    stones_a, stones_b, T_stones = plan["stones"]()
    return {
        "near": (a, b, None),
        "guessed": (a, b, guess(T_near)),
        "most": (most_a, most_b, None),
        "enlarged": (most_a, scaled(most_b, 1.1), None),
        "stones": (stones_a, stones_b, guess(T_stones)),
    }


def content(stitch: Stitch) -> str:
    return repr(
        {name: np.asarray(value).tolist() for name, value in vars(stitch).items() if name != "alternatives"}
    ) + repr(stitch.alternatives)


@pytest.mark.parametrize("name", list(leaves(AlignConfig())))
def test_every_setting_changes_an_answer(name: str, situations: dict[str, Maps]) -> None:
    """A new field fails here until it has a case."""
    value, maps, base, reason = CASES[name]
    a, b, prior = situations[maps]
    default = AlignConfig(**base)
    before, after = (align(a, b, prior, config) for config in (default, with_value(default, name, value)))
    if reason:
        assert isinstance(after, NoStitch)
        assert reason in after.reason
        assert not isinstance(before, NoStitch) or reason not in before.reason
    else:
        assert isinstance(before, Stitch), before
        assert isinstance(after, Stitch), after
        assert content(before) != content(after)


@pytest.mark.parametrize("name", list(leaves(SurfaceConfig())))
def test_every_setting_of_surfaces_changes_them(name: str, situations: dict[str, Maps]) -> None:
    grid = situations["near"][0].grid
    usual, changed = surfaces(grid), surfaces(grid, SurfaceConfig(**{name: SURFACE_CASES[name]}))
    assert len(usual) != len(changed) or not np.array_equal(usual.normals, changed.normals, equal_nan=True)


@pytest.mark.parametrize("config", [AlignConfig(), SurfaceConfig()])
def test_numbers_without_sense_are_refused_by_name(config: object) -> None:
    for name in leaves(config):
        usual = config
        for part in name.split("."):
            usual = getattr(usual, part)
        if isinstance(usual, (int, float, tuple)) and not isinstance(usual, bool):
            wrong = tuple(np.nan for _ in usual) if isinstance(usual, tuple) else np.nan
            with pytest.raises(ValueError, match=rf"{name.split('.')[-1]}: expected .*, got .*nan"):
                with_value(config, name, wrong)


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(ValueError, match=f"method: expected one of {', '.join(METHODS)}, got 'magic'"):
        AlignConfig(method="magic")
