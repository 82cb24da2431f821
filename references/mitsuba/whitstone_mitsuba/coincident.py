"""Coincident surfaces of different shapes (model §9): such shapes are rebuilt with gaps between
them.

The model gives the order along the common normal. Each flat face in a class of coincident faces
moves along its normal by a number of gaps: closed shapes are inset, and one of the open surfaces
stays. A gap is 2^-19 of the coordinates, which is 8 times the spawn offset (`spawn`). So neither
float32 rounding nor that offset takes a ray across it. Scenes without coincident surfaces are built
once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cmp_to_key
from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from . import surfaces
from .solids import Solid

# Width of a gap, relative to the largest coordinate of the surfaces plus this coordinate (but at
# most 1 m).
GAP = 2.0**-19
# Planes at most this far apart coincide, relative to the largest coordinate (model §9).
APART = 16 * 2.0**-52
# Upper bounds on the faces near other shapes that are compared, and on pairs of them.
MOST_FACES, MOST_PAIRS = 10000, 50000
# A lamp lies in a plane at most this far away, relatively; shadow rays may arrive at a grazing
# angle.
NEAR_LAMP = 64 * 2.0**-52
SLANT = 64.0
# Planes are sorted by a key; those whose keys differ by less than this, relatively, are compared.
ALIKE = 1e-10
# Vertices of the polygon that approximates a disk.
ROUND = 48


@dataclass
class Face:
    """A flat face in world space: its outward normal, and its vertices (a single point for a
    plane).
    """

    # Part of the shape: axis and side of a box, cap of a cylinder, triangle of a mesh.
    part: int
    normal: np.ndarray
    corners: np.ndarray
    endless: bool = False

    @property
    def largest(self) -> float:
        return 0.0 if self.endless else float(np.abs(self.corners).max())


@dataclass
class Outline:
    """The surfaces of a shape that may coincide with others, and whether the shape is closed."""

    low: np.ndarray
    high: np.ndarray
    closed: Callable[[], bool]
    # Flat faces; those of a mesh are derived from its triangles.
    faces: List[Face] = field(default_factory=list)
    # World-space positions and vertex indices of triangles.
    mesh: Optional[Tuple[np.ndarray, np.ndarray]] = None
    # Centre, or both ends of the axis, and radius.
    ball: Optional[Tuple[np.ndarray, float]] = None
    tube: Optional[Tuple[np.ndarray, float]] = None
    # Positions of the caps of a cylinder in object space.
    z: Sequence[float] = (-1.0, 1.0)
    # Whether it cannot be rebuilt with moved faces.
    rigid: bool = False
    endless: bool = False


@dataclass
class Change:
    """How a shape is rebuilt: a map of world space, displaced vertices, or other cap positions."""

    world: np.ndarray = field(default_factory=lambda: np.eye(4))
    vertices: Optional[np.ndarray] = None
    caps: Optional[Sequence[float]] = None


@dataclass
class Found:
    """Changes by shape index, the reported pairs, and the planes with their gaps."""

    changes: Dict[int, Change] = field(default_factory=dict)
    reported: List[dict] = field(default_factory=list)
    # Normal, a point, and the total width of the gaps in metres.
    planes: List[Tuple[np.ndarray, np.ndarray, float]] = field(default_factory=list)

    def margin(self, point: np.ndarray) -> float:
        """How much earlier shadow rays end, so that no coincident surface at a lamp blocks it."""
        size = float(np.abs(point).max())
        there = [room for normal, place, room in self.planes if abs((point - place) @ normal) <= NEAR_LAMP * max(size, float(np.abs(place).max()))]
        return SLANT * max(there, default=0.0)


# ---- outlines ------------------------------------------------------------------------------------


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _points(world: np.ndarray, points: Any) -> np.ndarray:
    return np.asarray(points, dtype=float) @ world[:3, :3].T + world[:3, 3]


def _gradient(world: np.ndarray, axis: int) -> np.ndarray:
    """The gradient of an object-space coordinate in world space."""
    return np.linalg.inv(world[:3, :3])[axis]


def _circle(world: np.ndarray, z: float, radius: float) -> np.ndarray:
    turn = 2 * np.pi * (np.arange(ROUND) + 0.5) / ROUND
    return _points(world, np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(ROUND, z)]))


def _square(axis: int, at: float) -> np.ndarray:
    corners = np.zeros((4, 3))
    corners[:, axis] = at
    corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = [-1, 1, 1, -1], [-1, -1, 1, 1]
    return corners


def _of_faces(faces: Sequence[Tuple[np.ndarray, np.ndarray]], closed: bool) -> Outline:
    """The outline of faces given by normals and vertices."""
    every = np.concatenate([corners for _, corners in faces])
    made = [Face(part, _unit(normal), corners) for part, (normal, corners) in enumerate(faces)]
    return Outline(every.min(axis=0), every.max(axis=0), lambda: closed, made)


def _of_box(world: np.ndarray) -> Outline:
    sides = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]
    return _of_faces([(sign * _gradient(world, axis), _points(world, _square(axis, sign))) for axis, sign in sides], True)


def _of_plane(world: np.ndarray) -> Outline:
    face, endless = Face(0, _unit(_gradient(world, 2)), world[None, :3, 3], True), np.full(3, np.inf)
    return Outline(-endless, endless, lambda: False, [face], endless=True)


def _of_triangles(positions: np.ndarray, faces: np.ndarray) -> Outline:
    def closed() -> bool:
        point = np.unique(positions, axis=0, return_inverse=True)[1].reshape(-1)
        edges = np.concatenate([point[faces[:, [k, (k + 1) % 3]]] for k in range(3)])
        key = edges.min(axis=1).astype(np.int64) * len(point) + edges.max(axis=1)
        way = np.sign(edges[:, 1] - edges[:, 0])
        return not np.any(np.bincount(np.unique(key, return_inverse=True)[1].reshape(-1), weights=way) != 0)

    return Outline(positions.min(axis=0), positions.max(axis=0), closed, mesh=(positions, faces))


def _of_round(surface: surfaces.Round, straight: bool) -> Outline:
    """The outline of a cylinder, cone, paraboloid or hyperboloid."""
    world, up = surface.matrix, _gradient(surface.matrix, 2)
    rings = [_circle(world, z, max(radius, 1e-9)) for z, radius in zip(surface.z, surface.radii)]
    outline_ = _of_faces([(-up, rings[0]), (up, rings[1])], surface.closed)
    outline_.z = surface.z
    if not surface.closed:
        outline_.faces = []
    length = np.linalg.norm(world[:3, :3], axis=0)
    if straight and abs(length[0] - length[1]) <= 1e-12 * length[0]:
        outline_.tube = (_points(world, [[0, 0, z] for z in surface.z]), float(surface.radii[0] * length[0]))
    return outline_


def _of_prism(prism: surfaces.Prism) -> Outline:
    points, heights = prism.ring[:-1], prism.heights
    every = [np.column_stack([points[:, 0], np.full(len(points), height), points[:, 1]]) for height in heights]
    low, high = every
    corners = [np.array([low[k], low[k + 1 - len(points)], high[k + 1 - len(points)], high[k]]) for k in range(len(points))]
    normals = prism.normals() @ prism.inverse[:3, :3]
    return _of_faces([(normal, _points(prism.matrix, face)) for normal, face in zip(normals, corners + every)], True)


def _of_lathe(lathe: surfaces.Lathe) -> Outline:
    """The flat segments, as the disks that contain them; the bounds are those of the shape."""
    # The axis is y: the axes x, y, z of the disks are z, x, y here.
    world = lathe.matrix[:, [2, 0, 1, 3]]
    up, outline_ = _gradient(world, 2), lathe.outline
    faces = []
    for number in range(lathe.codes):
        (r, y), (s, z) = outline_[number], outline_[number + 1]
        if y == z:
            faces.append(Face(number, _unit(-lathe.sense * np.sign(s - r) * up), _circle(world, y, max(r, s))))
    rings = np.concatenate([_circle(world, y, max(r, 1e-9)) for r, y in outline_])
    return Outline(rings.min(axis=0), rings.max(axis=0), lambda: lathe.closed, faces)


def _operands(solid: Solid, sign: float) -> List[Tuple[np.ndarray, np.ndarray]]:
    """Normals and vertices of the flat faces of the operands of a csg."""
    found: List[Tuple[np.ndarray, np.ndarray]] = []
    for number, operand in enumerate(solid.operands):
        side = -sign if solid.turned(number) else sign
        if isinstance(operand, Solid):
            found += _operands(operand, side)
        elif isinstance(operand, surfaces.Box):
            found += [(side * face.normal, face.corners) for face in _of_box(operand.matrix).faces]
        elif isinstance(operand, surfaces.Round):
            found += [(side * face.normal, face.corners) for face in _of_round(operand, False).faces]
        elif isinstance(operand, surfaces.Prism):
            found += [(side * face.normal, face.corners) for face in _of_prism(operand).faces]
        elif isinstance(operand, surfaces.Lathe):
            found += [(side * face.normal, face.corners) for face in _of_lathe(operand).faces]
    return found


def outline(kind: str, world: np.ndarray, what: Any, how: Any) -> Optional[Outline]:
    """The outline of a shape as its reader returned it; None for unsupported shapes."""
    if kind == "box":
        return _of_box(world)
    if kind == "plane":
        return _of_plane(world)
    if kind == "rectangle":
        return _of_faces([(_gradient(world, 2), _points(world, _square(2, 0.0)))], False)
    if kind == "disk":
        return _of_faces([(_gradient(world, 2), _circle(world, 0.0, 1.0))], False)
    if kind in ("triangle", "mesh", "heightfield"):
        return _of_triangles(how.positions, how.faces)
    if isinstance(what, surfaces.Polygon):
        return _of_faces([(np.linalg.inv(world[:3, :3]).T @ what.normal, _points(world, what.vertices))], False)
    if isinstance(what, surfaces.Round):
        return _of_round(what, kind == "cylinder")
    if isinstance(what, surfaces.Prism):
        return _of_prism(what)
    if isinstance(what, surfaces.Lathe):
        return _of_lathe(what)
    if isinstance(what, Solid):
        flat = _operands(what, 1.0)
        found = _of_faces(flat, True) if flat else None
        if found is not None:
            found.rigid = True
        return found
    ball = getattr(what, "ball", None)
    if ball is None:
        return None
    if kind == "sphere":
        return Outline(ball[:3] - ball[3], ball[:3] + ball[3], lambda: True, ball=(ball[:3], float(ball[3])))
    # Mitsuba's open cylinder: its texture coordinate along the axis is 0 and 1 at the ends.
    ends = np.array([np.linalg.solve(what.wrap[:, :3], np.array([0, 0, v]) - what.wrap[:, 3]) for v in (0.0, 1.0)])
    low, high = ends.min(axis=0) - ball[3], ends.max(axis=0) + ball[3]
    return Outline(low, high, lambda: False, tube=(ends, float(ball[3])))


# ---- pairs ---------------------------------------------------------------------------------------


@dataclass
class Node:
    """All faces of a shape in one plane, or one of its round surfaces."""

    shape: int
    form: str
    # Flat faces by part; the normal of the first one is the normal of the node.
    parts: Dict[int, Face] = field(default_factory=dict)

    @property
    def normal(self) -> Optional[np.ndarray]:
        return next((face.normal for face in self.parts.values()), None)


class _Classes:
    """Classes of nodes that coincide directly or transitively."""

    def __init__(self) -> None:
        self.nodes: Dict[Any, Node] = {}
        self.lower: Dict[Any, Any] = {}
        self.pairs: Set[Tuple[Any, Any]] = set()

    def _top(self, key: Any) -> Any:
        while self.lower[key] != key:
            key = self.lower[key]
        return key

    def node(self, key: Any, shape: int, form: str) -> Node:
        """The node with this key."""
        self.lower.setdefault(key, key)
        return self.nodes.setdefault(key, Node(shape, form))

    def join(self, one: Any, other: Any) -> None:
        """Records that two nodes coincide."""
        self.pairs.add((one, other))
        a, b = sorted((self._top(one), self._top(other)))
        self.lower[b] = a

    def all(self) -> List[Tuple[List[Node], List[Tuple[Node, Node]]]]:
        """The classes, each with its pairs of nodes that coincide directly."""
        found: Dict[Any, Tuple[List[Node], List[Tuple[Node, Node]]]] = {}
        for key in sorted(self.nodes):
            found.setdefault(self._top(key), ([], []))[0].append(self.nodes[key])
        for one, other in sorted(self.pairs):
            found[self._top(one)][1].append((self.nodes[one], self.nodes[other]))
        return list(found.values())


def _near(outlines: Sequence[Tuple[int, Outline]], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n, n): which bounding boxes overlap, with a margin for rounding."""
    reach = np.maximum(np.abs(low), np.abs(high))
    room = 1e-9 * np.where(np.isfinite(reach), reach, 1.0).max(axis=1)[:, None]
    near = np.ones((len(outlines), len(outlines)), dtype=bool)
    for axis in range(3):
        near &= (low[:, axis] - room[:, 0])[:, None] <= high[None, :, axis] + room[None, :, 0]
    near &= near.T
    np.fill_diagonal(near, False)
    return near


