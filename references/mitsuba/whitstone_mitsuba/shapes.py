"""Shapes (model §9): readers for those with Mitsuba geometry; `analytic` reads those that the
driver intersects.

Transforms are composed in float64 and passed on once. Where Mitsuba's surface differs from the
model (normals of mirrored shapes, v of the sphere, uv of the plane, primitive numbers), each
shape's `Rules` record it, and the driver applies them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from whitstone_protocol.errors import SceneError, Unsupported

from . import (
    analytic,
    coincident,
    displacement,
    gltf,
    meshes,
    patches,
    rounding,
    subdivision,
    surfaces,
    transforms,
    vertices,
)
from .fields import REQUIRED, Fields, is_number, nearest, there_are
from .files import Folder
from .runtime import mi

# Mitsuba has no infinite plane: a disk of this radius in metres replaces it. (A huge rectangle is a
# mesh and loses rows at the horizon.)
PLANE_RADIUS = 1e12

NO_MEDIA: Mapping[str, Any] = MappingProxyType({})

UV_NATIVE, UV_SPHERE, UV_PLANE = 0, 1, 2
# Number of Mitsuba's triangles per primitive of the model; 0 if all triangles are one primitive.
PRIMITIVE_ZERO, PRIMITIVE_NATIVE, PRIMITIVE_HALF = 0, 1, 2


@dataclass(frozen=True)
class Rules:
    """How to derive the model's surface from Mitsuba's."""

    # Mitsuba's geometric normal points inward: its own orientation rules differ for mirroring
    # transforms.
    flip: bool = False
    # Interpolated shading normals; otherwise n_s = n_g.
    smooth: bool = False
    uv: int = UV_NATIVE
    primitive: int = PRIMITIVE_ZERO
    # World-space (n, c) of the plane n . p = c that hit points are projected onto. Mitsuba leaves
    # the hit of a disk at ray(t), off the surface by the rounding of t, which grows with the
    # distance. Shadow rays would then start below the surface and hit it again.
    project: Optional[np.ndarray] = None
    # World-space centre and radius of a sphere; a point of the axis and the radius of a cylinder.
    ball: Optional[np.ndarray] = None
    # World-space direction of the axis of a cylinder.
    axis: Optional[np.ndarray] = None
    # For a cylinder, 3x4: object-space x and y and the texture coordinate v from world-space
    # coordinates.
    wrap: Optional[np.ndarray] = None
    # For non-meshes, 3x4: from world space to the space of Mitsuba's shape (for a plane, of the
    # model's).
    object_from_world: Optional[np.ndarray] = None
    # For UV_PLANE, 2x4: object-space x and y from world-space coordinates.
    plane: Optional[np.ndarray] = None
    # Attributes of the vertices of a mesh, if it has any.
    attributes: Optional[vertices.Attributes] = None


# The media of a shape by side: `interior` and `exterior`, absent where nothing absorbs.
Media = Mapping[str, "mi.Medium"]
# (bsdf, rounding of the mesh data, media) -> Mitsuba shape
Builder = Callable[["mi.BSDF", rounding.Rounding, Media], "mi.Shape"]


@dataclass(frozen=True)
class Place:
    """The transforms of one instance of a shape: its own, and the product of all enclosing
    instances.
    """

    own: np.ndarray
    around: np.ndarray
    # Problems with the twin of this instance; the document itself may be valid.
    unsupported: List[str]
    # Reader of texture values.
    textures: Any = None
    # Displacements of the vertices of a mesh, in world space.
    vertices: Optional[np.ndarray] = None

    @property
    def world(self) -> np.ndarray:
        """`world_from_object`."""
        return self.around @ self.own

    @property
    def stretched(self) -> bool:
        """Whether the instances change proportions."""
        return transforms.similarity_scale(self.around) is None


@dataclass(frozen=True)
class Shape:
    """A shape from the document, or an instance of one in a group."""

    type: str
    # The model's `shape_id`, the same for all instances.
    number: int
    material: int
    rules: Rules
    # Creates the Mitsuba shape; None if the driver intersects `surface` itself, for this reason.
    build: Optional[Builder]
    surface: Optional[surfaces.Surface] = None
    reason: str = ""
    # Its index in the list of the document, then for each instance the index in the list of its
    # group.
    path: Tuple[int, ...] = ()
    world: Optional[np.ndarray] = None
    casts_shadow: bool = True
    # The surfaces that may coincide with other shapes.
    outline: Optional[coincident.Outline] = None
    # Reads it again with a change: (rules, builder) or (surface, reason).
    again: Optional[Callable[[coincident.Change], Tuple[Any, Any]]] = None

    @staticmethod
    def of(what: Any, how: Any, **more: Any) -> "Shape":
        """Builds a shape from the result of a reader."""
        if isinstance(what, surfaces.Surface):
            return Shape(rules=Rules(), build=None, surface=what, reason=how, **more)
        return Shape(rules=what, build=how, **more)


def make_mesh(
    positions: np.ndarray,
    faces: np.ndarray,
    uvs: np.ndarray,
    normals: Optional[np.ndarray],
    bsdf: Optional["mi.BSDF"],
    rounded: rounding.Rounding = rounding.nearest,
    media: Media = NO_MEDIA,
) -> "mi.Mesh":
    """A Mitsuba mesh from arrays in world space. It always has uv, so that all meshes run the same
    two kernels.
    """
    props = mi.Properties()
    props["face_normals"] = normals is None
    if bsdf is not None:
        props["mesh_bsdf"] = bsdf
    for side, medium in media.items():
        props[side] = medium
    mesh = mi.Mesh("mesh", len(positions), len(faces), props, normals is not None, True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = rounded(np.ravel(positions))
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    parameters["vertex_texcoords"] = rounded(np.ravel(uvs))
    if normals is not None:
        parameters["vertex_normals"] = rounded(np.ravel(normals))
    parameters.update()
    return mesh


def _native(plugin: str, matrix: np.ndarray, **keys: Any) -> Builder:
    def build(bsdf: "mi.BSDF", _: rounding.Rounding, media: Media = NO_MEDIA) -> "mi.Shape":
        return mi.load_dict({"type": plugin, "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf, **media, **keys})

    return build


@dataclass(frozen=True)
class _Mesh:
    """Builder of a mesh from arrays in world space."""

    positions: np.ndarray
    faces: np.ndarray
    uvs: np.ndarray
    normals: Optional[np.ndarray]

    def __call__(self, bsdf: "mi.BSDF", rounded: rounding.Rounding, media: Media = NO_MEDIA) -> "mi.Shape":
        return make_mesh(self.positions, self.faces, self.uvs, self.normals, bsdf, rounded, media)


def _world_positions(triangles: meshes.Triangles, place: Place) -> np.ndarray:
    """The vertices in world space."""
    positions = triangles.positions @ place.world[:3, :3].T + place.world[:3, 3]
    return positions if place.vertices is None else positions + place.vertices


def _triangles(triangles: meshes.Triangles, place: Place, smooth: bool) -> Builder:
    """Builder of triangles from object space, transformed in float64."""
    matrix = place.world
    positions = _world_positions(triangles, place)
    faces = triangles.faces
    if transforms.mirrors(matrix):
        # The model keeps the outside when mirroring; the winding would turn it inside.
        faces = faces[:, [0, 2, 1]]
    normals = None
    if smooth and triangles.normals is not None:
        # Inverse transpose, normalised at the vertices; Mitsuba normalises again after the
        # interpolation.
        normals = triangles.normals @ np.linalg.inv(place.own[:3, :3])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
        # Instances transform the interpolated normal. That is linear up to its length, so it can be
        # done before interpolating.
        normals = normals @ np.linalg.inv(place.around[:3, :3])
    uvs = triangles.uvs if triangles.uvs is not None else np.zeros((len(positions), 2))
    return _Mesh(positions, faces, uvs, normals)


def _similarity(fields: Fields, place: Place) -> float:
    """The shape's own scale, or that of the whole transform if it has one."""
    scale = transforms.similarity_scale(place.own)
    if scale is None:
        fields.error("transform", "must be a similarity (rotation, reflection, translation, one scale for all axes)")
        return 1.0
    return transforms.similarity_scale(place.world) or scale


