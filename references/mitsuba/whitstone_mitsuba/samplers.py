"""Samplers: sample positions in a pixel (model §5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, List, Optional

import numpy as np

from .fields import Fields, there_are

TYPES = ("adaptive", "center", "grid", "sobol", "stratified")


def _u(value: int) -> np.ndarray:
    """A number for arithmetic modulo 2^32. It is an array, because numpy warns of overflow in
    scalars only.
    """
    return np.array([[value]], dtype=np.uint32)


def _hash(h: np.ndarray) -> np.ndarray:
    """The hash m of the model's §9."""
    h = h ^ (h >> _u(16))
    h = h * _u(0x7FEB352D)
    h = h ^ (h >> _u(15))
    h = h * _u(0x846CA68B)
    return h ^ (h >> _u(16))


def _pixel(seed: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The index of a pixel, hashed with the seed."""
    return _hash(_hash(_hash(_u(seed)) + y.astype(np.uint32)) + x.astype(np.uint32))


def _fraction(bits: np.ndarray) -> np.ndarray:
    return bits.astype(np.float64) / 2.0**32


@dataclass(frozen=True)
class Fixed:
    """The same positions in every pixel: (count, 2)."""

    positions: np.ndarray

    @property
    def count(self) -> int:
        return len(self.positions)

    def at(self, x: np.ndarray, y: np.ndarray, index: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.positions[index], (len(x), index.shape[1], 2))


@dataclass(frozen=True)
class Stratified:
    """One random position in each cell of a grid."""

    n: int
    seed: int

    @property
    def count(self) -> int:
        return self.n**2

    def at(self, x: np.ndarray, y: np.ndarray, index: np.ndarray) -> np.ndarray:
        h = _hash(_pixel(self.seed, x, y) + index.astype(np.uint32))
        cell = np.stack([index % self.n, index // self.n], axis=-1)
        place = np.stack([_fraction(_hash(h + _u(k))) for k in (1, 2)], axis=-1)
        return (cell + place) / self.n


def _reverse(bits: np.ndarray) -> np.ndarray:
    """Reverses the 32 bits: swaps neighbours, then pairs, nibbles, bytes and halves."""
    for width, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        bits = (bits >> _u(width) & _u(mask)) | (bits & _u(mask)) << _u(width)
    return bits


def sobol(index: np.ndarray) -> List[np.ndarray]:
    """Both coordinates of Sobol' points as 32 bits, from the direction numbers."""
    first, second = np.zeros_like(index), np.zeros_like(index)
    one, two = 1 << 31, 1 << 31
    for k in range(32):
        taken = index >> _u(k) & _u(1) == 1
        first[taken] ^= np.uint32(one)
        second[taken] ^= np.uint32(two)
        one >>= 1
        two ^= two >> 1
    return [first, second]


def scramble(bits: np.ndarray, seed: np.ndarray) -> np.ndarray:
    """Burley 2020, listing 2: `nested_uniform_scramble_base2` with `laine_karras_permutation`."""
    x = _reverse(bits) + seed
    for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        x = x ^ (x * _u(factor))
    return _reverse(x)


@dataclass(frozen=True)
class Sobol:
    """Sobol' points with Owen scrambling."""

    samples: int
    seed: int

    @property
    def count(self) -> int:
        return self.samples

    def at(self, x: np.ndarray, y: np.ndarray, index: np.ndarray) -> np.ndarray:
        h = _pixel(self.seed, x, y)
        points = sobol(index.astype(np.uint32))
        return np.stack([_fraction(scramble(points[k], _hash(h + _u(k + 1)))) for k in (0, 1)], axis=-1)


@dataclass(frozen=True)
class Refinement:
    """The rule that decides which pixels take more samples."""

    first: int
    threshold: float

    def applies(self, taken: int, own: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Whether the error estimate is above the threshold. It uses the range of a pixel's
        samples, and that of its neighbours' first samples.
        """
        return np.maximum(0.3 * own / taken**0.75, 0.15 * near / taken) > self.threshold


@dataclass(frozen=True)
class Adaptive(Sobol):
    """Sobol' points with a number of samples that is adapted to each pixel."""

    refinement: Refinement


@dataclass(frozen=True)
class Samples:
    """The samples of a pixel in the model's order: for each position, each of the `lens` lens
    samples.
    """

    sampler: Any
    lens: int
    numbers: np.ndarray

    @staticmethod
    def all(sampler: Any, lens: int = 0) -> "Samples":
        """All samples; `lens` is 0 for a camera without a lens."""
        return Samples(sampler, lens, np.arange(sampler.count * max(lens, 1)))

    def __len__(self) -> int:
        return len(self.numbers)

    def only(self, number: int) -> "Samples":
        """The sample with this number."""
        return replace(self, numbers=self.numbers[number : number + 1])

    def between(self, first: int, end: int) -> "Samples":
        """The samples from `first` to before `end`."""
        return replace(self, numbers=self.numbers[first:end])

    @property
    def refinement(self) -> Optional[Refinement]:
        """The rule of adaptive sampling; None if all pixels take all samples."""
        return getattr(self.sampler, "refinement", None)

    def at_first(self) -> int:
        """Number of positions per pixel; for adaptive sampling, of the first pass."""
        return self.sampler.count if self.refinement is None else self.refinement.first

    def positions(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """(pixels, samples, 2): offsets from the top left corner of each pixel."""
        return self.sampler.at(x[:, None], y[:, None], self.numbers[None, :] // max(self.lens, 1))

    def points(self) -> Optional[np.ndarray]:
        """The lens sample of each sample; None without a lens."""
        return self.numbers % self.lens if self.lens > 0 else None


CENTRE = Fixed(np.array([[0.5, 0.5]]))


def read(table: Any, errors: List[str], unsupported: List[str]) -> Any:
    """The sampler of a document."""
    fields = Fields(table, "sampler", errors)
    kind = fields.kind()
    found: Any = CENTRE
    if kind == "grid":
        n = fields.integer("samples_per_axis", 2, 1, 64)
        steps = (np.arange(n) + 0.5) / n
        found = Fixed(np.column_stack([np.tile(steps, n), np.repeat(steps, n)]))
    elif kind == "stratified":
        found = Stratified(fields.integer("samples_per_axis", 2, 1, 64), fields.integer("seed", 0, 0, 2**32 - 1))
    elif kind == "sobol":
        found = Sobol(fields.integer("samples", 4, 1, 65536), fields.integer("seed", 0, 0, 2**32 - 1))
    elif kind == "adaptive":
        count = fields.integer("samples", 256, 1, 65536)
        first = fields.integer("initial_samples", min(8, count), 1, count)
        threshold = fields.number("threshold", 0.01, lambda radiance: radiance > 0, "a number > 0")
        found = Adaptive(count, fields.integer("seed", 0, 0, 2**32 - 1), Refinement(first, threshold))
    elif kind != "center" and kind is not None:
        unsupported.append(f"sampler: no twin for a sampler of type {kind!r}; {there_are(TYPES)}")
        return found
    fields.close()
    return found
