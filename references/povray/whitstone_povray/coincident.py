"""Coincident surfaces of different shapes (model §9): finds them, orders them and separates them by
gaps.

Each shape describes its flat faces, and its round side if it has one, as an `Outline`. `separate`
compares the outlines of all placed shapes and returns one affine map per shape that has to move.
"""

from __future__ import annotations

import bisect
import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from .transforms import IDENTITY, Matrix, cross, dot, normal, point, similarity, sub

Vector = Sequence[float]

# Width of a gap in POV-Ray's units. POV-Ray 3.7 ignores hits closer than 1e-4 along a ray, and
# blockers closer than 1e-3 along a shadow ray. A ray crosses a gap along at least its width, so
# twice the larger threshold suffices at all angles.
GAP = 2e-3
# POV-Ray stores the vertices of `mesh2` in single precision: a gap next to a mesh is wider by this
# part of the coordinates, two units in the last place.
MESH_GAP = 2.0**-22
# Surfaces at most this far apart coincide, relative to the largest coordinate: 16 ulp.
TOLERANCE = 16 * 2.0**-52
# A shape does not move a face by more than this part of its own extent along the motion.
MOST_INSET = 1 / 256
# Overlaps below this part of the smaller face have no area: rounding makes slivers along common
# edges.
NO_AREA = 1e-9
# Upper bounds on the faces near other shapes, as in the model, and on the pairs of such faces whose
# planes are equally far from the origin.
MAX_FACES = 10000
MAX_PAIRS = 200000
# Corners of the polygon that represents a disk.
_CORNERS = 64


@dataclass(frozen=True)
class Flat:
    """A flat face in object space: a simple polygon, or an infinite plane if it has no corners."""

    corners: Tuple[Vector, ...]
    # n_g, of any length.
    normal: Vector
    # The axis and the end (0 low, 1 high) of `Outline.ends` that this face lies on.
    end: Optional[Tuple[int, int]] = None


@dataclass(frozen=True)
class Round:
    """A sphere, or the side of a cylinder about z with two heights."""

    center: Vector
    radius: float
    heights: Optional[Vector] = None


@dataclass(frozen=True)
class Outline:
    """The surfaces of a shape that may coincide with those of others."""

    # Points whose convex hull contains all flat faces.
    points: Sequence[Vector]
    flats: Callable[[], Sequence[Flat]]
    # A solid or a closed mesh.
    closed: bool
    # The lowest and the highest corner of a shape that can be stretched along its axes.
    ends: Optional[Tuple[Vector, Vector]] = None
    round: Optional[Round] = None
    # Whether other surfaces of it move along if a face does: so it stays if it can.
    rigid: bool = False
    # Whether POV-Ray stores its vertices in single precision.
    single: bool = False


@dataclass(frozen=True)
class Placed:
    """A shape at its place in the world."""

    outline: Optional[Outline]
    # `world_from_object`, with the transforms of all enclosing instances.
    matrix: Matrix
    # Sorts like shape_id: the group ("" for none), the position in its list, and the order of
    # instances.
    rank: Tuple[str, int, int]
    # Index of the shape, or of the outermost instance, in the list of the document.
    index: int

    @property
    def outlined(self) -> Outline:
        """The outline of a shape that has one, as all shapes with faces do."""
        assert self.outline is not None
        return self.outline


# A map of object space that precedes the shape's transform, and one of world space that follows it.
Moves = Tuple[Matrix, Matrix]
STAYS: Moves = (IDENTITY, IDENTITY)


def disk(radius: float, height: float, up: float, end: Optional[Tuple[int, int]] = None) -> Flat:
    """A disk about the z axis, with its normal along z times `up`."""
    turns = [2 * math.pi * k / _CORNERS for k in range(_CORNERS)]
    return Flat(tuple((radius * math.cos(t), radius * math.sin(t), height) for t in turns), (0.0, 0.0, up), end)


def sheet(corners: Sequence[Vector], n: Vector) -> Outline:
    """An open flat shape."""
    flat = Flat(tuple(corners), n)
    return Outline(flat.corners, lambda: (flat,), False)


