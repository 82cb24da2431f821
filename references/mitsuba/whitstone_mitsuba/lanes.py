"""Counters, sums and lists of lanes of the driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .runtime import mi


def branch_name(letter: str, spread: int, number: int) -> str:
    """The name of a branch in the paths of `tree`; one of several has a two-digit number."""
    return f"{letter}{number:02}" if spread > 1 else letter


def mix(h: Any) -> Any:
    """A 32-bit integer hash (lowbias32, C. Wellons 2018)."""
    h = h ^ (h >> 16)
    h = h * 0x7FEB352D
    h = h ^ (h >> 15)
    h = h * 0x846CA68B
    return h ^ (h >> 16)


def pad(indices: np.ndarray) -> "mi.UInt32":
    """An index list for Dr.Jit. A single index is repeated (writing the same value twice changes
    nothing).
    """
    if len(indices) == 1:
        indices = np.repeat(indices, 2)
    return mi.UInt32(np.ascontiguousarray(indices, dtype=np.uint32))


@dataclass
class Sums:
    """Over the samples of pixels: the sum, and the smallest and largest value of each channel, all
    (n, 3).
    """

    total: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def ranges(self) -> np.ndarray:
        """(n,): the largest range of any channel."""
        return (self.most.astype(np.float64) - self.least).max(axis=1)

    def of(self, which: np.ndarray) -> "Sums":
        """The sums of some of the pixels."""
        return Sums(self.total[which], self.least[which], self.most[which])

    def with_(self, more: "Sums") -> "Sums":
        """Merges both; the sum in `more` already includes this one."""
        return Sums(more.total, np.minimum(self.least, more.least), np.maximum(self.most, more.most))


class TooDeep(Exception):
    """The levels of these rays do not fit into memory together."""


@dataclass
class Counts:
    """Numbers of rays traced, of rays that were spawned again because of a re-hit, and of rays that
    still re-hit.
    """

    closest: int = 0
    shadow: int = 0
    respawned: int = 0
    rehits: int = 0

    def add(self, other: "Counts") -> None:
        """Adds the numbers of another image."""
        self.closest += other.closest
        self.shadow += other.shadow
        self.respawned += other.respawned
        self.rehits += other.rehits
