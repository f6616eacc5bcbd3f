"""Keyframes as they come: which earlier ones each is matched to, and what these matches say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam import se2
from slam.matching import Reference
from slam.se2 import Array
from stitch.mapping.bundle import BundleConfig, choose_neighbours, discount_tilted
from stitch.mapping.config import OnlineConfig


@dataclass(frozen=True)
class KeyframeMatches:
    """Matches of one scan to those of ``partners (P,)``: ``T_ij (P, 3)`` seen from each, ``information (P, 3,
    3)`` in the body of the scan."""

    partners: np.ndarray
    T_ij: Array
    information: Array


def partners(poses: Array, j: int, allowed: np.ndarray, config: BundleConfig) -> np.ndarray:
    """Earlier ones of ``poses (K, 3)`` to match scan j to: near it and from as many passes as there are,
    among those that ``allowed (K,)`` bool marks."""
    apart = np.linalg.norm(poses[:j, :2] - poses[j, :2], axis=1)
    return choose_neighbours(poses, j, np.flatnonzero((apart <= config.reach) & allowed[:j]), config)


def match_pairs(
    references: Sequence[Reference],
    scan: Reference,
    guesses: Array,
    numbers: np.ndarray,
    config: BundleConfig,
    online: OnlineConfig = OnlineConfig(),
) -> KeyframeMatches:
    """The scan matched to each of P references from ``guesses (P, 3)`` of it seen from them.

    ``numbers (P,)`` are what the references are called in the answer, which leaves out those that see too
    little of the scan.
    """
    from slam.matching.kernels import linearise_pairs

    clouds, lattices = zip(*(r.indexed for r in (*references, scan)), strict=True)
    cell, heads, following = zip(*lattices, strict=True)
    cloud = tuple(np.concatenate(parts) for parts in zip(*clouds, strict=True))
    offsets = np.concatenate([[0], np.cumsum([len(c[0]) for c in clouds])]).astype(np.int64)
    lattice = cell[0], np.stack(heads), np.concatenate(following)
    count = len(references)
    pairs = np.stack([np.arange(count), np.full(count, count)], axis=1)
    T_ij = guesses
    for radius in online.radii:
        T_ij, information, used, misfit = linearise_pairs(
            cloud, offsets, lattice, pairs, T_ij, radius, config.robust, config.fade, config.length,
            config.same_side, config.freeze_ratio,
        )  # fmt: skip
    left = np.abs(se2.between(guesses, T_ij))
    known = (used >= config.least_pairs) & (np.hypot(left[:, 0], left[:, 1]) <= online.max_shift)
    known &= left[:, 2] <= online.max_turn
    divisor = config.match_inflation * discount_tilted(misfit[known], config)
    in_body = se2.to_body_covariance(T_ij[known], information[known]) / divisor[:, None, None]
    return KeyframeMatches(numbers[known], T_ij[known], in_body)