def box() -> Outline:
    """The box from -1 to 1."""
    flats = []
    for axis in range(3):
        for end, sign in enumerate((-1.0, 1.0)):
            ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            corners = tuple(tuple([*pair[:axis], sign, *pair[axis:]]) for pair in ring)
            flats.append(Flat(corners, [sign * (k == axis) for k in range(3)], (axis, end)))
    points = [corner for flat in flats[:2] for corner in flat.corners]
    return Outline(points, lambda: flats, True, ((-1.0,) * 3, (1.0,) * 3))


def capped(z: Vector, radii: Vector, caps: bool, side: bool) -> Outline:
    """A shape about the z axis between two heights; `side` if it is a cylinder."""
    flats = [disk(r, h, (-1.0, 1.0)[end], (2, end)) for end, (h, r) in enumerate(zip(z, radii)) if caps and r > 0]
    points = [corner for flat in flats for corner in flat.corners]
    wide = max(radii)
    around = Round((0.0, 0.0, 0.0), wide, tuple(z)) if side else None
    return Outline(points, lambda: flats, caps, ((-wide, -wide, z[0]), (wide, wide, z[1])), round=around)


def ball(center: Vector, radius: float) -> Outline:
    """A sphere."""
    return Outline((), lambda: (), True, round=Round(center, radius))


def mesh(positions: Sequence[Vector], faces: Sequence[Sequence[int]]) -> Outline:
    """A mesh. It is closed if each edge runs as often in both directions."""
    edges: Counter = Counter()
    for a, b, c in (tuple(tuple(positions[k]) for k in face) for face in faces):
        edges.update([(a, b), (b, c), (c, a)])

    def flats() -> List[Flat]:
        rings = [tuple(positions[k] for k in face) for face in faces]
        return [Flat(ring, cross(sub(ring[1], ring[0]), sub(ring[2], ring[0]))) for ring in rings]

    closed = all(edges[b, a] == count for (a, b), count in edges.items())
    return Outline(positions, flats, closed, rigid=True, single=True)


def combined(operands: Sequence[Tuple[Optional[Outline], Matrix]], difference: bool) -> Outline:
    """A csg of operands, each with its transform. All flat faces of its operands count, except
    planes. They count even where the operation removes them: an unnecessary gap does no harm.
    """
    known = [(outline, matrix, difference and k > 0) for k, (outline, matrix) in enumerate(operands) if outline]

    def flats() -> List[Flat]:
        found = []
        for outline, matrix, flipped in known:
            for flat in outline.flats() if outline.points else ():
                n = [-c if flipped else c for c in normal(matrix, flat.normal)]
                found.append(Flat(tuple(point(matrix, corner) for corner in flat.corners), n))
        return found

    points = [point(matrix, p) for outline, matrix, _ in known for p in outline.points]
    return Outline(points, flats, True, rigid=True, single=any(outline.single for outline, _, _ in known))


@dataclass
class _Face:
    """A surface in world space."""

    # Position of its shape, by rank.
    owner: int
    form: str
    # Along the normal: of a flat face n_g, of a round one outwards.
    normal: Vector
    corners: Tuple[Vector, ...]
    end: Optional[Tuple[int, int]]
    # A point of it; the centre of a round one.
    at: Vector
    radius: float = 0.0
    # Which set of surfaces that coincide, directly or through others, it belongs to.
    component: int = -1
    # Whether its own normal is opposite to the common one.
    against: bool = False
    # How far it moves along its normal, in metres.
    moves: float = 0.0


def _largest(points: Sequence[Vector]) -> float:
    return max((abs(c) for p in points for c in p), default=0.0)


def _flattened(corners: Sequence[Vector], origin: Vector, u: int, v: int) -> List[Vector]:
    """Two coordinates of points, relative to an origin."""
    return [(p[u] - origin[u], p[v] - origin[v]) for p in corners]