def _separate(a: np.ndarray, b: np.ndarray, normal: np.ndarray) -> bool:
    """Whether two convex polygons in one plane do not overlap: an edge of one of them separates
    them.
    """
    scale = max(float(np.ptp(a, axis=0).max()), float(np.ptp(b, axis=0).max()))
    for one in (a, b):
        across = np.cross(np.roll(one, -1, axis=0) - one, normal)
        length = np.linalg.norm(across, axis=1)
        across = across[length > 1e-12 * scale] / length[length > 1e-12 * scale][:, None]
        origin = a[0]
        mine, other = (a - origin) @ across.T, (b - origin) @ across.T
        common = np.minimum(mine.max(axis=0), other.max(axis=0)) - np.maximum(mine.min(axis=0), other.min(axis=0))
        if np.any(common <= 1e-9 * scale):
            return True
    return False


def _coincide(one: Face, other: Face) -> bool:
    if np.linalg.norm(np.cross(one.normal, other.normal)) > 1e-6:
        return False
    if one.endless and other.endless:
        away = abs(float((one.corners[0] - other.corners[0]) @ one.normal))
        return away <= APART * float(np.abs([one.corners[0], other.corners[0]]).max())
    if one.endless or (not other.endless and np.ptp(one.corners, axis=0).max() > np.ptp(other.corners, axis=0).max()):
        one, other = other, one
    # Distance of the vertices of the smaller face from the plane of the larger one.
    apart = np.abs((one.corners - other.corners[0]) @ other.normal).max()
    if apart > APART * max(one.largest, other.largest):
        return False
    return other.endless or not _separate(one.corners, other.corners, one.normal)


