"""Formulas for the textures that Mitsuba lacks, as functions of the point of texture space (model
§10), in float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from . import mappings
from .fields import Vector
from .runtime import mi

# The model's permutation for noise without a seed.
PERMUTATION = np.array(
    """
151 160 137 91 90 15 131 13 201 95 96 53 194 233 7 225 140 36 103 30 69 142 8 99 37 240 21 10 23 190 6 148
247 120 234 75 0 26 197 62 94 252 219 203 117 35 11 32 57 177 33 88 237 149 56 87 174 20 125 136 171 168 68 175
74 165 71 134 139 48 27 166 77 146 158 231 83 111 229 122 60 211 133 230 220 105 92 41 55 46 245 40 244 102 143 54
65 25 63 161 1 216 80 73 209 76 132 187 208 89 18 169 200 196 135 130 116 188 159 86 164 100 109 198 173 186 3 64
52 217 226 250 124 123 5 202 38 147 118 126 255 82 85 212 207 206 59 227 47 16 58 17 182 189 28 42 223 183 170 213
119 248 152 2 44 154 163 70 221 153 101 155 167 43 172 9 129 22 39 253 19 98 108 110 79 113 224 232 178 185 112 104
218 246 97 228 251 34 242 193 238 210 144 12 191 179 162 241 81 51 145 235 249 14 239 107 49 192 214 31 181 199 106 157
184 84 204 176 115 121 50 45 127 4 150 254 138 236 205 93 222 114 67 29 24 72 243 141 128 195 78 66 215 61 156 180
""".split(),
    dtype=np.int64,
)

# The model's gradient directions, by index.
GRADIENTS = np.array(
    [
        (1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0), (1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1),
        (0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1), (1, 1, 0), (0, -1, 1), (-1, 1, 0), (0, -1, -1),
    ],
    dtype=np.float64,
)  # fmt: skip


def _hash(x: np.ndarray) -> np.ndarray:
    """The model's hash m (§9), of uint32."""
    x = np.asarray(x, dtype=np.uint32)
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def _sum(a: np.ndarray, b: int) -> np.ndarray:
    """a + b modulo 2^32."""
    return (np.asarray(a, dtype=np.uint64) + np.uint64(b % 2**32)).astype(np.uint32)


def hash32(x: int) -> int:
    """m of one integer, modulo 2^32."""
    return int(_hash(np.array([x % 2**32], dtype=np.uint32))[0])


def permutation(seed: Optional[int]) -> np.ndarray:
    """The permutation P of the model."""
    if seed is None:
        return PERMUTATION
    table = list(range(256))
    for i in range(255, 0, -1):
        j = int(_hash(_sum(_hash(np.array([i])), seed))[0]) % (i + 1)
        table[i], table[j] = table[j], table[i]
    return np.array(table, dtype=np.int64)


def gradient_noise(p: np.ndarray, table: np.ndarray) -> np.ndarray:
    """The noise N of the model at (n, 3) points."""
    cell = np.floor(p)
    f = p - cell
    c = np.mod(cell, 256).astype(np.int64)
    s = f**3 * (6 * f**2 - 15 * f + 10)
    total = 0.0
    # Trilinear interpolation, expanded: each corner has the product of three weights.
    for corner in np.ndindex(2, 2, 2):
        i, j, k = corner
        h = table[(c[:, 0] + i) % 256]
        h = table[(h + c[:, 1] + j) % 256]
        h = table[(h + c[:, 2] + k) % 256]
        slope = np.sum(GRADIENTS[h % 16] * (f - np.array(corner)), axis=1)
        total = total + np.prod(np.where(np.array(corner) == 1, s, 1 - s), axis=1) * slope
    return total


@dataclass(frozen=True)
class GridLines:
    """Lines of colour b on a."""

    a: Vector
    b: Vector
    width: Vector
    scale: Vector
    offset: Vector
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(self.a + self.b), max(self.a + self.b)

    def at(self, q: np.ndarray) -> np.ndarray:
        x = q[:, :2] * np.array(self.scale) + np.array(self.offset)
        part = x - np.floor(x)
        line = np.any(np.minimum(part, 1 - part) < np.array(self.width) / 2, axis=1)
        return np.where(line[:, None], np.array(self.b), np.array(self.a))

    def build(self) -> "mi.Texture":
        return Formula(self)


