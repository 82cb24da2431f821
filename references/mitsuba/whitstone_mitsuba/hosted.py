"""Hits of the shapes that the driver intersects itself (`surfaces`), combined with those of
Mitsuba's scene.

All of it is float64, except for the result. Rays that leave such a surface start on it without an
offset: the part that they leave and the side that they go to are known, and the root at the start
is divided out (`surfaces.Start`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Sequence, Tuple

import numpy as np

from .runtime import dr, mi
from .surfaces import Start, Surface, Vector

_NOTHING = 0xFFFFFFFF

# Number of rays that are processed together.
CHUNK = 1 << 15


@dataclass
class Found:
    """The nearest hosted surfaces, one lane each; t is infinite on a miss."""

    t: np.ndarray
    p: np.ndarray
    n_g: np.ndarray
    n_s: np.ndarray
    uv: np.ndarray
    shape: np.ndarray
    primitive: np.ndarray
    code: np.ndarray


def _columns(value: Any) -> np.ndarray:
    """(3, n) float64 of an evaluated vector."""
    return np.array(value, dtype=np.float64).reshape(3, -1)


class Host:
    """The hosted shapes of a scene, by their index in the document."""

    def __init__(self, surfaces: Sequence[Tuple[int, Surface]], shapes: int) -> None:
        self.surfaces = list(surfaces)
        self.balls = [surface.bounds() for _, surface in self.surfaces]
        hosts = np.zeros(shapes + 2, dtype=np.uint32)
        hosts[[place for place, _ in self.surfaces]] = 1
        self.hosts = mi.UInt32(hosts)

    # ---- rays
    # ----------------------------------------------------------------------------------------------

    def _may_hit(self, number: int, o: np.ndarray, d: np.ndarray) -> np.ndarray:
        """The lanes whose lines may hit a shape, by a test of its bounding sphere."""
        centre, radius = self.balls[number]
        if not np.isfinite(radius):
            return np.arange(o.shape[1])
        q = o - centre[:, None]
        along, length = (q * d).sum(axis=0), (d * d).sum(axis=0)
        away = (q * q).sum(axis=0)
        # The rounding error of a difference of large squares must not lose a ray.
        margin = radius * radius * (1 + 1e-6) + 1e-9 * away
        return np.flatnonzero((away - along * along / length <= margin) & ((along < 0) | (away <= margin)))

    def _hits(self, number: int, lanes: np.ndarray, o: np.ndarray, d: np.ndarray, left: Any) -> Tuple[np.ndarray, np.ndarray]:
        """(t, code) of the nearest crossing in front of the start; t is infinite on a miss."""
        place, surface = self.surfaces[number]
        shape, facet = left[0][lanes], left[1][lanes].astype(np.int64)
        started = shape == place
        start = Start(np.where(started, facet >> 1, -1), started & (facet & 1 == 1))
        found = surface.crossings(tuple(o[:, lanes]), tuple(d[:, lanes]), start)
        ahead = found.t > 0
        if surface.closed:
            # A line from outside first enters the shape, one from inside first leaves it.
            first = np.where(start.outward, 1, -1)[:, None]
            ahead &= ~started[:, None] | (found.step == first)
        t = np.where(ahead, found.t, np.inf)
        # The lower code wins ties; a line has few crossings.
        best = np.lexsort((found.code, t), axis=1)[:, 0]
        rows = np.arange(len(lanes))
        return t[rows, best], found.code[rows, best]

    def nearest(self, o: np.ndarray, d: np.ndarray, left: Tuple[np.ndarray, np.ndarray]) -> Found:
        """The first hits of rays. `left`: the shape and the facet that each ray leaves."""
        parts = []
        for first in range(0, o.shape[1], CHUNK):
            span = slice(first, first + CHUNK)
            parts.append(self._nearest(o[:, span], d[:, span], (left[0][span], left[1][span])))
        if len(parts) == 1:
            return parts[0]
        names = Found.__dataclass_fields__
        return Found(*[np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names])

    def _nearest(self, o: np.ndarray, d: np.ndarray, left: Any) -> Found:
        count = o.shape[1]
        t, which, code = np.full(count, np.inf), np.full(count, -1), np.zeros(count, dtype=np.int64)
        for number in range(len(self.surfaces)):
            lanes = self._may_hit(number, o, d)
            if len(lanes) == 0:
                continue
            at, part = self._hits(number, lanes, o, d, left)
            nearer = at < t[lanes]
            chosen = lanes[nearer]
            t[chosen], which[chosen], code[chosen] = at[nearer], number, part[nearer]
        n_g, n_s, uv = np.zeros((3, count)), np.zeros((3, count)), np.zeros((2, count))
        shape, primitive = np.full(count, _NOTHING, dtype=np.int64), np.zeros(count, dtype=np.int64)
        with np.errstate(invalid="ignore"):
            p = np.where(np.isfinite(t), o + d * t, 0.0)
        for number in np.unique(which[which >= 0]):
            lanes = np.flatnonzero(which == number)
            place, surface = self.surfaces[number]
            found = surface.points(tuple(p[:, lanes]), code[lanes])
            n_g[:, lanes], n_s[:, lanes] = _unit(found.n_g), _unit(found.n_s)
            uv[:, lanes] = found.u, found.v
            shape[lanes], primitive[lanes] = place, found.primitive
        return Found(t, p, n_g, n_s, uv, shape, primitive, code)

    # ---- Dr.Jit
    # ----------------------------------------------------------------------------------------------

    def combine(self, rays: Any, valid: Any, values: Sequence[Any]) -> Tuple[Any, List[Any]]:
        """(valid, values) with hosted surfaces where they are nearer than Mitsuba's.

        `values` are t, p, n_g, n_s, n_raw, uv, shape, primitive, facet. At equal distance the shape
        with the lower number wins.
        """
        left = (np.array(rays.left_shape, dtype=np.int64), np.array(rays.left_facet, dtype=np.int64))
        found = self.nearest(_columns(rays.o), _columns(rays.d), left)
        t = mi.Float(found.t.astype(np.float32))
        shape = mi.UInt32(found.shape.astype(np.uint32))
        other = dr.select(valid, values[0], dr.inf)
        hosted = dr.isfinite(t) & ((t < other) | ((t == other) & (shape < values[6])))
        n_g, n_raw = _vector(mi.Vector3f, found.n_g), _vector(mi.Vector3f, found.n_s)
        # Rule S.
        n_s = dr.select(dr.dot(rays.d, n_raw) * dr.dot(rays.d, n_g) < 0, -n_raw, n_raw)
        whole = [mi.UInt32(part.astype(np.uint32)) for part in (found.primitive, found.code)]
        mine = [t, _vector(mi.Point3f, found.p), n_g, n_s, n_raw, _vector(mi.Point2f, found.uv), shape, *whole]
        return valid | hosted, [dr.select(hosted, own, value) for own, value in zip(mine, values)]

    def occluded(self, o: Any, d: Any, reach: Any, left: Any) -> Any:
        """Whether rays hit a hosted surface before `reach`."""
        dr.eval(o, d, reach, left.shape, left.facet)
        origin, direction, limit = _columns(o), _columns(d), np.array(reach, dtype=np.float64)
        shape, facet = np.array(left.shape, dtype=np.int64), np.array(left.facet, dtype=np.int64)
        blocked = np.zeros(origin.shape[1], dtype=bool)
        for first in range(0, len(blocked), CHUNK):
            span = slice(first, first + CHUNK)
            some = origin[:, span], direction[:, span]
            for number in range(len(self.surfaces)):
                lanes = self._may_hit(number, *some)
                if len(lanes):
                    t, _ = self._hits(number, lanes, *some, (shape[span], facet[span]))
                    blocked[first + lanes] |= t < limit[span][lanes]
        return mi.Bool(blocked)

    def leave(self, spawned: Any, p: Any, n_g: Any, direction: Any) -> None:
        """Moves the origins of rays that leave hosted surfaces onto them. The lowest bit of the
        facet gives the side that they go to.
        """
        hosted = dr.gather(mi.UInt32, self.hosts, spawned.shape) == 1
        side = dr.select(dr.dot(n_g, direction) > 0, mi.UInt32(1), mi.UInt32(0))
        spawned.o = dr.select(hosted, mi.Point3f(p), spawned.o)
        spawned.facet = dr.select(hosted, spawned.facet * 2 + side, spawned.facet)
        spawned.within = dr.select(hosted, 0, spawned.within)
        spawned.push = dr.select(hosted, mi.Vector3f(0), spawned.push)


def _unit(n: Vector) -> np.ndarray:
    n = np.array(n)
    return n / np.sqrt((n * n).sum(axis=0))


def _vector(kind: Any, rows: np.ndarray) -> Any:
    return kind(np.ascontiguousarray(rows.astype(np.float32)))
