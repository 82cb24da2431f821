"""Keys of the shapes that the driver intersects itself (model §9): cylinder, cone, ... and csg."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np

from . import surfaces, transforms
from .fields import REQUIRED, Fields, is_number, nearest
from .files import Folder
from .solids import DIFFERENCE, INTERSECTION, UNION, Solid
from .surfaces import Surface

MAX_OPERANDS = 256
MAX_NESTING = 16
MAX_VERTICES = 4096

# Level sets, whose twins are in POV-Ray.
LEVEL_SETS = ("isosurface", "implicit", "fractal")


def _positive(number: float) -> bool:
    return number > 0


def scaled(matrix: np.ndarray, centre: Any, radii: Any) -> np.ndarray:
    """The matrix of the unit sphere, scaled to these radii and moved to `centre`."""
    placed = matrix.copy()
    placed[:3, 3] = matrix[:3, :3] @ np.asarray(centre, dtype=float) + matrix[:3, 3]
    placed[:3, :3] = matrix[:3, :3] * np.asarray(radii, dtype=float)
    return placed


def similar(fields: Fields, place: Any) -> None:
    """Checks the model's rule on the transforms of sphere, plane and torus."""
    if transforms.similarity_scale(place.own) is None:
        fields.error("transform", "must be a similarity (rotation, reflection, translation, one scale for all axes)")


def _range(fields: Fields, default: Tuple[float, float]) -> Tuple[float, float]:
    low, high = fields.vector("z", default, 2)
    if not low < high:
        if fields.has("z"):
            fields.error("z", f"expected [z0, z1] with z0 < z1, found [{low}, {high}]")
        return default
    return low, high


def _caps(fields: Fields) -> bool:
    value = fields.take("caps", True)
    if not isinstance(value, bool):
        fields.error("caps", f"expected true or false, found {value!r}")
        return True
    return value


def _ellipsoid(fields: Fields, place: Any, base: Folder) -> Surface:
    radii = fields.vector("radii", (1.0, 1.0, 1.0))
    if not min(radii) > 0:
        fields.error("radii", f"expected radii > 0, found {list(radii)}")
        radii = (1.0, 1.0, 1.0)
    return surfaces.Ball(scaled(place.world, (0, 0, 0), radii))


def cylinder(fields: Fields, place: Any, base: Folder) -> surfaces.Round:
    """The surface of a cylinder."""
    radius, z = fields.number("radius", 1.0, _positive, "a radius > 0"), _range(fields, (-1.0, 1.0))
    return surfaces.Round(place.world, (0.0, 0.0, radius * radius), z, _caps(fields))


def _cone(fields: Fields, place: Any, base: Folder) -> Surface:
    radii, z = fields.vector("radii", (1.0, 0.0), 2), _range(fields, (0.0, 1.0))
    if min(radii) < 0 or max(radii) == 0:
        fields.error("radii", f"expected radii >= 0, not both 0, found {list(radii)}")
        radii = (1.0, 0.0)
    slope = (radii[1] - radii[0]) / (z[1] - z[0])
    at_zero = radii[0] - slope * z[0]
    return surfaces.Round(place.world, (slope * slope, slope * at_zero, at_zero * at_zero), z, _caps(fields))


def _paraboloid(fields: Fields, place: Any, base: Folder) -> Surface:
    radius, z = fields.number("radius", 1.0, _positive, "a radius > 0"), _range(fields, (0.0, 1.0))
    if z[0] < 0:
        fields.error("z", f"expected z0 >= 0, found {z[0]}")
        z = (0.0, 1.0)
    return surfaces.Round(place.world, (0.0, 0.5 * radius * radius, 0.0), z, _caps(fields))


def _hyperboloid(fields: Fields, place: Any, base: Folder) -> Surface:
    radius, slope = fields.number("radius", 0.5, _positive, "a radius > 0"), fields.number("slope", 1.0, _positive, "a slope > 0")
    return surfaces.Round(place.world, (slope * slope, 0.0, radius * radius), _range(fields, (-1.0, 1.0)), _caps(fields))