@dataclass(frozen=True)
class Noise:
    """Perlin noise and the patterns that are based on it."""

    kind: str
    a: Vector
    b: Vector
    scale: float
    octaves: int
    lacunarity: float
    gain: float
    distortion: float
    table: np.ndarray
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(self.a + self.b), max(self.a + self.b)

    def _mean(self, p: np.ndarray, absolute: bool) -> np.ndarray:
        """The sum S of the model, or A of absolute values."""
        total, strengths = 0.0, 0.0
        for k in range(self.octaves):
            value = gradient_noise(self.lacunarity**k * p, self.table)
            total = total + self.gain**k * (np.abs(value) if absolute else value)
            strengths += self.gain**k
        return total / strengths

    def at(self, q: np.ndarray) -> np.ndarray:
        p = self.scale * q
        if self.kind == "perlin":
            t = (1 + gradient_noise(p, self.table)) / 2
        elif self.kind == "fbm":
            t = (1 + self._mean(p, False)) / 2
        elif self.kind == "turbulence":
            t = self._mean(p, True)
        elif self.kind == "marble":
            t = (1 + np.sin(2 * np.pi * (p[:, 0] + self.distortion * self._mean(p, True)))) / 2
        else:
            t = (1 + np.sin(2 * np.pi * (np.hypot(p[:, 0], p[:, 1]) + self.distortion * self._mean(p, False)))) / 2
        return _between(self.a, self.b, t)

    def build(self) -> "mi.Texture":
        return Formula(self)