@dataclass
class _Flats:
    """A structure of arrays of faces: shape, part, normal and one vertex of each."""

    shape: np.ndarray
    part: np.ndarray
    normal: np.ndarray
    corner: np.ndarray

    def keys(self) -> np.ndarray:
        """Keys that are nearly equal for faces in one plane."""
        # Any direction that few normals are perpendicular to: opposite normals get one sign.
        sign = np.where(self.normal @ np.array([0.5377, 0.6271, 0.5636]) < 0, -1.0, 1.0)
        offset = (self.normal * self.corner).sum(axis=1)
        return sign * (self.normal @ np.array([0.2819, 0.4931, 0.8234]) + 0.7193 * offset)


def _flats(place: int, one: Outline, others: Sequence[Outline]) -> _Flats:
    """The faces of a shape that lie near other shapes."""
    if one.mesh is None:
        faces = one.faces
        normals, corners = [face.normal for face in faces], [face.corners[0] for face in faces]
        parts = np.array([face.part for face in faces], dtype=np.int64)
        return _Flats(np.full(len(faces), place), parts, np.reshape(normals, (-1, 3)), np.reshape(corners, (-1, 3)))
    positions, triangles = one.mesh
    corners = positions[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    room = 1e-9 * float(np.abs(positions).max(initial=0.0))
    near = np.zeros(len(triangles), dtype=bool)
    for other in others:
        if other.endless:
            face = other.faces[0]
            near |= (np.abs((corners - face.corners[0]) @ face.normal) <= room + 1e-12).all(axis=1)
        else:
            near |= ((low <= other.high + room) & (high >= other.low - room)).all(axis=1)
    parts = np.flatnonzero(near)
    corners = corners[parts]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1)
    there = length > 0
    parts, across, corners = parts[there], across[there] / length[there][:, None], corners[there]
    return _Flats(np.full(len(parts), place), parts, across, corners[:, 0])


