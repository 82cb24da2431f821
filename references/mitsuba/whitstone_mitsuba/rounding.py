"""Conversion of mesh data from float64 to float32: to the nearest or, to measure the effect of this
rounding, stochastically (setting `vertices`).
"""

from __future__ import annotations

from typing import Callable, Optional

import numpy as np

# Converts float64 numbers to float32.
Rounding = Callable[[np.ndarray], np.ndarray]


def nearest(values: np.ndarray) -> np.ndarray:
    """Rounds to the nearest, as every float32 program does."""
    return np.asarray(values, dtype=np.float64).astype(np.float32)


def by_hash(seed: int) -> Rounding:
    """Rounds down or up by a hash of seed and number, with the probabilities of stochastic
    rounding.

    Equal numbers give equal results, so that vertices at one position stay together and no gap
    opens between triangles. Numbers that are exact in float32 do not change.
    """

    def rounded(values: np.ndarray) -> np.ndarray:
        exact = np.ascontiguousarray(values, dtype=np.float64)
        near = exact.astype(np.float32)
        side = np.where(exact > near, np.float32(np.inf), np.float32(-np.inf))
        other = np.nextafter(near, side)
        bits = _mix(exact.view(np.uint64) ^ _mix(np.array([seed + 1], dtype=np.uint64)))
        chance = (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53
        # Compared without a quotient, because the gap underflows where the numbers do.
        return np.where(np.abs(exact - near) > chance * np.abs(other.astype(np.float64) - near), other, near)

    return rounded


def of(seed: Optional[int]) -> Rounding:
    """The rounding for a seed; to the nearest if it is None."""
    return nearest if seed is None else by_hash(seed)


def _mix(h: np.ndarray) -> np.ndarray:
    """A 64-bit integer hash (the finaliser of splitmix64, S. Vigna 2015)."""
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))