def _form(fields: Fields) -> np.ndarray:
    """The symmetric 4x4 matrix of a quadric."""
    usual = np.diag([1.0, 1.0, 1.0, -1.0])
    if fields.has("matrix") == fields.has("coefficients"):
        fields.error(None, "expected exactly one of `matrix`, `coefficients`")
        fields.take("matrix")
        fields.take("coefficients")
        return usual
    if fields.has("matrix"):
        rows = fields.vectors("matrix", 4, 4)
        form = usual if rows is None else np.array(rows)
        if not np.array_equal(form, form.T):
            fields.error("matrix", "must be symmetric")
            return usual
    else:
        a, b, c, d, e, f, g, h, i, j = fields.vector("coefficients", None, 10)
        form = np.array([[2 * a, d, e, g], [d, 2 * b, f, h], [e, f, 2 * c, i], [g, h, i, 2 * j]]) / 2
    others = form.copy()
    others[3, 3] = 0
    if not np.any(others):
        fields.error(None, "all coefficients except the constant one are 0")
        return usual
    if not _real(form):
        fields.error(None, "the quadric has no real points")
        return usual
    return form


def _real(form: np.ndarray) -> bool:
    """Whether the quadric has real points: its function takes both signs, or 0 as an extremum."""
    values, axes = np.linalg.eigh(form[:3, :3])
    linear = axes.T @ form[:3, 3]
    size = np.abs(form).max()
    flat = np.abs(values) <= 1e-14 * size
    if np.any(flat & (np.abs(linear) > 1e-14 * size)) or (values[~flat].min(initial=1) < 0 < values[~flat].max(initial=-1)):
        return True
    extreme = form[3, 3] - np.sum(linear[~flat] ** 2 / values[~flat])
    return bool(extreme * values[~flat][0] <= 1e-14 * size * abs(values[~flat][0]))


