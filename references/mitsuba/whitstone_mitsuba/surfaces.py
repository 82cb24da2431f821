"""Shapes that the driver intersects itself, in float64: clipped quadrics, torus, flat shapes,
prisms, lathes, closed meshes (model §9).

Rays are given in world space. Each surface transforms them to its object space with the inverse of
its matrix, which preserves the ray parameter t. It returns all its crossings along the whole line,
including those behind the origin, which `csg` needs. A ray that starts on a surface does so at
exactly t = 0. That root is divided out of the equation, so that rounding of the origin cannot make
it reappear. Sums are written out term by term, because matrix products of NumPy round differently
in arrays of different sizes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from . import polynomials

# Three coordinates, one array each.
Vector = Tuple[np.ndarray, np.ndarray, np.ndarray]

# Number of pairs of rays and triangles that are processed together.
PAIRS = 1 << 21


def dot(a: Sequence, b: Sequence) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence, b: Sequence) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def turn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The angle about the z axis as a fraction of a full turn, in [0, 1)."""
    phi = np.arctan2(y, x) / (2 * np.pi)
    phi = np.where(phi < 0, phi + 1, phi)
    return np.where(phi >= 1, 0.0, phi)


@dataclass
class Start:
    """For rays that leave a surface: the code of the part that they start on (-1 for other rays),
    and whether they go outside.
    """

    code: np.ndarray
    outward: np.ndarray

    def of(self, lanes: np.ndarray) -> "Start":
        return Start(self.code[lanes], self.outward[lanes])


@dataclass
class Crossings:
    """Crossings of lines with a surface: (n, m) each, in no order; unused entries have t = inf.

    `step` is 1 where the line enters, -1 where it leaves. `code` names the part of the surface.
    """

    t: np.ndarray
    step: np.ndarray
    code: np.ndarray


@dataclass
class Points:
    """Surface data at some points, in world space: outward normals (not normalised), texture
    coordinates, primitive number.
    """

    n_g: Vector
    n_s: Vector
    u: np.ndarray
    v: np.ndarray
    primitive: np.ndarray


class Surface:
    """A surface in world space. Closed ones have an inside, so lines enter and leave them
    alternately.
    """

    closed = True
    # Number of parts with their own codes: 0, 1, ...
    codes = 1

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix, self.inverse = matrix, np.linalg.inv(matrix)

    def local(self, p: Vector, translate: bool = True) -> Vector:
        """Transforms points (or directions) from world space to object space."""
        rows = self.inverse
        moved = [dot(rows[axis, :3], p) for axis in range(3)]
        if translate:
            moved = [value + rows[axis, 3] for axis, value in enumerate(moved)]
        return moved[0], moved[1], moved[2]

    def outward(self, n: Vector) -> Vector:
        """Transforms a normal from object space to world space by the inverse transpose, so that it
        still points outside.
        """
        columns = self.inverse[:3, :3].T
        return dot(columns[0], n), dot(columns[1], n), dot(columns[2], n)

    def bounds(self) -> Tuple[np.ndarray, float]:
        """World-space centre and radius of a bounding sphere; the radius may be infinite."""
        centre, radius = self.own_bounds()
        size = np.linalg.svd(self.matrix[:3, :3], compute_uv=False)[0]
        return self.matrix[:3, :3] @ centre + self.matrix[:3, 3], float(size * radius * (1 + 1e-9))

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        """As `bounds`, in object space."""
        raise NotImplementedError

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        """All crossings of lines in world space."""
        raise NotImplementedError

    def points(self, p: Vector, code: np.ndarray) -> Points:
        """The surface at world-space points that lie on its parts `code`."""
        raise NotImplementedError


def _middle(o: Vector, d: Vector, started: np.ndarray) -> np.ndarray:
    """The parameter nearest to the origin of object space, from where crossings are computed. 0 if
    the ray starts on the surface.
    """
    return np.where(started, 0.0, -dot(o, d) / dot(d, d))


