"""What stands between the true distance and the number a laser prints. The order of the effects matters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.smoke import Haze
from slam.se2 import Array


@dataclass(frozen=True)
class Effects:
    """What a scan suffers, each effect with a switch of its own."""

    tilt: bool = True
    """The scan plane leans with the robot."""
    floor: bool = True
    """Floor and ceiling are seen."""
    heights: bool = True
    """Solids have a bottom and a top: beams pass under or over them or land on them."""
    mixed_pixels: bool = True
    """A beam has a width, and may report a range between two surfaces."""
    sub_rays: int = 3
    """Rays that a beam is made of."""
    divergence: float = np.deg2rad(0.35)
    """Angle [rad] over which they are spread."""
    mixed_gap: float = 0.2
    """Difference [m] of their ranges from which a pixel may be mixed."""
    mixed_probability: float = 0.3
    """Probability that it then is a random mixture, else the nearest."""
    smoke: bool = True
    """Smoke scatters beams and weakens echoes."""
    smoke_return: float = 0.5
    """Probability that a scattered beam reports where that happened, else nothing."""
    smoke_threshold: float = 0.02
    """Weakest echo, exp(-2 · depth) · cos(incidence) · (range limit / range)², of a surface behind smoke."""
    dropouts: bool = True
    """Beams are lost at grazing incidence."""
    dropout_floor: float = 0.002
    """Probability of that at normal incidence."""
    dropout_angle: float = np.deg2rad(80.0)
    """Incidence [rad] at which half the beams are lost: the middle of a logistic."""
    dropout_width: float = np.deg2rad(3.0)
    """Width [rad] of the logistic."""
    noise: bool = True
    """Ranges have normal errors."""
    noise_constant: float = 0.01
    """Standard deviation [m] at range 0."""
    noise_slope: float = 0.001
    """What the standard deviation grows by [m/m]."""
    quantisation: bool = True
    """Ranges are rounded."""
    quantum: float = 0.01
    """To multiples of this [m]."""
    limits: bool = True
    """Ranges outside of the laser's are not reported."""

    @property
    def sigma(self) -> float:
        """Standard deviation [m] of a close range, at least a millimetre: what a data sheet would say."""
        noise = self.noise_constant if self.noise else 0.0
        rounding = self.quantum / np.sqrt(12.0) if self.quantisation else 0.0
        return max(float(np.hypot(noise, rounding)), 1e-3)

    def footprint(self, angles: Array) -> Array:
        """Angles ``(B, J)`` rad of the sub-rays of beams at ``angles (B,)``; J is 1 without mixed pixels."""
        if not self.mixed_pixels:
            return angles[:, None]
        return angles[:, None] + np.linspace(-0.5, 0.5, self.sub_rays) * self.divergence


def corrupt(
    ranges: Array,
    cosines: Array,
    effects: Effects,
    limits: tuple[float, float],
    rng: np.random.Generator,
    haze: Haze | None = None,
) -> Array:
    """Reported ranges ``(N, B)`` m from the sub-rays' true ranges and incidence cosines ``(N, B, J)``.

    ``limits`` are the smallest and largest range m the laser reports, ``haze`` the smoke in the way of the
    beams, if any. Each effect draws from its own stream: switching one leaves the others' draws alone.
    """
    mixing, dropping, noising, smoking = rng.spawn(4)
    nearest = np.argmin(np.where(np.isnan(ranges), np.inf, ranges), axis=2)[..., None]
    cosine = np.take_along_axis(cosines, nearest, axis=2)[..., 0]
    reported = _mixed(ranges, effects, mixing)
    if effects.smoke and haze is not None:
        reported = _smoked(reported, cosine, haze, effects, limits[1], smoking)
    if effects.dropouts:
        reported = np.where(dropping.random(reported.shape) < _dropout(cosine, effects), np.nan, reported)
    if effects.noise:
        sigma = effects.noise_constant + effects.noise_slope * reported
        reported = reported + sigma * noising.standard_normal(reported.shape)
    if effects.quantisation:
        reported = np.round(reported / effects.quantum) * effects.quantum
    if effects.limits:
        low, high = limits
        reported = np.where((reported >= low) & (reported < high), reported, np.nan)
    return reported


def _mixed(ranges: Array, effects: Effects, rng: np.random.Generator) -> Array:
    """One range per beam: the mean of its sub-rays where they agree, else a mixture or the nearest."""
    met = ~np.isnan(ranges)
    far = np.where(met, ranges, np.inf)
    near = far.min(axis=2)
    none, some = ~met.any(axis=2), ~met.all(axis=2)
    filled = np.where(met, ranges, 0.0)
    split = some | (filled.max(axis=2) - near > effects.mixed_gap)
    weights = rng.random(ranges.shape) * met
    total = np.where(none, 1.0, weights.sum(axis=2))
    mixture = (weights * filled).sum(axis=2) / total
    mixes = rng.random(split.shape) < effects.mixed_probability
    plain = filled.sum(axis=2) / np.maximum(met.sum(axis=2), 1)
    reported = np.where(split, np.where(mixes, mixture, near), plain)
    return np.where(none, np.nan, reported)


def _smoked(
    reported: Array,
    cosine: Array,
    haze: Haze,
    effects: Effects,
    range_max: float,
    rng: np.random.Generator,
) -> Array:
    """Ranges ``(N, B)`` behind smoke: scattered on the way, with or without return, or too faint."""
    aimed = np.where(np.isnan(reported), range_max, reported)
    scattered, depth = haze.scatter(aimed, rng.standard_exponential(aimed.shape))
    returned = np.where(rng.random(aimed.shape) < effects.smoke_return, scattered, np.nan)
    echo = np.exp(-2.0 * depth) * cosine * (range_max / np.maximum(aimed, 1e-9)) ** 2
    faint = (depth > 0.0) & (echo < effects.smoke_threshold)
    return np.where(np.isfinite(scattered), returned, np.where(faint, np.nan, reported))


def _dropout(cosine: Array, effects: Effects) -> Array:
    """Chance that a beam does not come back, by its incidence (0 rad = along the normal)."""
    incidence = np.arccos(np.clip(cosine, 0.0, 1.0))
    grazing = 1.0 / (1.0 + np.exp(-(incidence - effects.dropout_angle) / effects.dropout_width))
    return effects.dropout_floor + (1.0 - effects.dropout_floor) * grazing