@dataclass(frozen=True)
class Worley:
    """Worley noise: distances to feature points."""

    value: str
    a: Vector
    b: Vector
    scale: float
    seed: int
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(self.a + self.b), max(self.a + self.b)

    def nearest(self, p: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """F1 and F2. Two cells in each direction suffice: the own cell and the nearest adjacent one
        have points within sqrt(3), all others are at least 2 away.
        """
        cell = np.floor(p)
        f = p - cell
        number = np.mod(cell, 2.0**32).astype(np.uint64)
        first = second = np.full(len(p), np.inf)
        seed = _hash(np.array([self.seed]))
        for k in range(-2, 3):
            of_k = _hash(_sum(_sum(number[:, 2], k), int(seed[0])))
            for j in range(-2, 3):
                of_j = _hash((of_k.astype(np.uint64) + _sum(number[:, 1], j)).astype(np.uint32))
                for i in range(-2, 3):
                    h = _hash((of_j.astype(np.uint64) + _sum(number[:, 0], i)).astype(np.uint32))
                    feature = np.column_stack([_hash(_sum(h, axis)) / 2.0**32 for axis in (1, 2, 3)])
                    distance = np.linalg.norm(np.array([i, j, k]) + feature - f, axis=1)
                    second = np.minimum(second, np.maximum(first, distance))
                    first = np.minimum(first, distance)
        return first, second

    def at(self, q: np.ndarray) -> np.ndarray:
        first, second = self.nearest(self.scale * q)
        t = {"f1": first, "f2": second}.get(self.value)
        return _between(self.a, self.b, second - first if t is None else t)

    def build(self) -> "mi.Texture":
        return Formula(self)


@dataclass(frozen=True)
class Solid:
    """A block of voxels; `voxels` is (n_z, n_y, n_x, 3)."""

    voxels: np.ndarray
    filter: str
    wrap: str
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return float(self.voxels.min()), float(self.voxels.max())

    def _index(self, place: np.ndarray, count: int) -> np.ndarray:
        """The voxel at integer coordinates."""
        if self.wrap == "clamp":
            return np.clip(place, 0, count - 1).astype(np.int64)
        if self.wrap == "repeat":
            return np.mod(place, count).astype(np.int64)
        folded = np.mod(place, 2 * count)
        return np.where(folded < count, folded, 2 * count - 1 - folded).astype(np.int64)

    def _voxel(self, place: np.ndarray) -> np.ndarray:
        i, j, k = (self._index(place[:, axis], self.voxels.shape[2 - axis]) for axis in range(3))
        return self.voxels[k, j, i]

    def at(self, q: np.ndarray) -> np.ndarray:
        x = q * np.array(self.voxels.shape[2::-1])
        if self.filter == "nearest":
            return self._voxel(np.floor(x))
        low = np.floor(x - 0.5)
        f = x - 0.5 - low
        total = np.zeros_like(x)
        for corner in np.ndindex(2, 2, 2):
            share = np.prod(np.where(np.array(corner) == 1, f, 1 - f), axis=1)
            total += share[:, None] * self._voxel(low + np.array(corner))
        return total

    def build(self) -> "mi.Texture":
        return Formula(self)


def _cell(x: np.ndarray) -> np.ndarray:
    """c of the model: the index of the cell, with slightly shifted borders."""
    return np.floor(x + 1 / 4096)


@dataclass(frozen=True)
class Layers:
    """`checker3d`, `stripes` and `rings`: colour b where a sum of cell indices is odd."""

    kind: str
    a: Vector
    b: Vector
    scale: float
    # Three numbers for checker3d, otherwise one.
    offset: Vector
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(self.a + self.b), max(self.a + self.b)

    def at(self, q: np.ndarray) -> np.ndarray:
        if self.kind == "checker3d":
            axes = q
        elif self.kind == "rings":
            axes = np.linalg.norm(q[:, ::2], axis=1)[:, None]
        else:
            axes = q[:, :1]
        odd = np.mod(_cell(self.scale * axes + np.array(self.offset)).sum(axis=1), 2) == 1
        return np.where(odd[:, None], np.array(self.b), np.array(self.a))

    def build(self) -> "mi.Texture":
        return Formula(self)


@dataclass(frozen=True)
class Gradient:
    """A colour ramp along the first axis."""

    # Stop positions in ascending order, and their colours.
    places: Tuple[float, ...]
    colors: Tuple[Vector, ...]
    scale: float
    offset: float
    wrap: str
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(map(min, self.colors)), max(map(max, self.colors))

    def at(self, q: np.ndarray) -> np.ndarray:
        x = self.scale * q[:, 0] + self.offset
        if self.wrap == "repeat":
            x = np.maximum(x - _cell(x), 0)
        elif self.wrap == "mirror":
            x = 1 - np.abs(np.mod(x, 2) - 1)
        # Beyond the ends NumPy's interpolation is constant: that is "clamp".
        channels = np.array(self.colors).T
        return np.column_stack([np.interp(x, self.places, channel) for channel in channels])

    def build(self) -> "mi.Texture":
        return Formula(self)


def _between(a: Vector, b: Vector, t: np.ndarray) -> np.ndarray:
    t = np.clip(t, 0, 1)[:, None]
    return np.array(a) * (1 - t) + np.array(b) * t


HOSTED = (GridLines, Noise, Worley, Solid, Layers, Gradient)


class Formula(mi.Texture):
    """A pattern as a Mitsuba texture."""

    def __init__(self, pattern: Any) -> None:
        mi.Texture.__init__(self, mi.Properties())
        self.pattern = pattern
        # The places of the last call, and its colours: materials are evaluated at the same places
        # for each lamp.
        self._last: Tuple[Any, Any] = (None, None)

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `place`, which has `p`, `uv` and `sh_frame.n` like `si`."""

        def at(points: np.ndarray) -> np.ndarray:
            # Lanes without a hit may hold any value.
            return self.pattern.at(np.nan_to_num(points, nan=0.0, posinf=0.0, neginf=0.0))

        return self.pattern.mapping.values(place, at)

    def eval(self, si: Any, active: Any = True) -> Any:
        places = tuple(np.array(place).tobytes() for place in (si.p, si.uv, si.sh_frame.n))
        # The second texture coordinates are not in `si`.
        if self._last[0] != places or self.pattern.mapping.uv_set == 1:
            self._last = places, np.ascontiguousarray(self.values(si, si).T.astype(np.float32))
        return mi.Color3f(self._last[1])

    def to_string(self) -> str:
        return f"Formula[{type(self.pattern).__name__}]"