class Cut(Surface):
    """The set f <= 0 of a quadratic function, clipped by planes n . p <= c. Without a function, the
    intersection of the half-spaces.

    Its parts are the quadric (code 0) and the planes (from 1 on). If it is not closed, it consists
    of the quadric only.
    """

    def __init__(self, matrix: np.ndarray, planes: Sequence[Tuple[Sequence[float], float]], closed: bool) -> None:
        Surface.__init__(self, matrix)
        self.planes, self.closed, self.codes = planes, closed, len(planes) + 1
        # f = p A p + 2 b . p + c
        self.a: Optional[np.ndarray] = None
        self.b, self.c = np.zeros(3), 0.0

    def quadric(self, a: np.ndarray, b: Sequence[float], c: float) -> "Cut":
        """Sets the function."""
        self.a, self.b, self.c = np.asarray(a, dtype=float), np.asarray(b, dtype=float), float(c)
        return self

    def half_gradient(self, p: Vector) -> Vector:
        a, b = self.a, self.b
        assert a is not None, "only a surface with a function has points on it"
        return dot(a[0], p) + b[0], dot(a[1], p) + b[1], dot(a[2], p) + b[2]

    def _inside(self, o: Vector, d: Vector, start: Start) -> List[Tuple[np.ndarray, np.ndarray]]:
        """The at most two intervals of each line where f <= 0."""
        assert self.a is not None, "the caller checks that there is a function"
        c2 = dot(tuple(dot(row, d) for row in self.a), d)
        gradient = self.half_gradient(o)
        c1, c0 = dot(gradient, d), dot(gradient, o) + dot(self.b, o) + self.c
        here = start.code == 0
        c0 = np.where(here, 0.0, c0)
        # f grows outwards: rounding of the origin must not flip the side of a ray that grazes the
        # surface.
        c1 = np.where(here, np.where(start.outward, np.maximum(c1, 0.0), np.minimum(c1, 0.0)), c1)
        inner = c1 * c1 - c2 * c0
        with np.errstate(divide="ignore", invalid="ignore"):
            q = -(c1 + np.where(c1 < 0, -1.0, 1.0) * np.sqrt(np.maximum(inner, 0.0)))
            first, second = q / c2, np.where(q == 0, 0.0, c0 / q)
        # One of the two roots is the start: exactly 0.
        other = np.where(c2 == 0, np.inf, -2 * c1 / np.where(c2 == 0, 1.0, c2))
        first, second = np.where(here, other, first), np.where(here, 0.0, second)
        low, high = np.minimum(first, second), np.maximum(first, second)
        nothing, everything = np.full_like(c0, np.inf), np.full_like(c0, -np.inf)
        two = (inner > 0) | here
        bowl, dome, line = c2 > 0, c2 < 0, c2 == 0
        constant = line & (c1 == 0)
        begin = np.select(
            [bowl & two, dome, line & (c1 > 0), line & (c1 < 0), constant & (c0 <= 0)],
            [low, everything, everything, second, everything],
            nothing,
        )
        end = np.select(
            [bowl & two, dome & two, dome, line & (c1 > 0), line & (c1 < 0), constant & (c0 <= 0)],
            [high, low, nothing, second, nothing, nothing],
            everything,
        )
        again = np.where(dome & two, high, nothing)
        return [(begin, end), (again, np.where(dome & two, nothing, everything))]

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        middle = _middle(o, d, start.code >= 0)
        o = tuple(o[axis] + middle * d[axis] for axis in range(3))
        count = len(middle)
        # The interval inside all planes, and the planes that bound it; the first of several at one
        # point.
        enter, leave = np.full(count, -np.inf), np.full(count, np.inf)
        enter_code, leave_code = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        for number, (normal, offset) in enumerate(self.planes):
            height = np.where(start.code == number + 1, 0.0, dot(normal, o) - offset)
            slope = dot(normal, d)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = -height / slope
            later, sooner = (slope < 0) & (t > enter), (slope > 0) & (t < leave)
            enter, enter_code = np.where(later, t, enter), np.where(later, number + 1, enter_code)
            leave, leave_code = np.where(sooner, t, leave), np.where(sooner, number + 1, leave_code)
            enter = np.where((slope == 0) & (height > 0), np.inf, enter)
        if self.a is None:
            intervals = [(np.full(count, -np.inf), np.full(count, np.inf))]
        else:
            intervals = self._inside(o, d, start)
        t, step, code = [], [], []
        for begin, end in intervals:
            if self.closed:
                # On the rim the quadric wins.
                low, high = np.maximum(begin, enter), np.minimum(end, leave)
                there = [low <= high, low <= high]
                codes = [np.where(enter > begin, enter_code, 0), np.where(leave < end, leave_code, 0)]
            else:
                low, high = begin, end
                there = [np.isfinite(low) & (enter <= low) & (low <= leave), np.isfinite(high) & (enter <= high) & (high <= leave)]
                codes = [np.zeros(count, dtype=np.int64)] * 2
            for end_t, end_there, end_code, end_step in zip((low, high), there, codes, (1, -1)):
                t.append(np.where(end_there & (end_t < np.inf), end_t + middle, np.inf))
                step.append(np.where(end_there & (end_t < np.inf), end_step, 0))
                code.append(end_code)
        return Crossings(np.column_stack(t), np.column_stack(step), np.column_stack(code))

    def points(self, p: Vector, code: np.ndarray) -> Points:
        p = self.local(p)
        count = len(code)
        n = [np.zeros(count) for _ in range(3)]
        side = code == 0
        if self.a is not None:
            gradient = self.half_gradient(p)
            flat = dot(gradient, gradient) == 0
            for axis, apex in enumerate(self.apex()):
                n[axis] = np.where(flat, apex, gradient[axis])
        q = list(p)
        for number, (normal, offset) in enumerate(self.planes):
            # Project onto the plane exactly: textures may have an edge there.
            away = dot(normal, p) - offset
            for axis in range(3):
                n[axis] = np.where(code == number + 1, normal[axis], n[axis])
                q[axis] = np.where(code == number + 1, p[axis] - normal[axis] * away, q[axis])
        p = (q[0], q[1], q[2])
        u, v, primitive = self.coordinates(p, code, side)
        outward = self.outward((n[0], n[1], n[2]))
        return Points(outward, outward, u, v, primitive)

    def apex(self) -> Sequence[float]:
        """The normal at a point where the gradient is 0."""
        return 0.0, 0.0, 1.0

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(u, v, primitive)."""
        raise NotImplementedError


class Ball(Cut):
    """The unit ball: sphere and ellipsoid by their matrices."""

    def __init__(self, matrix: np.ndarray) -> None:
        Cut.__init__(self, matrix, [], True)
        self.quadric(np.eye(3), np.zeros(3), -1.0)

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return np.zeros(3), 1.0

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        theta = np.arctan2(np.sqrt(p[0] * p[0] + p[1] * p[1]), p[2])
        return turn(p[0], p[1]), (np.pi - theta) / np.pi, np.zeros(len(code), dtype=np.int64)


class Round(Cut):
    """Cylinder, cone, paraboloid, hyperboloid: x² + y² <= a z² + 2 b z + c between two planes
    perpendicular to the z axis.
    """

    def __init__(self, matrix: np.ndarray, profile: Tuple[float, float, float], z: Sequence[float], caps: bool) -> None:
        Cut.__init__(self, matrix, [((0.0, 0.0, -1.0), -z[0]), ((0.0, 0.0, 1.0), z[1])], caps)
        a, b, c = profile
        self.quadric(np.diag([1.0, 1.0, -a]), [0.0, 0.0, -b], -c)
        self.z = z
        self.radii = [float(np.sqrt(max(a * end * end + 2 * b * end + c, 0.0))) for end in z]

    def apex(self) -> Sequence[float]:
        return 0.0, 0.0, -1.0 if self.radii[0] < self.radii[1] else 1.0

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        # Between the ends the radius is at most the larger one: profiles are convex, straight or
        # open upwards.
        return np.array([0.0, 0.0, 0.5 * (self.z[0] + self.z[1])]), float(np.hypot(max(self.radii), 0.5 * (self.z[1] - self.z[0])))

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        around = turn(p[0], p[1])
        along = (p[2] - self.z[0]) / (self.z[1] - self.z[0])
        radius = np.where(code == 1, *[r if r > 0 else 1.0 for r in self.radii])
        out = np.sqrt(p[0] * p[0] + p[1] * p[1]) / radius
        return np.where(side, around, out), np.where(side, along, around), code


class Quadric(Cut):
    """Any quadric, clipped by a box."""

    def __init__(self, matrix: np.ndarray, form: np.ndarray, box: np.ndarray, caps: bool) -> None:
        planes = []
        for axis in range(3):
            for sign, end in ((-1.0, box[0]), (1.0, box[1])):
                planes.append((tuple(sign if k == axis else 0.0 for k in range(3)), sign * end[axis]))
        Cut.__init__(self, matrix, planes, caps)
        self.quadric(form[:3, :3], form[:3, 3], form[3, 3])
        self.box = box

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return 0.5 * (self.box[0] + self.box[1]), 0.5 * float(np.linalg.norm(self.box[1] - self.box[0]))

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        low, size = self.box[0], self.box[1] - self.box[0]
        return (p[0] - low[0]) / size[0], (p[1] - low[1]) / size[1], code


class Box(Cut):
    """The cube [-1, 1]^3, as an operand."""

    def __init__(self, matrix: np.ndarray) -> None:
        planes = [(tuple(sign if k == axis else 0.0 for k in range(3)), 1.0) for axis in range(3) for sign in (-1.0, 1.0)]
        Cut.__init__(self, matrix, planes, True)

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return np.zeros(3), 3**0.5

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        axis = (code - 1) // 2
        u = np.choose(axis, [p[1], p[2], p[0]])
        v = np.choose(axis, [p[2], p[0], p[1]])
        return (u + 1) / 2, (v + 1) / 2, code - 1


class HalfSpace(Cut):
    """The half-space z < 0: a plane as an operand."""

    def __init__(self, matrix: np.ndarray) -> None:
        Cut.__init__(self, matrix, [((0.0, 0.0, 1.0), 0.0)], True)

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return np.zeros(3), np.inf

    def coordinates(self, p: Vector, code: np.ndarray, side: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        return p[0], p[1], np.zeros(len(code), dtype=np.int64)


class Torus(Surface):
    """A torus, in units of its major radius."""

    def __init__(self, matrix: np.ndarray, major: float, minor: float) -> None:
        scaled = matrix.copy()
        scaled[:3, :3] *= major
        Surface.__init__(self, scaled)
        self.minor = minor / major

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return np.zeros(3), 1.0 + self.minor

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        here = start.code == 0
        length = np.sqrt(dot(d, d))
        d = tuple(axis / length for axis in d)
        middle = _middle(o, d, here)
        o = tuple(o[axis] + middle * d[axis] for axis in range(3))
        # f = (|p|² + 1 - minor²)² - 4 (x² + y²), a polynomial of s, the distance from o.
        m, k = dot(o, d), dot(o, o) + 1 - self.minor * self.minor
        across, mixed, flat = d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1]
        c3, c2, c1, c0 = 4 * m, 2 * k + 4 * m * m - 4 * across, 4 * m * k - 8 * mixed, k * k - 4 * flat
        reach = (1 + self.minor) * (1 + 1e-6)
        half = m * m - dot(o, o) + reach * reach
        t, step = np.full((len(m), 4), np.inf), np.zeros((len(m), 4), dtype=np.int64)
        for started in (False, True):
            lanes = np.flatnonzero((half > 0) & (here == started))
            if len(lanes) == 0:
                continue
            low, high = -m[lanes] - np.sqrt(half[lanes]), -m[lanes] + np.sqrt(half[lanes])
            if started:
                # One root is the start; f grows outwards there.
                out = start.outward[lanes]
                slope = np.where(out, np.maximum(c1[lanes], 0.0), np.minimum(c1[lanes], 0.0))
                roots, rising = polynomials.real_roots([slope, c2[lanes], c3[lanes], np.ones(len(lanes))], low, high)
                rising = rising == (roots > 0)
                roots, rising = np.column_stack([roots, np.zeros(len(lanes))]), np.column_stack([rising, out])
            else:
                roots, rising = polynomials.real_roots([c0[lanes], c1[lanes], c2[lanes], c3[lanes], np.ones(len(lanes))], low, high)
            t[lanes] = (roots + middle[lanes, None]) / length[lanes, None]
            step[lanes] = np.where(np.isfinite(roots), np.where(rising, -1, 1), 0)
        return Crossings(t, step, np.zeros_like(step))

    def points(self, p: Vector, code: np.ndarray) -> Points:
        x, y, z = self.local(p)
        ring = np.sqrt(x * x + y * y)
        out = ring - 1.0
        # From the centre circle of the tube; x/ring and y/ring are the direction to it.
        n = self.outward((out * x / ring, out * y / ring, z))
        return Points(n, n, turn(x, y), turn(out, z), np.zeros(len(code), dtype=np.int64))


class Flat(Surface):
    """Plane, rectangle and disk: z = 0."""

    closed = False

    def __init__(self, matrix: np.ndarray, kind: str) -> None:
        Surface.__init__(self, matrix)
        self.kind = kind

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return np.zeros(3), {"plane": np.inf, "rectangle": 2**0.5, "disk": 1.0}[self.kind]

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -o[2] / d[2]
            x, y = o[0] + t * d[0], o[1] + t * d[1]
            if self.kind == "rectangle":
                there = (np.abs(x) <= 1) & (np.abs(y) <= 1)
            elif self.kind == "disk":
                there = x * x + y * y <= 1
            else:
                there = np.isfinite(t)
        t = np.where(there & (d[2] != 0) & (start.code < 0), t, np.inf)
        return Crossings(t[:, None], np.where(d[2] < 0, 1, -1)[:, None], np.zeros((len(t), 1), dtype=np.int64))

    def points(self, p: Vector, code: np.ndarray) -> Points:
        x, y, _ = self.local(p)
        nothing = np.zeros_like(x)
        n = self.outward((nothing, nothing, np.ones_like(x)))
        u, v = x, y
        if self.kind == "rectangle":
            u, v = (x + 1) / 2, (y + 1) / 2
        elif self.kind == "disk":
            u, v = np.sqrt(x * x + y * y), turn(x, y)
        return Points(n, n, u, v, np.zeros(len(code), dtype=np.int64))


class Polygon(Surface):
    """The region enclosed by a closed polyline in a plane."""

    closed = False

    def __init__(self, matrix: np.ndarray, vertices: np.ndarray, normal: np.ndarray) -> None:
        Surface.__init__(self, matrix)
        self.vertices, self.middle = vertices, vertices.mean(axis=0)
        self.normal = normal / np.linalg.norm(normal)
        size = np.abs(normal)
        # The axis along which the normal is largest; the lowest one wins ties.
        self.axis = int(np.flatnonzero(size >= size.max() * (1 - 1e-9))[0])

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return self.middle, float(np.linalg.norm(self.vertices - self.middle, axis=1).max())

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        slope = dot(self.normal, d)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -dot(self.normal, tuple(o[axis] - self.middle[axis] for axis in range(3))) / slope
            p = [o[axis] + t * d[axis] for axis in range(3)]
        b, c = (self.axis + 1) % 3, (self.axis + 2) % 3
        t = np.where(np.isfinite(t) & (start.code < 0), t, np.inf)
        lanes = np.flatnonzero(np.isfinite(t))
        inside = np.zeros(len(lanes), dtype=bool)
        x, y = p[b][lanes], p[c][lanes]
        # Number of edges that a half-line along x crosses: odd inside.
        for first, second in zip(self.vertices, np.roll(self.vertices, -1, axis=0)):
            if first[c] == second[c]:
                continue
            # The same number for both directions of an edge.
            low, high = (first, second) if first[c] < second[c] else (second, first)
            at = low[b] + (y - low[c]) / (high[c] - low[c]) * (high[b] - low[b])
            inside ^= (low[c] <= y) & (y < high[c]) & (x < at)
        t[lanes[~inside]] = np.inf
        return Crossings(t[:, None], np.where(slope < 0, 1, -1)[:, None], np.zeros((len(t), 1), dtype=np.int64))

    def points(self, p: Vector, code: np.ndarray) -> Points:
        p = self.local(p)
        ones = np.ones(len(code))
        n = self.outward((self.normal[0] * ones, self.normal[1] * ones, self.normal[2] * ones))
        return Points(n, n, p[(self.axis + 1) % 3], p[(self.axis + 2) % 3], np.zeros(len(code), dtype=np.int64))


def _lengths(points: np.ndarray) -> np.ndarray:
    """The length of a path up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