def _face(one: Outline, part: int, normal: np.ndarray) -> Face:
    if one.mesh is None:
        return one.faces[part]
    positions, triangles = one.mesh
    return Face(part, normal, positions[triangles[part]])


def _flat(flats: _Flats, outlines: Dict[int, Outline], classes: _Classes) -> Optional[str]:
    """Joins flat faces that coincide. Returns the reason if there are too many."""
    key = flats.keys()
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order]) > ALIKE * (1 + np.abs(key[order][1:]))) + 1
    starts = np.concatenate([[0], ends])
    shapes = flats.shape[order]
    # Only groups with faces of several shapes.
    several = np.minimum.reduceat(shapes, starts) != np.maximum.reduceat(shapes, starts)
    runs = [(begin, end) for begin, end, kept in zip(starts, np.append(ends, len(order)), several) if kept]
    if sum(end - begin for begin, end in runs) > MOST_FACES:
        return f"more than {MOST_FACES} faces lie near other shapes"
    tried = 0
    for number, (begin, end) in enumerate(runs):
        run = order[begin:end]
        faces = [_face(outlines[flats.shape[k]], int(flats.part[k]), flats.normal[k]) for k in run]
        owner = flats.shape[run]
        low = np.array([face.corners.min(axis=0) - (np.inf if face.endless else 1e-9 * face.largest) for face in faces])
        high = np.array([face.corners.max(axis=0) + (np.inf if face.endless else 1e-9 * face.largest) for face in faces])
        for k, one in enumerate(faces):
            rest = slice(k + 1, None)
            meet = (low[k] <= high[rest]).all(axis=1) & (low[rest] <= high[k]).all(axis=1) & (owner[rest] != owner[k])
            for other in k + 1 + np.flatnonzero(meet):
                tried += 1
                if tried > MOST_PAIRS:
                    return f"more than {MOST_PAIRS} pairs of faces lie near each other"
                if _coincide(one, faces[other]):
                    keys = [(0, number, int(owner[place])) for place in (k, other)]
                    for name, face in zip(keys, (one, faces[other])):
                        classes.node(name, name[2], "plane").parts.setdefault(face.part, face)
                    classes.join(*keys)
    return None


