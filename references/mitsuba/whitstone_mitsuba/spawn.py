"""Origins of rays that leave a surface, chosen to avoid self-intersection.

Mitsuba's own `spawn_ray` offsets origins by about 1500 float32 units, which is an error of several
per cent in glass. Here the hit point is computed as exactly as float32 allows (`Balls`), and the
origin is moved by K units along the geometric normal. If a ray re-hits the facet that it left,
where geometry rules that out, only this ray is spawned again with twice the offset. Geometry rules
it out as follows: a line meets a flat face once. A ray that leaves a sphere outward never meets it
again. One that goes inward meets it half a chord later at the earliest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Tuple

import numpy as np

from .runtime import dr, mi

# Each attempt doubles the offset: the last one has 1024 times the first.
ATTEMPTS = 10

_NOTHING = 0xFFFFFFFF
# Number of Mitsuba's triangles per flat face of a box: `shapes.PRIMITIVE_HALF`.
_HALF = 2


@dataclass
class Met:
    """The first hit of a ray."""

    valid: Any
    t: Any
    shape: Any
    facet: Any


@dataclass
class Spawned:
    """Rays that leave a surface, one lane each."""

    o: Any
    # The shape instance and facet that the ray leaves, and the distance below which a re-hit is
    # impossible.
    shape: Any
    facet: Any
    within: Any
    # The offset of `o` from the surface.
    push: Any

    def arrays(self) -> List[Any]:
        return [self.o, self.shape, self.facet, self.within, self.push]

    def gather(self, lanes: Any) -> "Spawned":
        """A subset of the rays."""
        return Spawned(*[dr.gather(type(array), array, lanes) for array in self.arrays()])


def no_surface(width: int) -> Tuple[Any, Any, Any, Any]:
    """`shape`, `facet`, `within` and `push` of rays that start on no surface."""
    nothing = [dr.full(mi.UInt32, _NOTHING, width) for _ in range(2)]
    return (*nothing, dr.zeros(mi.Float, width), dr.zeros(mi.Vector3f, width))


def facet(rule: Any, index: Any) -> Any:
    """The flat face that this primitive of Mitsuba belongs to; 0 if the whole shape is one face.
    `rule` is that of `shapes.Rules.primitive`.
    """
    return dr.select(rule == 0, 0, dr.select(rule == _HALF, index >> 1, index))


def farther(o: Any, push: Any, attempt: int) -> Any:
    """Origins with 2^attempt times the offset from their surface."""
    return mi.Point3f(o + push * dr.opaque(mi.Float, 2.0**attempt - 1.0))


def leave(built: Any, p: Any, n_g: Any, direction: Any, shape: Any, facet: Any, k: Any) -> Spawned:
    """Rays from `p` in `direction`; the origin is K units from `p` along n_g, on the side that they
    go to.

    A unit is 2^-24 of the largest coordinate of the point plus the size of the shape, at most 1 m:
    intersections round numbers of that size.
    """
    size = dr.gather(mi.Float, built.sizes, shape)
    push = n_g * ((size + dr.max(dr.abs(p))) * k * dr.sign(dr.dot(n_g, direction)))
    within = built.balls.chord(p, direction, shape)
    return Spawned(mi.Point3f(p + push), shape, facet, within, mi.Vector3f(push))


class Balls:
    """The spheres and cylinders of a scene in float64. Mitsuba leaves their hits at ray(t), off the
    surface by the rounding of t.
    """

    def __init__(self, balls: np.ndarray, axes: np.ndarray, wraps: np.ndarray) -> None:
        """`balls`: (n, 4), centre and radius of each shape; the radius is 0 for other shapes.

        `axes`, (n, 3), and `wraps`, (n, 3, 4), belong to cylinders (`shapes.Rules`) and are 0
        otherwise.
        """
        self._balls = mi.Float64(np.ascontiguousarray(np.ravel(balls), dtype=np.float64))
        self._any = bool((balls[:, 3] > 0).any())
        # Scenes without cylinders skip the computations with axes.
        self._axes = mi.Float64(np.ascontiguousarray(np.ravel(axes), dtype=np.float64)) if axes.any() else None
        self._wraps = mi.Float64(np.ascontiguousarray(np.ravel(wraps), dtype=np.float64))

    def _gather(self, shape: Any, valid: Any) -> Tuple[Any, Any]:
        entry = [dr.gather(mi.Float64, self._balls, shape * 4 + number, valid) for number in range(4)]
        return mi.Point3d(*entry[:3]), entry[3]

    def _across(self, vector: Any, shape: Any, valid: Any) -> Any:
        """The component of a vector perpendicular to the axis of the shape."""
        if self._axes is None:
            return vector
        axis = mi.Vector3d(*[dr.gather(mi.Float64, self._axes, shape * 3 + number, valid) for number in range(3)])
        return vector - axis * dr.dot(axis, vector)

    def refine(self, o: Any, d: Any, shape: Any, valid: Any, t: Any, p: Any, n_g: Any, n_s: Any, n_raw: Any) -> Tuple[Any, ...]:
        """(t, p, n_g, n_s, n_raw) with the hits of round shapes recomputed: of the two roots, the
        one nearest to Mitsuba's t.
        """
        if not self._any:
            return t, p, n_g, n_s, n_raw
        centre, radius = self._gather(shape, valid)
        round_ = valid & (radius > 0)
        whole, direction = mi.Vector3d(mi.Point3d(o) - centre), mi.Vector3d(d)
        start, way = self._across(whole, shape, valid), self._across(direction, shape, valid)
        middle = -dr.dot(start, way) / dr.squared_norm(way)
        foot = start + way * middle
        half = dr.sqrt(dr.maximum(radius * radius - dr.squared_norm(foot), 0) / dr.squared_norm(way))
        near, far, native = middle - half, middle + half, mi.Float64(t)
        root = dr.select(dr.abs(near - native) <= dr.abs(far - native), near, far)
        n = dr.normalize(start + way * root)
        normal = mi.Vector3f(n)
        place = centre + n * radius
        if self._axes is not None:
            # And along the axis.
            place = place + (whole - start) + (direction - way) * root
        # n_s is n_g, flipped to the same side if needed.
        turned = dr.select(dr.dot(n_s, n_g) < 0, -normal, normal)
        return (
            dr.select(round_, mi.Float(root), t),
            dr.select(round_, mi.Point3f(place), p),
            dr.select(round_, normal, n_g),
            dr.select(round_, turned, n_s),
            dr.select(round_, normal, n_raw),
        )

    def wrapped(self, shape: Any, valid: Any, p: Any, uv: Any) -> Any:
        """Texture coordinates, with those of cylinders recomputed from the refined point."""
        if self._axes is None:
            return uv
        place = mi.Point3d(p)
        rows = []
        for row in range(3):
            entry = [dr.gather(mi.Float64, self._wraps, shape * 12 + row * 4 + number, valid) for number in range(4)]
            rows.append(entry[0] * place.x + entry[1] * place.y + entry[2] * place.z + entry[3])
        turn = dr.atan2(rows[1], rows[0]) * (0.5 / np.pi)
        turn = dr.select(turn < 0, turn + 1, turn)
        axis = [dr.gather(mi.Float64, self._axes, shape * 3 + number, valid) for number in range(3)]
        tube = valid & ((axis[0] != 0) | (axis[1] != 0) | (axis[2] != 0))
        return dr.select(tube, mi.Point2f(mi.Float(turn), mi.Float(rows[2])), uv)

    def chord(self, p: Any, direction: Any, shape: Any) -> Any:
        """The distance below which the shape cannot be hit again: half the chord if the ray goes
        into a round shape, otherwise infinite.
        """
        endless = dr.full(mi.Float, dr.inf, dr.width(p))
        if not self._any:
            return endless
        centre, radius = self._gather(shape, True)
        way = self._across(mi.Vector3d(direction), shape, True)
        half = mi.Float(-dr.dot(mi.Vector3d(mi.Point3d(p) - centre), way) / dr.squared_norm(way))
        return dr.select((radius > 0) & (half > 0), half, endless)