class Prism(Surface):
    """A polygon in the plane (x, z), swept along y between two heights. The sides have the codes of
    their edges; the caps follow.
    """

    def __init__(self, matrix: np.ndarray, points: np.ndarray, heights: Sequence[float]) -> None:
        Surface.__init__(self, matrix)
        self.ring = np.concatenate([points, points[:1]])
        self.heights, self.sides = heights, len(points)
        self.codes = self.sides + 2
        x, z = (self.ring - self.ring[0]).T
        self.sense = float(np.sign((x[:-1] * z[1:] - x[1:] * z[:-1]).sum()))
        along = np.diff(self.ring, axis=0)
        size = np.linalg.norm(along, axis=1)[:, None]
        # Out of the polygon, in x and z.
        self.out = self.sense * np.column_stack([along[:, 1], -along[:, 0]]) / size
        self.before = _lengths(self.ring)

    def normals(self) -> np.ndarray:
        """The outward normal of each part."""
        rows = np.zeros((self.codes, 3))
        rows[: self.sides, [0, 2]] = self.out
        rows[self.sides :, 1] = -1, 1
        return rows

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        low, high = self.ring.min(axis=0), self.ring.max(axis=0)
        middle = 0.5 * (low + high)
        widest = float(np.linalg.norm(self.ring - middle, axis=1).max())
        centre = np.array([middle[0], 0.5 * (self.heights[0] + self.heights[1]), middle[1]])
        return centre, float(np.hypot(widest, 0.5 * (self.heights[1] - self.heights[0])))

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        middle = _middle(o, d, start.code >= 0)
        o = tuple(o[axis] + middle * d[axis] for axis in range(3))
        (low, high), count = self.heights, len(middle)
        shape = (count, self.codes)
        t, step = np.full(shape, np.inf), np.zeros(shape, dtype=np.int64)
        # The side of the line, seen along the axis, that each corner is on.
        sides = [d[0] * (z - o[2]) - d[2] * (x - o[0]) for x, z in self.ring]
        for edge in range(self.sides):
            a, b = sides[edge], sides[edge + 1]
            out = self.out[edge]
            slope = out[0] * d[0] + out[1] * d[2]
            with np.errstate(divide="ignore", invalid="ignore"):
                at = (out[0] * (self.ring[edge, 0] - o[0]) + out[1] * (self.ring[edge, 1] - o[2])) / slope
            at = np.where(start.code == edge, 0.0, at)
            with np.errstate(invalid="ignore"):
                y = o[1] + at * d[1]
            there = ((a >= 0) != (b >= 0)) & (low <= y) & (y <= high)
            t[:, edge] = np.where(there, at + middle, np.inf)
            step[:, edge] = np.where(there, np.where((a >= 0) == (self.sense > 0), 1, -1), 0)
        for number, (height, sign) in enumerate(((low, -1.0), (high, 1.0))):
            code = self.sides + number
            with np.errstate(divide="ignore", invalid="ignore"):
                at = np.where(start.code == code, 0.0, (height - o[1]) / d[1])
                inside = self._encloses(o[0] + at * d[0], o[2] + at * d[2])
            there = inside & np.isfinite(at) & (d[1] != 0)
            t[:, code] = np.where(there, at + middle, np.inf)
            step[:, code] = np.where(there, np.where(sign * d[1] < 0, 1, -1), 0)
        return Crossings(t, step, np.broadcast_to(np.arange(self.codes), shape))

    def _encloses(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Whether the outline encloses points: a half-line along x crosses it an odd number of times.
        """
        inside = np.zeros(len(x), dtype=bool)
        for first, second in zip(self.ring[:-1], self.ring[1:]):
            if first[1] == second[1]:
                continue
            low, high = (first, second) if first[1] < second[1] else (second, first)
            at = low[0] + (z - low[1]) / (high[1] - low[1]) * (high[0] - low[0])
            inside ^= (low[1] <= z) & (z < high[1]) & (x < at)
        return inside

    def points(self, p: Vector, code: np.ndarray) -> Points:
        x, y, z = self.local(p)
        side, edge = code < self.sides, np.minimum(code, self.sides - 1)
        normals = self.normals()[code]
        n = self.outward((normals[:, 0], normals[:, 1], normals[:, 2]))
        begin = self.ring[edge]
        along = self.before[edge] + np.hypot(x - begin[:, 0], z - begin[:, 1])
        low, high = self.heights
        u = np.where(side, along / self.before[-1], z)
        return Points(n, n, u, np.where(side, (y - low) / (high - low), x), code)


class Lathe(Surface):
    """A polyline (r, y) turned about the y axis. The codes are the numbers of the segments."""

    def __init__(self, matrix: np.ndarray, points: np.ndarray) -> None:
        Surface.__init__(self, matrix)
        self.outline, self.codes = points, len(points) - 1
        self.closed = bool(points[0, 0] == 0 and points[-1, 0] == 0)
        self.along = np.diff(points, axis=0) / np.linalg.norm(np.diff(points, axis=0), axis=1)[:, None]
        self.before = _lengths(points)
        r, y = points[:, 0], points[:, 1] - points[0, 1]
        area = (r[:-1] * y[1:] - r[1:] * y[:-1]).sum()
        # 1 if the normals are (dy, -dr) in the plane (r, y), else -1.
        self.sense = -1.0 if self.closed and area < 0 else 1.0

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        low, high = float(self.outline[:, 1].min()), float(self.outline[:, 1].max())
        return np.array([0.0, 0.5 * (low + high), 0.0]), float(np.hypot(self.outline[:, 0].max(), 0.5 * (high - low)))

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        middle = _middle(o, d, start.code >= 0)
        o = tuple(o[axis] + middle * d[axis] for axis in range(3))
        t, step, code = [], [], []
        for number in range(self.codes):
            here = start.code == number
            flat = self.outline[number, 1] == self.outline[number + 1, 1]
            for at, way in (self._flat if flat else self._cone)(number, o, d, here, start.outward):
                there = np.isfinite(at)
                t.append(np.where(there, at + middle, np.inf))
                step.append(np.where(there, way, 0))
                code.append(np.full(len(middle), number))
        return Crossings(np.column_stack(t), np.column_stack(step), np.column_stack(code))

    def _flat(self, number: int, o: Vector, d: Vector, here: np.ndarray, outward: np.ndarray) -> List[Tuple[np.ndarray, np.ndarray]]:
        (r, y), (s, _) = self.outline[number], self.outline[number + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.where(here, 0.0, (y - o[1]) / d[1])
            x, z = o[0] + at * d[0], o[2] + at * d[2]
            out = np.sqrt(x * x + z * z)
            there = here | (min(r, s) <= out) & (out < max(r, s))
        up = -self.sense * self.along[number, 0] * d[1]
        return [(np.where(there & (d[1] != 0), at, np.inf), np.where(up < 0, 1, -1))]

    def _cone(self, number: int, o: Vector, d: Vector, here: np.ndarray, outward: np.ndarray) -> List[Tuple[np.ndarray, np.ndarray]]:
        """Roots of f = dy² (x² + z²) - (dy r + dr (y - y_k))², which grows away from the axis."""
        (r, y), (dr, dy) = self.outline[number], self.along[number]
        turned = self.sense * dy < 0
        radius, rise = dy * r + dr * (o[1] - y), dr * d[1]
        c2 = dy * dy * (d[0] * d[0] + d[2] * d[2]) - rise * rise
        c1 = dy * dy * (o[0] * d[0] + o[2] * d[2]) - radius * rise
        c0 = np.where(here, 0.0, dy * dy * (o[0] * o[0] + o[2] * o[2]) - radius * radius)
        away = outward ^ turned
        c1 = np.where(here, np.where(away, np.maximum(c1, 0.0), np.minimum(c1, 0.0)), c1)
        inner = c1 * c1 - c2 * c0
        with np.errstate(divide="ignore", invalid="ignore"):
            q = -(c1 + np.where(c1 < 0, -1.0, 1.0) * np.sqrt(np.maximum(inner, 0.0)))
            # f grows at one of them and falls at the other.
            grows, falls = np.where(c1 < 0, q / c2, c0 / q), np.where(c1 < 0, c0 / q, q / c2)
        grows, falls = (np.where((inner > 0) & np.isfinite(root), root, np.inf) for root in (grows, falls))
        low, high = sorted((y, self.outline[number + 1, 1]))
        found = []
        for root, starts, way in ((grows, here & away, -1), (falls, here & ~away, 1)):
            with np.errstate(invalid="ignore"):
                height = o[1] + root * d[1]
            root = np.where((low <= height) & (height < high), root, np.inf)
            # One root is the start.
            found.append((np.where(starts, 0.0, root), np.full(len(root), -way if turned else way)))
        return found

    def points(self, p: Vector, code: np.ndarray) -> Points:
        x, y, z = self.local(p)
        out = np.sqrt(x * x + z * z)
        begin, along = self.outline[code], self.along[code]
        size = np.diff(self.before)[code]
        share = np.clip((out - begin[:, 0]) * along[:, 0] + (y - begin[:, 1]) * along[:, 1], 0.0, size)
        divisor = np.where(out > 0, out, 1.0)
        side = self.sense * along[:, 1] / divisor
        n = self.outward((side * x, -self.sense * along[:, 0], side * z))
        return Points(n, n, turn(z, x), (self.before[code] + share) / self.before[-1], code)


class ClosedMesh(Surface):
    """A closed mesh as an operand: inside is where its winding number is positive."""

    def __init__(self, matrix: np.ndarray, corners: np.ndarray, uvs: np.ndarray, normals: Optional[np.ndarray], attributes: Any = None) -> None:
        """Per triangle and vertex: positions (n, 3, 3), texture coordinates (n, 3, 2), normals (n,
        3, 3) in object space. `attributes` are those of `vertices`.
        """
        Surface.__init__(self, matrix)
        self.corners, self.uvs, self.normals, self.codes = corners, uvs, normals, len(corners)
        self.attributes = attributes
        self.across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        self.middle = 0.5 * (low + high)

    def own_bounds(self) -> Tuple[np.ndarray, float]:
        return self.middle, float(np.linalg.norm(self.corners - self.middle, axis=2).max())

    def crossings(self, o: Vector, d: Vector, start: Start) -> Crossings:
        o, d = self.local(o), self.local(d, False)
        count = len(o[0])
        step = max(1, PAIRS // self.codes)
        found = [self._pairs([axis[first : first + step] for axis in (*o, *d)], first) for first in range(0, count, step)]
        lane, t, code, way = (np.concatenate([part[number] for part in found]) for number in range(4))
        # The start is at 0; if rounding lost it, it cannot be recovered.
        t = np.where(start.code[lane] == code, 0.0, t)
        order = np.lexsort((code, t, lane))
        lane, t, code, way = lane[order], t[order], code[order], way[order]
        place = np.arange(len(lane)) - np.searchsorted(lane, lane)
        shape = (count, max(int(place.max(initial=-1)) + 1, 1))
        result = Crossings(np.full(shape, np.inf), np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64))
        result.t[lane, place], result.step[lane, place], result.code[lane, place] = t, way, code
        return result

    def _pairs(self, rays: List[np.ndarray], first: int) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(ray, t, triangle, step) of all crossings of some rays."""
        o, d = [axis[:, None] for axis in rays[:3]], [axis[:, None] for axis in rays[3:]]
        # Vertices relative to the ray origin, sheared along its direction, so that the ray is the
        # axis. Two triangles that share an edge compute the same numbers for it, so no ray slips
        # between them.
        longest = np.argmax(np.abs(np.column_stack(rays[3:])), axis=1)[:, None]

        def along(vector: List[np.ndarray], offset: int) -> np.ndarray:
            return np.choose((longest + offset) % 3, vector)

        depth = along(d, 0)
        shear_x, shear_y = along(d, 1) / depth, along(d, 2) / depth
        x, y, z = [], [], []
        for corner in range(3):
            moved = [self.corners[None, :, corner, axis] - o[axis] for axis in range(3)]
            height = along(moved, 0)
            x.append(along(moved, 1) - shear_x * height)
            y.append(along(moved, 2) - shear_y * height)
            z.append(height / depth)
        e = [x[(k + 1) % 3] * y[(k + 2) % 3] - y[(k + 1) % 3] * x[(k + 2) % 3] for k in range(3)]
        total = e[0] + e[1] + e[2]
        hit = ((e[0] >= 0) & (e[1] >= 0) & (e[2] >= 0) | (e[0] < 0) & (e[1] < 0) & (e[2] < 0)) & (total != 0)
        ray, triangle = np.nonzero(hit)
        weights = [part[hit] / total[hit] for part in e]
        t = sum(weight * height[hit] for weight, height in zip(weights, z))
        facing = sum(self.across[triangle, axis] * rays[3 + axis][ray] for axis in range(3))
        return ray + first, t, triangle, np.where(facing < 0, 1, -1)

    def points(self, p: Vector, code: np.ndarray) -> Points:
        p = np.column_stack(self.local(p))
        corners, across = self.corners[code], self.across[code]
        size = np.einsum("ij,ij->i", across, across)
        weights = []
        for corner in range(3):
            part = np.cross(corners[:, (corner + 1) % 3] - p, corners[:, (corner + 2) % 3] - p)
            weights.append(np.einsum("ij,ij->i", part, across) / size)
        weight = np.column_stack(weights)[:, :, None]
        uv = (weight * self.uvs[code]).sum(axis=1)
        n_g = self.outward((across[:, 0], across[:, 1], across[:, 2]))
        n_s = n_g
        if self.normals is not None:
            n = (weight * self.normals[code]).sum(axis=1)
            # If there is no normal, use that of the triangle.
            n = np.where((n == 0).all(axis=1)[:, None], across, n)
            n_s = self.outward((n[:, 0], n[:, 1], n[:, 2]))
        return Points(n_g, n_s, uv[:, 0], uv[:, 1], code)