def _sphere(fields: Fields, place: Place, base: Folder) -> Tuple[Any, Any]:
    matrix = place.world
    centre = fields.vector("center", (0.0, 0.0, 0.0))
    radius = fields.number("radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    _similarity(fields, place)
    if place.stretched:
        return surfaces.Ball(analytic.scaled(matrix, centre, radius)), "Mitsuba's spheres cannot be stretched; an instance stretches this one"
    placed = matrix.copy()
    placed[:3, 3] = (matrix @ [*centre, 1.0])[:3]
    placed[:3, :3] *= radius
    ball = np.array([*placed[:3, 3], radius * abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)])
    return Rules(flip=transforms.mirrors(matrix), uv=UV_SPHERE, ball=ball, object_from_world=np.linalg.inv(placed)[:3]), _native("sphere", placed)


def _flat(matrix: np.ndarray) -> np.ndarray:
    """(n, c) of the image of the plane z = 0."""
    normal = np.linalg.inv(matrix[:3, :3])[2]
    normal = normal / np.linalg.norm(normal)
    return np.array([*normal, normal @ matrix[:3, 3]])


def _sheared(place: Place) -> bool:
    """Whether a disk is sheared; Mitsuba's disks can only be stretched along their own axes."""
    first, second = place.world[:3, 0], place.world[:3, 1]
    return bool(abs(first @ second) > 1e-9 * np.linalg.norm(first) * np.linalg.norm(second))