def _overlap(a: _Face, b: _Face) -> List[Vector]:
    """The points of a's plane that bound the common region of two polygons; empty if it has no
    area.

    b is a fan of triangles with signed areas, so neither polygon has to be convex.
    """
    left_out = max(range(3), key=lambda k: abs(a.normal[k]))
    u, v = (left_out + 1) % 3, (left_out + 2) % 3

    def area(ring: Sequence[Vector]) -> float:
        return 0.5 * sum(p[0] * q[1] - p[1] * q[0] for p, q in zip(ring, [*ring[1:], *ring[:1]]))

    origin = a.corners[0]
    ring_a, ring_b = (_flattened(face.corners, origin, u, v) for face in (a, b))
    total = 0.0
    found: List[Vector] = []
    for k in range(1, len(ring_b) - 1):
        triangle = [ring_b[0], ring_b[k], ring_b[k + 1]]
        size = area(triangle)
        ring = ring_a
        for p, q in zip(triangle, triangle[1:] + triangle[:1]):
            ring = _clip(ring, p, q, math.copysign(1.0, size))
        total += math.copysign(abs(area(ring)), size) if ring else 0.0
        found += ring
    if abs(total) <= NO_AREA * min(abs(area(ring_a)), abs(area(ring_b))):
        return []
    n = a.normal
    lifted: List[Vector] = []
    for s, t in found:
        p = [0.0, 0.0, 0.0]
        p[u], p[v] = origin[u] + s, origin[v] + t
        p[left_out] = origin[left_out] - (n[u] * s + n[v] * t) / n[left_out]
        lifted.append(p)
    return lifted


def _clip(ring: List[Vector], p: Vector, q: Vector, side: float) -> List[Vector]:
    """The part of a polygon to the left of the line from p to q (to the right, if `side` is -1)."""
    heights = [side * ((q[0] - p[0]) * (c[1] - p[1]) - (q[1] - p[1]) * (c[0] - p[0])) for c in ring]
    kept: List[Vector] = []
    for k, corner in enumerate(ring):
        before, h, g = ring[k - 1], heights[k], heights[k - 1]
        if (g < 0) != (h < 0):
            t = g / (g - h)
            kept.append((before[0] + t * (corner[0] - before[0]), before[1] + t * (corner[1] - before[1])))
        if h >= 0:
            kept.append(corner)
    return kept


def _meet(a: _Face, b: _Face) -> bool:
    """Whether two flat faces coincide."""
    if not a.corners:
        a, b = b, a
    twist, size = math.hypot(*cross(a.normal, b.normal)), _largest(a.corners + b.corners)
    if twist > 1e-9:
        return False
    if not a.corners:
        # Two planes: the points nearest to the origin.
        feet = [[dot(face.at, face.normal) * c for c in face.normal] for face in (a, b)]
        return twist <= TOLERANCE and math.dist(*feet) <= TOLERANCE * _largest(feet)
    if abs(dot(b.normal, sub(a.at, b.at))) > 1e-8 * size:
        return False
    region = _overlap(a, b) if b.corners else a.corners
    return bool(region) and max(abs(dot(b.normal, sub(p, b.at))) for p in region) <= TOLERANCE * size


def _equal(a: _Face, b: _Face) -> bool:
    """Whether two spheres, or the sides of two cylinders, coincide."""
    size = max(_largest((a.at, b.at, *a.corners, *b.corners)), a.radius, b.radius)
    near = TOLERANCE * size
    if a.form != b.form or abs(a.radius - b.radius) > near:
        return False
    if a.form == "sphere":
        return math.dist(a.at, b.at) <= near
    away = [sub(p, a.at) for p in b.corners]
    heights = [dot(a.normal, p) for p in away]
    beside = max(math.hypot(*sub(p, [h * c for c in a.normal])) for p, h in zip(away, heights))
    own = [dot(a.normal, sub(p, a.at)) for p in a.corners]
    return beside <= near and min(max(own), max(heights)) - max(min(own), min(heights)) > near