def _curved(outlines: Sequence[Tuple[int, Outline]], classes: _Classes) -> None:
    """Joins equal spheres and equal sides of cylinders."""
    balls = [(shape, *one.ball) for shape, one in outlines if one.ball is not None]
    balls.sort(key=lambda ball: float(ball[1][0]))
    for k, (shape, centre, radius) in enumerate(balls):
        apart = APART * (np.abs(centre).max() + radius)
        for other, middle, size in balls[k + 1 :]:
            if middle[0] - centre[0] > apart:
                break
            if np.abs(middle - centre).max() <= apart and abs(size - radius) <= apart:
                keys = [(1, 0, shape), (1, 0, other)]
                for name in keys:
                    classes.node(name, name[2], "sphere")
                classes.join(*keys)
    tubes = [(shape, *one.tube) for shape, one in outlines if one.tube is not None][:1000]
    for k, (shape, ends, radius) in enumerate(tubes):
        axis, length = _unit(ends[1] - ends[0]), np.linalg.norm(ends[1] - ends[0])
        apart = APART * (np.abs(ends).max() + radius)
        for other, others, size in tubes[k + 1 :]:
            along = (others - ends[0]) @ axis
            off = np.linalg.norm(others - ends[0] - along[:, None] * axis, axis=1).max()
            common = min(along.max(), length) - max(along.min(), 0.0)
            if off <= apart and abs(size - radius) <= apart and common > 1e-9 * length:
                keys = [(2, 0, shape), (2, 0, other)]
                for name in keys:
                    classes.node(name, name[2], "cylinder")
                classes.join(*keys)


# ---- order ---------------------------------------------------------------------------------------