_SHEARED = "Mitsuba's disks cannot be sheared; an instance shears this one"


def _plane(fields: Fields, place: Place, base: Folder) -> Tuple[Any, Any]:
    matrix = place.world
    scale = _similarity(fields, place)
    if _sheared(place):
        return surfaces.Flat(matrix, "plane"), _SHEARED
    placed = matrix.copy()
    placed[:3, :3] *= PLANE_RADIUS / scale
    inverse = np.linalg.inv(matrix)
    return Rules(uv=UV_PLANE, project=_flat(matrix), plane=inverse[:2], object_from_world=inverse[:3]), _native("disk", placed)


def _rectangle(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    matrix = place.world
    return Rules(flip=transforms.mirrors(matrix), object_from_world=np.linalg.inv(matrix)[:3]), _native("rectangle", matrix)


def _disk(fields: Fields, place: Place, base: Folder) -> Tuple[Any, Any]:
    matrix = place.world
    if not transforms.are_equal_and_perpendicular(place.own[:3, :2]):
        fields.error("transform", "must scale x and y equally")
    if _sheared(place):
        return surfaces.Flat(matrix, "disk"), _SHEARED
    return Rules(project=_flat(matrix), object_from_world=np.linalg.inv(matrix)[:3]), _native("disk", matrix)


def _cylinder(fields: Fields, place: Place, base: Folder) -> Tuple[Any, Any]:
    """An open cylinder without non-uniform scale is Mitsuba's; all others are hosted."""
    found = analytic.cylinder(fields, place, base)
    scale = transforms.similarity_scale(place.world)
    if found.closed or scale is None:
        return found, "Mitsuba's cylinders have no caps" if found.closed else "Mitsuba's cylinders cannot be stretched; the transform of this one is not a similarity"
    radius, (low, high) = found.radii[0], found.z
    matrix = place.world
    ball = np.array([*matrix[:3, 3], radius * scale])
    build = _native("cylinder", matrix, p0=[0.0, 0.0, low], p1=[0.0, 0.0, high], radius=radius)
    wrap = np.linalg.inv(matrix)[:3]
    wrap[2] = (wrap[2] - [0, 0, 0, low]) / (high - low)
    return Rules(ball=ball, axis=matrix[:3, 2] / scale, wrap=wrap), build


def box_triangles() -> meshes.Triangles:
    """The cube [-1, 1]^3 as twelve triangles, two per face, in the order and with the uv of the
    model.
    """
    positions, uvs, faces = [], [], []
    for face in range(6):
        axis, positive = face // 2, face % 2 == 1
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            point = np.zeros(3)
            point[axis], point[b], point[c] = (1 if positive else -1), 2 * u - 1, 2 * v - 1
            positions.append(point)
            uvs.append((u, v))
        first = 4 * face
        # b x c points along +axis, so this winding faces outward on the positive side.
        ring = (0, 1, 2, 3) if positive else (0, 3, 2, 1)
        faces += [[first + ring[0], first + ring[1], first + ring[2]], [first + ring[0], first + ring[2], first + ring[3]]]
    return meshes.Triangles(np.array(positions), np.array(faces), None, np.array(uvs, dtype=float))


def _box(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    return Rules(primitive=PRIMITIVE_HALF), _triangles(box_triangles(), place, False)


def _triangle(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    vertices = fields.vectors("vertices", 3, 3, REQUIRED)
    normals = fields.vectors("normals", 3, 3)
    # Without uvs: the barycentric coordinates of b and c.
    uvs = fields.vectors("uvs", 3, 2) or [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    triangle = meshes.Triangles(
        np.array(vertices or np.eye(3)), np.array([[0, 1, 2]]), None if normals is None else np.array(normals), np.array(uvs)
    )
    return Rules(smooth=normals is not None), _triangles(triangle, place, True)


def _wanted(fields: Fields, name: str) -> meshes.Wanted:
    """The keys that select the parts of a mesh file."""
    sets = fields.take("uv_sets", [0])
    good = isinstance(sets, list) and len(sets) <= 2 and len(set(map(repr, sets))) == len(sets)
    if not good or not all(type(number) is int and 0 <= number < 2**31 for number in sets):
        fields.error("uv_sets", f"expected at most two different integers >= 0, found {sets!r}")
        sets = [0]
    colors, tangents = fields.flag("vertex_colors", False), fields.flag("tangents", False)
    part = fields.take("part")
    if part is not None and not isinstance(part, str):
        fields.error("part", f"expected the name of a material, found {part!r}")
        part = None
    if part is not None and not name.lower().endswith(".obj"):
        fields.error("part", "requires a file ending in .obj")
        part = None
    found = meshes.Wanted(tuple(sets), colors, tangents, part)
    if fields.has("subdivision") or fields.has("displacement"):
        keys = (("uv_sets", sets not in ([], [0])), ("vertex_colors", colors), ("tangents", tangents), ("part", part is not None))
        for key, given in keys:
            if given:
                fields.error(key, "cannot be given together with `subdivision` or `displacement`")
    if not gltf.is_file(name):
        for key in ("mesh", "primitive", "skin", "weights"):
            if fields.has(key):
                fields.error(key, "requires a file ending in .gltf or .glb")
                fields.take(key)
        return found
    skin = fields.integer("skin", None, 0, 2**31 - 1) if fields.has("skin") else None
    weights = fields.take("weights")
    if weights is not None and (not isinstance(weights, list) or not all(map(is_number, weights))):
        fields.error("weights", f"expected a list of numbers, found {weights!r}")
        weights = None
    mesh, primitive = fields.integer("mesh", 0, 0, 2**31 - 1), fields.integer("primitive", 0, 0, 2**31 - 1)
    return replace(found, mesh=mesh, primitive=primitive, skin=skin, weights=None if weights is None else tuple(map(float, weights)))


def _mesh_triangles(fields: Fields, place: Place, base: Folder) -> Tuple[meshes.Triangles, bool]:
    """The triangles of a mesh in object space, and whether its normals are interpolated."""
    name = fields.string("file", REQUIRED)
    shading = fields.choice("shading", "smooth", ("smooth", "flat"))
    triangles = box_triangles()
    wanted = _wanted(fields, name)
    if name:
        try:
            triangles = meshes.load(base.path(name), wanted, base)
        except SceneError as error:
            fields.error("file", str(error))
        except Unsupported as error:
            place.unsupported.append(f"{fields.where}.file: {error}")
    levels, moves = 0, None
    if fields.has("displacement"):
        moves = displacement.read(fields, place.textures, triangles.uvs is not None)
    if fields.has("subdivision"):
        inner = Fields(fields.take("subdivision"), f"{fields.where}.subdivision", fields.errors)
        inner.choice("scheme", REQUIRED, ("loop",))
        levels = inner.integer("levels", REQUIRED, 1, 8)
        inner.close()
    if len(triangles.faces) * 4**levels > 2 * MAX_QUADS and levels > 0:
        place.unsupported.append(f"{fields.where}: no twin for more than {2 * MAX_QUADS} triangles")
    elif (levels > 0 or moves is not None) and not fields.errors:
        triangles = subdivision.loop(triangles, levels, moves)
    return triangles, shading == "smooth" and triangles.normals is not None


def _mesh(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    triangles, smooth = _mesh_triangles(fields, place, base)
    attributes = vertices.of(triangles, _world_positions(triangles, place), place.world)
    return Rules(smooth=smooth, primitive=PRIMITIVE_NATIVE, attributes=attributes), _triangles(triangles, place, smooth)


def _mesh_operand(fields: Fields, place: Place, base: Folder) -> Optional[Tuple[np.ndarray, np.ndarray, Optional[np.ndarray], Any]]:
    """The vertices of the triangles of a csg operand: positions, texture coordinates, normals if
    they are interpolated, and attributes if there are any.
    """
    before = len(fields.errors)
    triangles, smooth = _mesh_triangles(fields, place, base)
    if len(fields.errors) > before:
        return None
    # Vertices at the same position get the same number.
    place_of = np.unique(triangles.positions, axis=0, return_inverse=True)[1].reshape(-1)
    edges = [place_of[triangles.faces[:, [k, (k + 1) % 3]]] for k in range(3)]
    there = np.concatenate(edges)
    key = there.min(axis=1) * len(place_of) + there.max(axis=1)
    way = np.where(there[:, 0] < there[:, 1], 1, np.where(there[:, 0] > there[:, 1], -1, 0))
    if np.any(np.bincount(np.unique(key, return_inverse=True)[1].reshape(-1), weights=way) != 0):
        fields.error("file", "the mesh is not closed: triangles must use every edge equally often in both directions")
        return None
    uvs = np.zeros((len(triangles.positions), 2)) if triangles.uvs is None else triangles.uvs
    normals = triangles.normals[triangles.faces] if smooth and triangles.normals is not None else None
    attributes = vertices.of(triangles, _world_positions(triangles, place), place.world)
    return triangles.positions[triangles.faces], uvs[triangles.faces], normals, attributes




def _heightfield(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    columns, rows = fields.integer("columns", 64, 1, 65536), fields.integer("rows", 64, 1, 65536)
    amplitude = fields.number("amplitude", 0.2, lambda metres: metres >= 0, "a number >= 0")
    hills, octaves = fields.integer("hills", 4, 1, 1024), fields.integer("octaves", 8, 1, 16)
    seed = fields.integer("seed", 0, 0, 2**32 - 1)
    scale, offset = fields.number("scale", 1.0), fields.number("offset", 0.0)
    height = None
    if fields.has("height"):
        height = place.textures.value(fields, "height", REQUIRED, 0.0, float("inf"))
    noise = ("amplitude", "hills", "octaves", "seed")
    for key in noise if height is not None else ("scale", "offset"):
        if fields.has(key):
            fields.error(key, "cannot be given together with `height`" if height is not None else "requires `height`")
    triangles = box_triangles()
    if columns * rows > 2**26:
        fields.error(None, f"at most 2^26 quads, found {columns} x {rows}")
    elif columns * rows > MAX_QUADS:
        place.unsupported.append(f"{fields.where}: no twin for more than {MAX_QUADS} quads")
    elif height is None:
        triangles = meshes.heightfield(meshes.noise_heights(columns, rows, amplitude, hills, octaves, seed))
    elif not fields.errors:
        points, uvs = meshes.heightfield_points(columns, rows)
        up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        z = scale * (displacement.heights(height, points, up, uvs) - offset)
        with np.errstate(over="ignore"):
            finite = np.all(np.isfinite(z.astype(np.float32)))
        if finite:
            triangles = meshes.heightfield(z.reshape(rows + 1, columns + 1))
        else:
            fields.error("height", "a vertex has no finite height in single precision")
    return Rules(primitive=PRIMITIVE_NATIVE), _triangles(triangles, place, False)


def _patch(fields: Fields, place: Place, base: Folder) -> Tuple[Rules, Any]:
    points = patches.read(fields)
    level = patches.level(len(points))
    if level < patches.LEAST_LEVEL:
        place.unsupported.append(f"{fields.where}: no twin for {len(points)} patches: within the limit on triangles, the mesh would be too coarse")
        points, level = points[:1], 1

    def build(bsdf: "mi.BSDF", rounded: rounding.Rounding, media: Media = NO_MEDIA) -> "mi.Shape":
        triangles = patches.tessellate(points, patches.spacing(level, rounded))
        return _triangles(triangles, place, True)(bsdf, rounded, media)

    return Rules(smooth=True, primitive=2 * level * level), build


# (rules, builder) of a shape that Mitsuba intersects, (surface, reason) of one that the driver
# intersects.
READERS: Dict[str, Callable[[Fields, Place, Folder], Tuple[Any, Any]]] = {
    "sphere": _sphere,
    "plane": _plane,
    "rectangle": _rectangle,
    "disk": _disk,
    "box": _box,
    "triangle": _triangle,
    "mesh": _mesh,
    "heightfield": _heightfield,
    "patch": _patch,
}

_LACKING = "Mitsuba has no such shape: the driver intersects it in double precision"


def _hosted(reader: Callable[[Fields, Place, Folder], surfaces.Surface]) -> Callable[[Fields, Place, Folder], Tuple[Any, Any]]:
    return lambda fields, place, base: (reader(fields, place, base), _LACKING)


READERS.update({kind: _hosted(reader) for kind, reader in analytic.READERS.items()})
READERS["cylinder"] = _cylinder
READERS["csg"] = _hosted(analytic.Csg(_mesh_operand).read)


# Upper bound on the quads of a height field.
MAX_QUADS = 2**22
# Upper bound on prioritised dielectrics (model §8).
MAX_BODIES = 64
# Upper bound on the nesting depth of groups (model §9).
MAX_NESTING = 16
# Upper bound on the shape instances in one Mitsuba scene.
MAX_INSTANCES = 4096


@dataclass(frozen=True)
class _Around:
    """What encloses the shapes of a list."""

    world: np.ndarray
    # The indices of the enclosing instances in their lists, from the outermost.
    path: Tuple[int, ...] = ()
    # Their `materials`, from the innermost.
    replaced: Tuple[Dict[str, Any], ...] = ()
    casts_shadow: bool = True

    def shown(self, material: Any) -> Any:
        """The material that is seen of a shape with this one (model §9)."""
        for replaced in self.replaced:
            if isinstance(material, str):
                material = replaced.get(material, material)
        return material


class _Reader:
    """Traverses the `[[shape]]` tables and the groups that they instance."""

    def __init__(self, groups: Any, materials: Any, textures: Any, base: Folder, errors: List[str], unsupported: List[str]) -> None:
        self.groups = groups
        self.materials = materials
        self.textures = textures
        self.base = base
        self.errors = errors
        self.unsupported = unsupported
        self.shapes: List[Shape] = []
        # The number of the first shape of each group in use.
        self.first: Dict[str, int] = {}
        self.open: List[str] = []

    def tables(self, owner: Any, where: str) -> List[Any]:
        """The shape tables of the document or of a group."""
        tables = owner.get("shape", []) if isinstance(owner, dict) else None
        if not isinstance(tables, list):
            self.errors.append(f"{where}shape: expected an array of tables, [[shape]]")
            return []
        return tables

    def placed(self, tables: List[Any]) -> List[str]:
        """The groups that some shapes instance."""
        names = [table.get("group") for table in tables if isinstance(table, dict) and table.get("type") == "instance"]
        return [name for name in names if isinstance(name, str) and name in self.groups]

    def number(self, tables: List[Any]) -> None:
        """Numbers the shapes of every group in use, after the document's own shapes, ordered by ID.
        """
        used: List[str] = []
        waiting = self.placed(tables)
        while waiting:
            name = waiting.pop()
            if name not in used:
                used.append(name)
                waiting += self.placed(self.tables(self.groups[name], f"group.{name}."))
        following = len(tables)
        for name in sorted(used):
            self.first[name] = following
            following += len(self.tables(self.groups[name], f"group.{name}."))

    def walk(self, tables: List[Any], where: str, first: int, around: _Around) -> None:
        """Reads the shapes of one list; the first has the number `first`."""
        names: Dict[str, int] = {}
        for index, table in enumerate(tables):
            fields = Fields(table, f"{where}shape[{index}]", self.errors)
            kind = fields.kind()
            if kind is not None and kind != "instance" and kind not in READERS:
                known = list(READERS) + ["instance"]
                self.unsupported.append(f"{fields.where}: no twin for a shape of type {kind!r}; {there_are(known)}")
            if kind is None or (kind != "instance" and kind not in READERS):
                continue
            name = fields.string("id", None)
            if name and names.setdefault(name, index) != index:
                fields.error("id", f"{name!r} is already the id of {where}shape[{names[name]}]")
            own = transforms.read(fields.take("transform"), f"{fields.where}.transform", self.errors)
            casts_shadow = fields.flag("casts_shadow", True) and around.casts_shadow
            path = (*around.path, index)
            if kind == "instance":
                replaced = (self.replaced(fields), *around.replaced)
                self.instance(fields, _Around(around.world @ own, path, replaced, casts_shadow))
                fields.close()
                continue
            material = self.materials.number(around.shown(fields.take("material")), f"{fields.where}.material")
            known = self.materials.all
            if where and material < len(known) and known[material].priority is not None:
                fields.error("material", "a shape in a group must not have a `priority`: all instances would count as one body")
            place = Place(own, around.world, self.unsupported, self.textures)
            what, how = READERS[kind](fields, place, self.base)
            fields.close()
            again = partial(self.again, kind, table, place)
            more = {"type": kind, "number": first + index, "material": material, "path": path, "world": place.world}
            more["casts_shadow"] = casts_shadow
            self.shapes.append(Shape.of(what, how, again=again, **more))

    def again(self, kind: str, table: Any, place: Place, change: coincident.Change) -> Tuple[Any, Any]:
        """Reads a shape again with a change; it was valid the first time."""
        changed = replace(place, around=change.world @ place.around, vertices=change.vertices)
        what, how = READERS[kind](Fields(table, "", []), changed, self.base)
        if change.caps is not None and isinstance(what, surfaces.Round):
            coincident.cut(what, change.caps)
        return what, how

    def separate_coincident(self) -> coincident.Found:
        """Rebuilds shapes whose surfaces coincide with others. Returns the findings."""
        outlined = [
            replace(shape, outline=coincident.outline(shape.type, shape.world, shape.surface or shape.rules, shape.build))
            for shape in self.shapes
        ]
        found = coincident.find(outlined)
        for place, change in found.changes.items():
            old = self.shapes[place]
            assert old.again is not None, "every shape of a document can be read again"
            kept = ("type", "number", "material", "path", "world", "casts_shadow", "again")
            more = {name: getattr(old, name) for name in kept}
            self.shapes[place] = Shape.of(*old.again(change), **more)
        return found

    def replaced(self, fields: Fields) -> Dict[str, Any]:
        """The materials that an instance replaces, by the names of shared ones."""
        table = fields.take("materials", {})
        if not isinstance(table, dict):
            fields.error("materials", "expected a table from names of materials to materials")
            return {}
        for name, value in table.items():
            where = f"{fields.where}.materials.{name}"
            self.materials.number(name, where)
            self.materials.number(value, where)
        return table

    def instance(self, fields: Fields, around: _Around) -> None:
        """Adds an instance of all shapes of a group."""
        name = fields.string("group", REQUIRED)
        if name is None:
            return
        if name not in self.groups:
            fields.error("group", f"no group is called {name!r}; {nearest(name, list(self.groups))}")
        elif name in self.open:
            fields.error("group", f"{name!r} contains itself")
        elif len(self.open) == MAX_NESTING:
            fields.error("group", f"groups are nested more than {MAX_NESTING} deep")
        elif len(self.shapes) > MAX_INSTANCES:
            self.unsupported.append(f"{fields.where}: no twin for more than {MAX_INSTANCES} instances of shapes")
        else:
            where = f"group.{name}."
            group = Fields(self.groups[name], where[:-1], self.errors)
            group.take("accelerator")
            group.take("shape")
            group.close()
            tables = self.tables(self.groups[name], where)
            if not tables:
                group.error(None, "has no shapes")
            self.open.append(name)
            self.walk(tables, where, self.first[name], around)
            self.open.pop()


def read(
    document: Any, groups: Any, materials: Any, textures: Any, base: Folder, errors: List[str], unsupported: List[str]
) -> Tuple[List[Shape], coincident.Found]:
    """The `[[shape]]` tables in the document's order, and their coincident surfaces.

    An instance is replaced by the shapes of its group.
    """
    reader = _Reader(groups, materials, textures, base, errors, unsupported)
    tables = reader.tables(document, "")
    reader.number(tables)
    reader.walk(tables, "", 0, _Around(np.eye(4)))
    bodies = [shape for shape in reader.shapes if shape.material < len(materials.all) and materials.all[shape.material].priority is not None]
    if len(bodies) > MAX_BODIES:
        errors.append(f"shape: at most {MAX_BODIES} shapes with a priority, found {len(bodies)}")
    # Each instance of a table reports the same problems.
    for problems in (errors, unsupported):
        problems[:] = list(dict.fromkeys(problems))
    found = coincident.Found() if errors or unsupported else reader.separate_coincident()
    return reader.shapes, found