def _rounded(shape: Placed, owner: int) -> Optional[_Face]:
    """The round surface of a shape in world space, if it is still round there."""
    form, matrix = shape.outlined.round, shape.matrix
    assert form is not None, "the caller checks that there is a round side"
    across = [math.hypot(*(row[k] for row in matrix)) for k in range(3)]
    columns = [[row[k] for row in matrix] for k in range(3)]
    at = point(matrix, form.center)
    if form.heights is None:
        return _Face(owner, "sphere", (), (), None, at, form.radius * across[0]) if similarity(matrix) else None
    right = max(abs(dot(columns[i], columns[j])) / (across[i] * across[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    if right > 1e-9 or abs(across[0] - across[1]) > 1e-9 * across[0]:
        return None
    ends = tuple(point(matrix, (0.0, 0.0, h)) for h in form.heights)
    axis = [c / across[2] for c in columns[2]]
    return _Face(owner, "cylinder", axis, ends, None, at, form.radius * across[0])


Bounds = Tuple[List[float], List[float]]


def _bounds(points: Sequence[Vector]) -> Bounds:
    room = 2 * TOLERANCE * _largest(points)
    columns = list(zip(*points))
    return [min(c) - room for c in columns], [max(c) + room for c in columns]


def _touch(a: Bounds, b: Bounds) -> bool:
    return all(a[0][k] <= b[1][k] and b[0][k] <= a[1][k] for k in range(3))


def _sweep(bounds: Dict[int, Bounds]) -> Iterator[Tuple[int, int]]:
    """Pairs of boxes that touch."""
    active: List[int] = []
    for k in sorted(bounds, key=lambda k: bounds[k][0][0]):
        active = [other for other in active if bounds[other][1][0] >= bounds[k][0][0]]
        yield from ((other, k) for other in active if _touch(bounds[other], bounds[k]))
        active.append(k)


class _TooMany(Exception):
    """Why the shapes are not examined."""


class _Search:
    """Finds the pairs of surfaces that coincide."""

    def __init__(self, shapes: Sequence[Placed]) -> None:
        self.shapes = shapes
        self.faces: List[_Face] = []
        self.pairs: List[Tuple[int, int]] = []
        # Of each face in `faces`, by identity.
        self.number: Dict[int, int] = {}
        self.flats: Dict[int, List[Tuple[_Face, Optional[Bounds]]]] = {}
        self.near: set = set()
        self.tried = 0

    def of(self, owner: int) -> List[Tuple[_Face, Optional[Bounds]]]:
        """The flat faces of a shape in world space, with their bounds."""
        if owner not in self.flats:
            shape = self.shapes[owner]
            placed: List[Tuple[_Face, Optional[Bounds]]] = []
            for flat in shape.outlined.flats():
                n = normal(shape.matrix, flat.normal)
                corners = tuple(point(shape.matrix, corner) for corner in flat.corners)
                at = corners[0] if corners else point(shape.matrix, (0.0, 0.0, 0.0))
                if any(n):
                    placed.append((_Face(owner, "plane", n, corners, flat.end, at), _bounds(corners) if corners else None))
            self.flats[owner] = placed
        return self.flats[owner]

    def add(self, one: _Face, other: _Face) -> None:
        """Notes a pair."""
        for face in (one, other):
            if id(face) not in self.number:
                self.number[id(face)] = len(self.faces)
                self.faces.append(face)
        self.pairs.append((self.number[id(one)], self.number[id(other)]))

    def compare(self, a: int, ones: Sequence[int], b: int, others: Sequence[int]) -> None:
        """Compares faces of two shapes, by their positions."""
        self.near.update([(a, k) for k in ones] if others else [], [(b, k) for k in others] if ones else [])
        if len(self.near) > MAX_FACES:
            raise _TooMany(f"more than {MAX_FACES} faces lie near other shapes")
        # Planes that coincide have equal distances from the origin.
        there = sorted(((abs(dot(face.normal, face.at)), k, face) for k, (face, _) in ((k, self.of(b)[k]) for k in others)))
        distances = [entry[0] for entry in there]
        size = max((_largest((face.at, *face.corners)) for _, _, face in there), default=0.0)
        for one in (self.of(a)[k][0] for k in ones):
            distance, room = abs(dot(one.normal, one.at)), 1e-8 * max(size, _largest((one.at, *one.corners)))
            first, last = bisect.bisect_left(distances, distance - room), bisect.bisect_right(distances, distance + room)
            self.tried += last - first
            if self.tried > MAX_PAIRS:
                raise _TooMany(f"more than {MAX_PAIRS} pairs of faces lie near each other")
            for _, _, other in there[first:last]:
                if _meet(one, other):
                    self.add(one, other)

    def run(self) -> None:
        """Compares all shapes."""
        rounded = {k: _rounded(shape, k) for k, shape in enumerate(self.shapes) if shape.outline and shape.outline.round}
        sides = {k: side for k, side in rounded.items() if side is not None}
        for a, b in _sweep({k: _bounds(side.corners or (side.at,)) for k, side in sides.items()}):
            if _equal(sides[a], sides[b]):
                self.add(sides[a], sides[b])
        world, planes = {}, []
        for k, shape in enumerate(self.shapes):
            if shape.outline and shape.outline.points:
                world[k] = [point(shape.matrix, p) for p in shape.outline.points]
            elif shape.outline and shape.outline.flats():
                planes.append(k)
        bounds = {k: _bounds(points) for k, points in world.items()}
        for number, plane in enumerate(planes):
            face = self.of(plane)[0][0]
            for other in planes[:number]:
                self.compare(other, [0], plane, [0])
            for k, points in world.items():
                near = TOLERANCE * _largest(points)
                heights = [dot(face.normal, sub(p, face.at)) for p in points]
                if min(heights) <= near and max(heights) >= -near:
                    tried = [
                        n
                        for n, (flat, _) in enumerate(self.of(k))
                        if all(abs(dot(face.normal, sub(p, face.at))) <= near for p in flat.corners)
                    ]
                    self.compare(plane, [0], k, tried)
        # Meshes with each other last: there may be too many faces.
        rigid = {k: self.shapes[k].outlined.rigid for k in bounds}
        for a, b in sorted(_sweep(bounds), key=lambda pair: rigid[pair[0]] and rigid[pair[1]]):
            ones, others = (
                [n for n, (_, box_) in enumerate(self.of(one)) if box_ and _touch(box_, bounds[other])] for one, other in ((a, b), (b, a))
            )
            self.compare(a, ones, b, others)


def _components(count: int, pairs: Sequence[Tuple[int, int]]) -> List[List[int]]:
    """Faces that coincide, directly or through others."""
    root = list(range(count))

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = root[root[k]]
            k = root[k]
        return k

    for a, b in pairs:
        root[find(a)] = find(b)
    sets: Dict[int, List[int]] = {}
    for k in range(count):
        sets.setdefault(find(k), []).append(k)
    return list(sets.values())


def separate(shapes: Sequence[Placed], scale: float) -> Tuple[Dict[int, Moves], List[Dict[str, Any]]]:
    """How the shapes move, by position, and the entries `coincident` of PROTOCOL.md."""
    positions = sorted(range(len(shapes)), key=lambda k: shapes[k].rank)
    shapes = [shapes[k] for k in positions]
    search, notes = _Search(shapes), []
    try:
        search.run()
    except _TooMany as why:
        notes.append({"not_examined": str(why)})
    faces, gaps = search.faces, []
    partners: List[List[int]] = [[] for _ in faces]
    for a, b in search.pairs:
        partners[a].append(b)
        partners[b].append(a)
    for number, members in enumerate(_components(len(faces), search.pairs)):
        along = faces[members[0]].normal
        for k in members:
            faces[k].component = number
            faces[k].against = faces[k].form == "plane" and dot(faces[k].normal, along) < 0
        single = [_largest(faces[k].corners) for k in members if shapes[faces[k].owner].outlined.single]
        gaps.append(GAP / scale + MESH_GAP * max(single, default=0.0))
        # Faces of one shape on one side form a layer. Each layer lies a gap beyond the highest one
        # that it touches.
        layers = _layers([faces[k] for k in members], shapes)
        layer_of = {id(face): n for n, layer in enumerate(layers) for face in layer}
        touched: List[set] = [set() for _ in layers]
        for k in members:
            touched[layer_of[id(faces[k])]].update(layer_of[id(faces[other])] for other in partners[k])
        levels: List[int] = []
        for n in range(len(layers)):
            levels.append(1 + max((levels[other] for other in touched[n] if other < n), default=-1))
        stays = levels[_anchor(layers, levels, shapes, gaps[-1])]
        for layer, level in zip(layers, levels):
            for face in layer:
                face.moves = (level - stays) * gaps[-1] * (-1 if face.against else 1)
    moves = {}
    of: Dict[int, List[_Face]] = {}
    for face in faces:
        of.setdefault(face.owner, []).append(face)
    for owner, own in of.items():
        found = _moves(shapes[owner], own)
        if found is None:
            for face in own:
                face.moves = 0.0
        elif found != STAYS:
            moves[positions[owner]] = found
    told: Dict[Tuple[int, int, str], Optional[float]] = {}
    for one, other in ((faces[a], faces[b]) for a, b in search.pairs):
        low, high = sorted((one, other), key=lambda face: _place(face, shapes[face.owner].outlined.closed))
        width = high.moves * (-1 if high.against else 1) - low.moves * (-1 if low.against else 1)
        first, second = sorted((shapes[one.owner].index, shapes[other.owner].index))
        key = first, second, one.form
        known = told.get(key, math.inf)
        told[key] = None if known is None or width < 0.99 * gaps[one.component] else min(known, width)
    return moves, [{"shapes": [a, b], "form": form, "gap": gap} for (a, b, form), gap in sorted(told.items())] + notes


def _place(face: _Face, closed: bool) -> Tuple[int, int]:
    """Sorts surfaces along the common normal, in the order of the model."""
    # Of the surfaces that face against the normal the first shape comes first, of others last.
    part = {(True, False): 0, (False, True): 1, (False, False): 2, (True, True): 3}[closed, face.against]
    return part, face.owner if face.against else -face.owner


def _layers(members: List[_Face], shapes: Sequence[Placed]) -> List[List[_Face]]:
    """The faces of each shape on one side, in the order of the model."""
    layers: Dict[Tuple, List[_Face]] = {}
    for face in sorted(members, key=lambda face: _place(face, shapes[face.owner].outlined.closed)):
        layers.setdefault((face.owner, face.against), []).append(face)
    return list(layers.values())


def _anchor(layers: List[List[_Face]], levels: List[int], shapes: Sequence[Placed], gap: float) -> int:
    """The layer that stays where it is: of a mesh, a csg, or a shape too thin to be inset; else of
    an open surface, planes first; else of the outermost solid.
    """
    outlines = [shapes[layer[0].owner].outlined for layer in layers]
    inset = [[replace(face, moves=gap) for face in layer] for layer in layers]
    stiff = [n for n, outline in enumerate(outlines) if outline.rigid or _moves(shapes[layers[n][0].owner], inset[n]) is None]
    if stiff:
        most = Counter(levels[n] for n in stiff).most_common(1)[0][0]
        return next(n for n in stiff if levels[n] == most)
    opened = [n for n, outline in enumerate(outlines) if not outline.closed]
    if opened:
        return min(opened, key=lambda n: (bool(layers[n][0].corners), layers[n][0].owner))
    inner = [n for n, layer in enumerate(layers) if not layer[0].against]
    return inner[-1] if inner else 0


def _moves(shape: Placed, faces: List[_Face]) -> Optional[Moves]:
    """The maps that move the faces of one shape; None if they cannot move that far."""
    outline, matrix = shape.outlined, shape.matrix
    if not any(face.moves for face in faces):
        return STAYS
    stretches = outline.ends is not None and all(face.form != "plane" or face.end for face in faces)
    if not stretches and outline.round is None:
        face = faces[0]
        if len({(other.component, other.against) for other in faces}) > 1:
            return None
        return IDENTITY, tuple((*row[:3], face.moves * c) for row, c in zip(IDENTITY, face.normal))
    factors, center = [1.0] * 3, (outline.round.center if outline.round else (0.0,) * 3)
    shifts = [0.0] * 3
    ends = [list(end) for end in outline.ends or ()]
    for face in faces:
        if face.form != "plane":
            if abs(face.moves) > MOST_INSET * face.radius:
                return None
            for axis in range(3 if face.form == "sphere" else 2):
                factors[axis] = 1 + face.moves / face.radius
                shifts[axis] = center[axis] * (1 - factors[axis])
            continue
        assert face.end is not None and outline.ends is not None, "the other shapes have round sides only"
        axis, end = face.end
        # Metres along the normal per unit of object space.
        per_unit = abs(dot(face.normal, [row[axis] for row in matrix]))
        if abs(face.moves) > MOST_INSET * per_unit * (outline.ends[1][axis] - outline.ends[0][axis]):
            return None
        ends[end][axis] += (-1, 1)[end] * face.moves / per_unit
    if outline.ends:
        for axis in {face.end[0] for face in faces if face.end}:
            (low, high), (new_low, new_high) = ((e[0][axis], e[1][axis]) for e in (outline.ends, ends))
            factors[axis] = (new_high - new_low) / (high - low)
            shifts[axis] = new_low - factors[axis] * low
    inner = tuple(tuple([factors[r] if r == c else 0.0 for c in range(3)] + [shifts[r]]) for r in range(3))
    return inner, IDENTITY