def _levels(
    nodes: List[Node], pairs: Sequence[Tuple[Node, Node]], shapes: Sequence[Any], closed: Dict[int, bool]
) -> Optional[List[Tuple[Node, int]]]:
    """The number of gaps by which each node moves along its own normal: more than the nodes behind
    it.

    None if two shapes that cannot be rebuilt would have to move.
    """
    across = nodes[0].normal

    def along(node: Node) -> bool:
        return across is None or float(node.normal @ across) > 0

    def rank(node: Node) -> int:
        return 1 if not closed[node.shape] else (0 if along(node) else 2)

    def compare(one: Node, other: Node) -> int:
        if rank(one) != rank(other):
            return rank(one) - rank(other)
        path, others = shapes[one.shape].path, shapes[other.shape].path
        if path == others:
            return 0
        lower, way = (one, -1) if path < others else (other, 1)
        first = rank(one) == 2 or (rank(one) == 1 and not along(lower))
        return way if first else -way

    ordered = sorted(nodes, key=cmp_to_key(compare))
    place = {id(node): number for number, node in enumerate(ordered)}
    behind: List[List[int]] = [[] for _ in ordered]
    for pair in pairs:
        back, front = sorted(place[id(node)] for node in pair)
        behind[front].append(back)
    levels: List[int] = []
    for others in behind:
        levels.append(max((levels[other] + 1 for other in others), default=0))
    # A shape that cannot be rebuilt stays; otherwise an open surface, or the foremost of the closed
    # shapes behind.
    ranks = [rank(node) for node in ordered]
    rigid = {level for node, level in zip(ordered, levels) if shapes[node.shape].outline.rigid}
    if len(rigid) > 1:
        return None
    anchor = rigid.pop() if rigid else levels[ranks.index(1) if 1 in ranks else max(ranks.count(0) - 1, 0)]
    return [(node, (level - anchor) * (1 if along(node) else -1)) for node, level in zip(ordered, levels)]


def _gap(pairs: Sequence[Tuple[Node, Node]], shapes: Sequence[Any]) -> float:
    """The width of the gaps of a class, from the coordinates where two surfaces coincide."""

    def largest(node: Node) -> float:
        if node.parts:
            return max(face.largest for face in node.parts.values()) or np.inf
        return float(np.abs([shapes[node.shape].outline.low, shapes[node.shape].outline.high]).max())

    common = max(min(largest(one), largest(other)) for one, other in pairs)
    common = common if np.isfinite(common) else 1.0
    return GAP * (common + min(common, 1.0))


# ---- changes -------------------------------------------------------------------------------------