def _quadric(fields: Fields, place: Any, base: Folder) -> Surface:
    form = _form(fields)
    rows = fields.vectors("box", 2, 3, [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    box = np.array(rows or [(-1.0,) * 3, (1.0,) * 3])
    if not np.all(box[0] < box[1]):
        fields.error("box", "expected [min, max] with min < max along each axis")
        box = np.array([[-1.0] * 3, [1.0] * 3])
    return surfaces.Quadric(place.world, form, box, _caps(fields))


def _torus(fields: Fields, place: Any, base: Folder) -> Surface:
    similar(fields, place)
    major = fields.number("major_radius", 1.0, _positive, "a radius > 0")
    minor = fields.number("minor_radius", 0.25, _positive, "a radius > 0")
    if not minor < major:
        fields.error("minor_radius", f"must be less than `major_radius` = {major}, found {minor}")
        major, minor = 1.0, 0.25
    return surfaces.Torus(place.world, major, minor)


def _points(fields: Fields, key: str) -> np.ndarray:
    rows = fields.take(key, REQUIRED)
    good = isinstance(rows, list) and 3 <= len(rows) <= MAX_VERTICES
    good = good and all(isinstance(row, list) and len(row) == 3 and all(map(is_number, row)) for row in rows)
    if not good:
        if rows is not None:
            fields.error(key, f"expected 3 to {MAX_VERTICES} points of three finite numbers each")
        return np.eye(3)
    return np.array(rows, dtype=float)


def edges_meet(vertices: np.ndarray, closed: bool = True) -> bool:
    """Whether the edges of a polyline in the plane, (n, 2) points, intersect anywhere but at the
    end points of consecutive edges. A closed one returns to its first point.
    """
    a, b = vertices, np.roll(vertices, -1, axis=0)
    if not closed:
        a, b = a[:-1], b[:-1]
    if np.any(np.all(a == b, axis=1)):
        return True

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.sign((q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0]))

    def within(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.all((np.minimum(p, q) <= r) & (r <= np.maximum(p, q)), axis=-1)

    count = len(a)
    for number in range(count - 1):
        # Consecutive edges meet in one point, unless the second folds back.
        following = (number + 1) % count
        if side(a[number], b[number], b[following]) == 0 and np.dot(b[number] - a[number], b[following] - b[number]) < 0:
            return True
        others = np.arange(number + 2, count - 1 if closed and number == 0 else count)
        if len(others) == 0:
            continue
        p, q, r, s = a[number], b[number], a[others], b[others]
        first, second = side(p, q, r), side(p, q, s)
        third, fourth = side(r, s, p), side(r, s, q)
        meet = (first * second < 0) & (third * fourth < 0)
        meet |= (first == 0) & within(p, q, r) | (second == 0) & within(p, q, s)
        meet |= (third == 0) & within(r, s, p) | (fourth == 0) & within(r, s, q)
        if np.any(meet):
            return True
    last = count - 1
    return closed and bool(side(a[last], b[last], b[0]) == 0 and np.dot(b[last] - a[last], b[0] - b[last]) < 0)


def _polygon(fields: Fields, place: Any, base: Folder) -> Surface:
    vertices = _points(fields, "vertices")
    middle = vertices.mean(axis=0)
    q = vertices - middle
    normal = np.cross(q, np.roll(q, -1, axis=0)).sum(axis=0)
    diagonal = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    length = float(np.linalg.norm(normal))
    if length <= 1e-9 * diagonal * diagonal:
        fields.error("vertices", "the polygon has no area, or its edges cross")
        return surfaces.Flat(place.world, "disk")
    if np.abs(q @ (normal / length)).max() > 1e-9 * diagonal:
        fields.error("vertices", "must lie in a plane")
    found = surfaces.Polygon(place.world, vertices, normal)
    if edges_meet(vertices[:, [(found.axis + 1) % 3, (found.axis + 2) % 3]]):
        fields.error("vertices", "edges must not intersect except at their common vertices")
    return found


def _outline(fields: Fields, least: int, closed: bool, default: List[List[float]]) -> np.ndarray:
    """The points of an outline."""
    rows = fields.take("outline", REQUIRED)
    good = isinstance(rows, list) and least <= len(rows) <= MAX_VERTICES
    good = good and all(isinstance(row, list) and len(row) == 2 and all(map(is_number, row)) for row in rows)
    if not good:
        if rows is not None:
            fields.error("outline", f"expected {least} to {MAX_VERTICES} points of two finite numbers each")
        return np.array(default)
    points = np.array(rows, dtype=float)
    if edges_meet(points, closed):
        fields.error("outline", "edges must not intersect except at their common points")
        return np.array(default)
    return points


def _has_area(points: np.ndarray) -> bool:
    """Whether a closed outline encloses more than rounding."""
    q, size = points - points[0], points.max(axis=0) - points.min(axis=0)
    following = np.roll(q, -1, axis=0)
    twice = float((q[:, 0] * following[:, 1] - following[:, 0] * q[:, 1]).sum())
    return abs(twice) > 1e-9 * float(size @ size)


def _prism(fields: Fields, place: Any, base: Folder) -> Surface:
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    points = _outline(fields, 3, True, square)
    if not _has_area(points):
        fields.error("outline", "encloses no area")
        points = np.array(square)
    low, high = fields.vector("y", (0.0, 1.0), 2)
    if not low < high:
        fields.error("y", f"expected [y0, y1] with y0 < y1, found [{low}, {high}]")
        low, high = 0.0, 1.0
    return surfaces.Prism(place.world, points, (low, high))


def _lathe(fields: Fields, place: Any, base: Folder) -> Surface:
    tube = [[1.0, 0.0], [1.0, 1.0]]
    points = _outline(fields, 2, False, tube)
    r = points[:, 0]
    if r.min() < 0:
        fields.error("outline", f"expected distances from the axis of at least 0, found {r.min()}")
    elif np.any((r[:-1] == 0) & (r[1:] == 0)):
        fields.error("outline", "a segment lies on the axis")
    elif r[0] == 0 and r[-1] == 0 and not _has_area(points):
        fields.error("outline", "encloses no area with the axis")
    else:
        return surfaces.Lathe(place.world, points)
    return surfaces.Lathe(place.world, np.array(tube))


READERS: Dict[str, Callable[[Fields, Any, Folder], Surface]] = {
    "ellipsoid": _ellipsoid,
    "cylinder": cylinder,
    "cone": _cone,
    "paraboloid": _paraboloid,
    "hyperboloid": _hyperboloid,
    "quadric": _quadric,
    "torus": _torus,
    "polygon": _polygon,
    "prism": _prism,
    "lathe": _lathe,
}

_SOLIDS = ("ellipsoid", "cylinder", "cone", "paraboloid", "hyperboloid", "quadric", "torus", "prism", "lathe")


def _sphere_operand(fields: Fields, place: Any, base: Folder) -> Surface:
    similar(fields, place)
    centre = fields.vector("center", (0.0, 0.0, 0.0))
    return surfaces.Ball(scaled(place.world, centre, fields.number("radius", 1.0, _positive, "a radius > 0")))


def _plane_operand(fields: Fields, place: Any, base: Folder) -> Surface:
    similar(fields, place)
    return surfaces.HalfSpace(place.world)


class Csg:
    """Reads csg. `mesh` reads a triangle mesh: (positions, uvs, normals, attributes) of its
    vertices, or None on errors.
    """

    def __init__(self, mesh: Callable[[Fields, Any, Folder], Optional[Tuple[np.ndarray, np.ndarray, Optional[np.ndarray], Any]]]) -> None:
        self.mesh = mesh

    def read(self, fields: Fields, place: Any, base: Folder, depth: int = 1) -> Surface:
        operation = fields.choice("operation", REQUIRED, (UNION, INTERSECTION, DIFFERENCE))
        tables = fields.take("operands", REQUIRED)
        nothing = surfaces.Ball(place.world)
        if tables is None:
            return nothing
        if not isinstance(tables, list) or not 2 <= len(tables) <= MAX_OPERANDS:
            fields.error("operands", f"expected a list of 2 to {MAX_OPERANDS} shapes")
            return nothing
        if depth > MAX_NESTING:
            fields.error("operands", f"operands are nested more than {MAX_NESTING} deep")
            return nothing
        where = f"{fields.where}.operands"
        found = [self.operand(Fields(table, f"{where}[{n}]", fields.errors), place, base, depth) for n, table in enumerate(tables)]
        return Solid(operation, found)

    def operand(self, fields: Fields, around: Any, base: Folder, depth: int) -> Surface:
        kind = fields.kind()
        own = transforms.read(fields.take("transform"), f"{fields.where}.transform", fields.errors)
        place = replace(around, own=around.own @ own)
        surface: Surface = surfaces.Ball(place.world)
        known: List[str] = [*_SOLIDS, "sphere", "plane", "box", "mesh", "csg", *LEVEL_SETS]
        if kind in LEVEL_SETS:
            around.unsupported.append(f"{fields.where}: no twin for an operand of type {kind!r}")
            return surface
        if kind not in known:
            if kind is not None:
                fields.error("type", f"{kind!r} is not a closed shape; {nearest(kind, known)}")
            return surface
        if kind == "csg":
            surface = self.read(fields, place, base, depth + 1)
        elif kind == "mesh":
            triangles = self.mesh(fields, place, base)
            if triangles is not None:
                # A union of one operand: inside is where the winding number of the mesh is
                # positive.
                surface = Solid(UNION, [surfaces.ClosedMesh(place.world, *triangles)])
        elif kind == "sphere":
            surface = _sphere_operand(fields, place, base)
        elif kind == "plane":
            surface = _plane_operand(fields, place, base)
        elif kind == "box":
            surface = surfaces.Box(place.world)
        else:
            surface = READERS[kind](fields, place, base)
        fields.close()
        if not surface.closed:
            if kind == "lathe":
                fields.error("outline", "an operand must be closed: begin and end on the axis, at r = 0")
            else:
                fields.error("caps", "an operand must be closed: set `caps = true`")
        return surface
