"""The material `tabulated` (model §8): a BRDF as a table over the angles of the half vector.

The albedos are integrated in double precision; Mitsuba's geometry and frames host the lookup.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Optional

import numpy as np

from .fields import REQUIRED, Fields, Vector, as_color
from .runtime import dr, mi

# Limits on the number of rows and of entries of a row.
SHORTEST, LONGEST = 2, 1024
# The largest albedo that the check accepts.
LARGEST_ALBEDO = 1.001
# Azimuths of half vectors, and the least number of their angles to the normal.
AZIMUTHS, STEPS = 32, 32
RIGHT = math.pi / 2


@dataclass(frozen=True, eq=False)
class Table:
    """A BRDF: (R, C, 3) values over theta_h and theta_d."""

    values: np.ndarray
    square_root: bool = False

    def angle(self, share: np.ndarray) -> np.ndarray:
        """The model's a(s)."""
        return RIGHT * (share**2 if self.square_root else share)

    def slope(self, share: np.ndarray) -> np.ndarray:
        """The derivative of a(s)."""
        return RIGHT * (2 * share if self.square_root else np.ones_like(share))

    def share(self, angle: Any) -> Any:
        """The inverse of a(s)."""
        return np.sqrt(angle / RIGHT) if self.square_root else angle / RIGHT

    def at(self, theta_h: np.ndarray, theta_d: np.ndarray) -> np.ndarray:
        """(..., 3): f at arrays of angles."""
        rows, columns = self.values.shape[:2]
        x = np.minimum(self.share(theta_h), 1) * (rows - 1)
        y = np.minimum(theta_d / RIGHT, 1) * (columns - 1)
        i, j = (np.minimum(z.astype(int), count - 2) for z, count in ((x, rows), (y, columns)))
        s, t = (x - i)[..., None], (y - j)[..., None]
        v = self.values
        return (1 - s) * ((1 - t) * v[i, j] + t * v[i, j + 1]) + s * ((1 - t) * v[i + 1, j] + t * v[i + 1, j + 1])

    def normal_albedo(self) -> np.ndarray:
        """The model's A, by Gauss's quadrature between the kinks of the table."""
        rows, columns = self.values.shape[:2]
        kinks = np.concatenate([self.angle(np.linspace(0, 1, rows)), np.linspace(0, RIGHT, columns)])
        kinks = self.share(np.unique(np.append(kinks[kinks < math.pi / 4], math.pi / 4)))
        nodes, weights = np.polynomial.legendre.leggauss(16)
        middle, half = (kinks[1:] + kinks[:-1]) / 2, (kinks[1:] - kinks[:-1]) / 2
        share = middle[:, None] + half[:, None] * nodes
        theta = self.angle(share)
        factor = 2 * math.pi * np.sin(4 * theta) * self.slope(share) * half[:, None] * weights
        return np.sum(factor[..., None] * self.at(theta, theta), axis=(0, 1))

    def albedo(self, theta_v: float) -> np.ndarray:
        """The model's q."""
        intervals = len(self.values) - 1
        n = intervals * max(2, math.ceil(STEPS / intervals))
        inner = (1 + np.array([-1, 1]) / math.sqrt(3)) / 2
        share = ((np.arange(n)[:, None] + inner) / n).reshape(-1, 1)
        phi = math.pi * (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS
        theta_h = self.angle(share)
        v_h = math.sin(theta_v) * np.sin(theta_h) * np.cos(phi) + math.cos(theta_v) * np.cos(theta_h)
        n_l = 2 * v_h * np.cos(theta_h) - math.cos(theta_v)
        factor = np.maximum(n_l, 0) * 4 * np.maximum(v_h, 0) * np.sin(theta_h) * self.slope(share) * 2 * math.pi / (64 * n)
        theta_d = np.arccos(np.clip(v_h, -1, 1))
        return np.sum(factor[..., None] * self.at(np.broadcast_to(theta_h, theta_d.shape), theta_d), axis=(0, 1))


def _rows(raw: Any) -> Optional[List[List[Vector]]]:
    """The entries as colours; None if they are no table."""
    if not isinstance(raw, list) or not all(isinstance(row, list) for row in raw):
        return None
    lengths = {len(raw), *map(len, raw)}
    if not raw or len(set(map(len, raw))) != 1 or min(lengths) < SHORTEST or max(lengths) > LONGEST:
        return None
    colors = [[as_color(entry) for entry in row] for row in raw]
    good = all(color is not None and min(color) >= 0 for row in colors for color in row)
    return colors if good else None  # type: ignore[return-value]


def read(fields: Fields) -> Table:
    """The table of a material."""
    raw = fields.take("values", REQUIRED)
    square_root = fields.choice("spacing", "even", ("even", "square_root")) == "square_root"
    rows = _rows(raw)
    if rows is None:
        if raw is not None:
            fields.error("values", f"expected {SHORTEST} to {LONGEST} rows of equal length, each of {SHORTEST} to {LONGEST} colours >= 0")
        return Table(np.zeros((2, 2, 3)))
    table = Table(np.array(rows, dtype=np.float64), square_root)
    for degrees in range(0, 90, 10):
        albedo = float(table.albedo(math.radians(degrees)).max())
        if albedo > LARGEST_ALBEDO:
            fields.error("values", f"expected a BRDF that creates no energy, found an albedo of {albedo:.3f} at {degrees} degrees")
            break
    return table


class Tabulated(mi.BSDF):
    """Looks up a table. It works in the local frame of the shading normal; Mitsuba's `wi` is the
    model's v, `wo` its l. It is two-sided.
    """

    def __init__(self, table: Table, tint: "mi.Texture") -> None:
        mi.BSDF.__init__(self, mi.Properties())
        self.tint, self.square_root = tint, table.square_root
        rows, columns = table.values.shape[:2]
        # Opaque: the numbers must not become constants of the kernel.
        self.last = [dr.opaque(mi.Float, count - 1.0) for count in (rows, columns)]
        self.columns = dr.opaque(mi.UInt32, columns)
        self.channels = [mi.Float(np.ascontiguousarray(table.values[:, :, channel].ravel(), dtype=np.float32)) for channel in range(3)]
        self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide]
        self.m_flags = self.m_components[0]

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        v = si.wi
        side = dr.select(v.z < 0, mi.Float(-1), mi.Float(1))
        cosine = wo.z * side
        m = wo + v
        length = dr.norm(m)
        theta_h = dr.select(length > 0, dr.atan2(dr.norm(mi.Vector2f(m.x, m.y)), m.z * side), 0)
        theta_d = dr.atan2(dr.norm(wo - v), length)
        share = theta_h * (1 / RIGHT)
        x = dr.minimum((dr.sqrt(share) if self.square_root else share) * self.last[0], self.last[0])
        y = dr.minimum(theta_d * (1 / RIGHT) * self.last[1], self.last[1])
        i, j = dr.minimum(dr.floor(x), self.last[0] - 1), dr.minimum(dr.floor(y), self.last[1] - 1)
        s, t = x - i, y - j
        first = mi.UInt32(i) * self.columns + mi.UInt32(j)

        def entry(index: Any) -> Any:
            return mi.Color3f(*[dr.gather(mi.Float, channel, index, active) for channel in self.channels])

        low = (1 - t) * entry(first) + t * entry(first + 1)
        high = (1 - t) * entry(first + self.columns) + t * entry(first + self.columns + 1)
        value = self.tint.eval(si, active) * ((1 - s) * low + s * high) * cosine
        return dr.select(active & (cosine > 0), value, 0)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return mi.Float(0)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval(ctx, si, wo, active), mi.Float(0)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        """Nothing: it has no delta branches."""
        return dr.zeros(mi.BSDFSample3f), mi.Color3f(0)

    def to_string(self) -> str:
        return "Tabulated[]"