def _change(kind: str, world: np.ndarray, outline_: Outline, moves: Sequence[Tuple[Node, float]]) -> Change:
    """The change of a shape whose surfaces move by these distances along their own normals."""
    if outline_.mesh is not None:
        return Change(vertices=_displaced(outline_.mesh, moves))
    if outline_.ball is not None:
        centre, radius = outline_.ball
        scaled = np.eye(4) * (1 + sum(by for _, by in moves) / radius)
        scaled[3, 3] = 1.0
        scaled[:3, 3] = centre - scaled[0, 0] * centre
        return Change(scaled)
    inner = np.eye(4)
    if kind in ("box", "cylinder", "cone", "paraboloid", "hyperboloid"):
        # In the coordinates of the object space of the shape.
        ends = np.array([[-1.0, 1.0], [-1.0, 1.0], outline_.z])
        for node, by in moves:
            if node.form == "cylinder":
                assert outline_.tube is not None, "only tubes have nodes of this form"
                inner[0, 0] = inner[1, 1] = 1 + by / outline_.tube[1]
            for part in node.parts:
                axis, side = (part // 2, part % 2) if kind == "box" else (2, part)
                ends[axis, side] += (1 if side else -1) * by * np.linalg.norm(_gradient(world, axis))
        if kind == "box":
            inner[:3, :3] = np.diag(0.5 * (ends[:, 1] - ends[:, 0]))
            inner[:3, 3] = 0.5 * (ends[:, 1] + ends[:, 0])
        return Change(world @ inner @ np.linalg.inv(world), caps=None if kind == "box" else ends[2].tolist())
    if kind in ("prism", "lathe"):
        return Change(_fitted(moves))
    for node, by in moves:
        assert node.normal is not None, "the other shapes have flat faces only"
        inner[:3, 3] += by * node.normal
    return Change(inner)


def _fitted(moves: Sequence[Tuple[Node, float]]) -> np.ndarray:
    """The smallest affine map that moves flat faces by these distances, by least squares."""
    faces = [(face, by) for node, by in moves for face in node.parts.values()]
    every = np.concatenate([face.corners for face, _ in faces])
    middle = every.mean(axis=0)
    size = float(np.ptp(every, axis=0).max())
    rows, distances = [], []
    for face, by in faces:
        for corner in face.corners:
            rows.append(np.outer(face.normal, [*((corner - middle) / size), 1.0]).ravel())
            distances.append(by)
    found = np.linalg.lstsq(np.array(rows), np.array(distances), rcond=1e-9)[0].reshape(3, 4)
    inner = np.eye(4)
    inner[:3, :3] += found[:, :3] / size
    inner[:3, 3] = found[:, 3] - found[:, :3] @ middle / size
    return inner


def _displaced(mesh: Tuple[np.ndarray, np.ndarray], moves: Sequence[Tuple[Node, float]]) -> np.ndarray:
    """Displacements of the vertices, by least squares.

    The given faces move by these distances; other faces at the same vertices stay.
    """
    positions, faces = mesh
    point = np.unique(positions, axis=0, return_inverse=True)[1].reshape(-1)
    by_face = {part: by for node, by in moves for part in node.parts}
    touched = np.unique(point[faces[sorted(by_face)]])
    at: Dict[int, List[int]] = {int(place): [] for place in touched}
    for number in np.flatnonzero(np.isin(point[faces], touched).any(axis=1)):
        for place in set(point[faces[number]].tolist()) & at.keys():
            at[place].append(int(number))
    result = np.zeros_like(positions)
    for place, around in at.items():
        corners = positions[faces[around]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1)
        there = length > 0
        target = np.array([by_face.get(number, 0.0) for number in around])
        # Faces that must move have a larger weight than faces that should stay.
        weight = np.where(target != 0, 1e3, 1.0)[there]
        rows = normals[there] / length[there][:, None] * weight[:, None]
        result[point == place] = np.linalg.lstsq(rows, target[there] * weight, rcond=1e-6)[0]
    return result


def cut(surface: surfaces.Round, caps: Sequence[float]) -> None:
    """Moves the caps and nothing else."""
    surface.planes = [((0.0, 0.0, -1.0), -caps[0]), ((0.0, 0.0, 1.0), caps[1])]


def find(shapes: Sequence[Any]) -> Found:
    """Finds coincident surfaces of shapes (`shapes.Shape` with outlines), and how to rebuild the
    shapes.
    """
    outlines = [(place, shape.outline) for place, shape in enumerate(shapes) if shape.outline is not None]
    if len(outlines) < 2:
        return Found()
    low, high = (np.array([getattr(one, name) for _, one in outlines]) for name in ("low", "high"))
    near = _near(outlines, low, high)
    parts = [
        _flats(place, one, [outlines[other][1] for other in np.flatnonzero(near[number])])
        for number, (place, one) in enumerate(outlines)
        if near[number].any()
    ]
    if not parts:
        return Found()
    flats = _Flats(*[np.concatenate([getattr(part, name) for part in parts]) for name in _Flats.__dataclass_fields__])
    classes = _Classes()
    why = _flat(flats, dict(outlines), classes) if len(flats.shape) > 0 else None
    if why is not None:
        return Found(reported=[{"not_examined": why}])
    _curved(outlines, classes)
    found = classes.all()
    closed = {node.shape: shapes[node.shape].outline.closed() for nodes, _ in found for node in nodes}
    moves: Dict[int, List[Tuple[Node, float]]] = {}
    reported: Dict[Tuple[int, int, str], dict] = {}
    planes = []
    for nodes, pairs in found:
        levels, gap = _levels(nodes, pairs, shapes, closed), _gap(pairs, shapes)
        for node, level in levels or []:
            if level != 0:
                moves.setdefault(node.shape, []).append((node, gap * level))
        if nodes[0].parts:
            face = next(iter(nodes[0].parts.values()))
            planes.append((face.normal, face.corners[0], gap * len(nodes)))
        for one, other in pairs:
            pair = sorted((shapes[one.shape].path[0], shapes[other.shape].path[0]))
            reported.setdefault((*pair, one.form), {"shapes": pair, "form": one.form, "gap": None if levels is None else gap})
    changes = {place: _change(shapes[place].type, shapes[place].world, shapes[place].outline, mine) for place, mine in moves.items()}
    return Found(changes, [reported[key] for key in sorted(reported)], planes)
