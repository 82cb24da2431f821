"""Shapes: sphere, plane, rectangle, disk, box, triangle, mesh (model §9), on Mitsuba's geometry.

Transforms are composed in float64 and handed over once. What Mitsuba's surface differs in from the model (normals of mirrored
shapes, v of the sphere, uv of the plane, numbers of primitives) stands in each shape's `Rules`, which the driver applies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np

from . import meshes, rounding, transforms
from .errors import SceneError
from .fields import REQUIRED, Fields, nearest
from .files import Folder
from .runtime import mi

# Mitsuba has no endless plane: a disk of this radius in metres is one. (A huge rectangle is a mesh and loses rows at the horizon.)
PLANE_RADIUS = 1e7

UV_NATIVE, UV_SPHERE, UV_PLANE = 0, 1, 2
PRIMITIVE_ZERO, PRIMITIVE_NATIVE, PRIMITIVE_HALF = 0, 1, 2


@dataclass(frozen=True)
class Rules:
    """How to get the model's surface from Mitsuba's."""

    # Mitsuba's geometric normal points inward: under mirroring transforms its own orientation rules differ.
    flip: bool = False
    # Interpolated shading normals; otherwise n_s = n_g.
    smooth: bool = False
    uv: int = UV_NATIVE
    primitive: int = PRIMITIVE_ZERO
    # World (n, c) of the flat surface n . p = c onto which hit points are moved. Mitsuba leaves a disk's hit at ray(t), off the
    # surface by the rounding of t, which grows with the distance: shadow rays then start below the surface and hit it again.
    project: Optional[np.ndarray] = None
    # For UV_PLANE: 2x4, object x and y from world coordinates.
    plane: Optional[np.ndarray] = None


# (bsdf, how to round the numbers of a mesh) -> Mitsuba shape
Builder = Callable[["mi.BSDF", rounding.Rounding], "mi.Shape"]


@dataclass(frozen=True)
class Shape:
    """A shape as read."""

    type: str
    material: int
    rules: Rules
    build: Builder


def make_mesh(
    positions: np.ndarray,
    faces: np.ndarray,
    uvs: np.ndarray,
    normals: Optional[np.ndarray],
    bsdf: Optional["mi.BSDF"],
    rounded: rounding.Rounding = rounding.nearest,
) -> "mi.Mesh":
    """A Mitsuba mesh from arrays, in world space. It always has uv, so that all meshes run the same two kernels."""
    props = mi.Properties()
    props["face_normals"] = normals is None
    if bsdf is not None:
        props["mesh_bsdf"] = bsdf
    mesh = mi.Mesh("mesh", len(positions), len(faces), props, normals is not None, True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = rounded(np.ravel(positions))
    parameters["faces"] = np.ravel(faces).astype(np.uint32)
    parameters["vertex_texcoords"] = rounded(np.ravel(uvs))
    if normals is not None:
        parameters["vertex_normals"] = rounded(np.ravel(normals))
    parameters.update()
    return mesh


def _native(plugin: str, matrix: np.ndarray) -> Builder:
    def build(bsdf: "mi.BSDF", _: rounding.Rounding) -> "mi.Shape":
        return mi.load_dict({"type": plugin, "to_world": mi.ScalarTransform4f(matrix), "bsdf": bsdf})

    return build


def _triangles(triangles: meshes.Triangles, matrix: np.ndarray, smooth: bool) -> Builder:
    """Triangles in object space, transformed in float64."""
    linear = matrix[:3, :3]
    positions = triangles.positions @ linear.T + matrix[:3, 3]
    faces = triangles.faces
    if transforms.mirrors(matrix):
        # The model keeps outside outside; the winding would turn it in.
        faces = faces[:, [0, 2, 1]]
    normals = None
    if smooth and triangles.normals is not None:
        # Inverse transpose, normalised at the vertices; after the interpolation Mitsuba normalises once more.
        normals = triangles.normals @ np.linalg.inv(linear)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    uvs = triangles.uvs if triangles.uvs is not None else np.zeros((len(positions), 2))
    return lambda bsdf, rounded: make_mesh(positions, faces, uvs, normals, bsdf, rounded)


def _similarity(fields: Fields, matrix: np.ndarray) -> float:
    scale = transforms.similarity_scale(matrix)
    if scale is None:
        fields.error("transform", "must be a similarity (rotation, reflection, translation, one scale for all axes)")
        return 1.0
    return scale


def _sphere(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    centre = fields.vector("center", (0.0, 0.0, 0.0))
    radius = fields.number("radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    _similarity(fields, matrix)
    placed = matrix.copy()
    placed[:3, 3] = (matrix @ [*centre, 1.0])[:3]
    placed[:3, :3] *= radius
    return Rules(flip=transforms.mirrors(matrix), uv=UV_SPHERE), _native("sphere", placed)


def _flat(matrix: np.ndarray) -> np.ndarray:
    """(n, c) of the image of the plane z = 0."""
    normal = np.linalg.inv(matrix[:3, :3])[2]
    normal = normal / np.linalg.norm(normal)
    return np.array([*normal, normal @ matrix[:3, 3]])


def _plane(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    scale = _similarity(fields, matrix)
    placed = matrix.copy()
    placed[:3, :3] *= PLANE_RADIUS / scale
    return Rules(uv=UV_PLANE, project=_flat(matrix), plane=np.linalg.inv(matrix)[:2]), _native("disk", placed)


def _rectangle(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    return Rules(flip=transforms.mirrors(matrix)), _native("rectangle", matrix)


def _disk(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    if not transforms.alike(matrix[:3, :2]):
        fields.error("transform", "must scale x and y equally")
    return Rules(project=_flat(matrix)), _native("disk", matrix)


def box_triangles() -> meshes.Triangles:
    """The cube [-1, 1]^3 as twelve triangles, two for each face of the model, in its order, with its uv."""
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


def _box(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    return Rules(primitive=PRIMITIVE_HALF), _triangles(box_triangles(), matrix, False)


def _triangle(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    vertices = fields.vectors("vertices", 3, 3, REQUIRED)
    normals = fields.vectors("normals", 3, 3)
    # Without uvs: the barycentric coordinates of b and c.
    uvs = fields.vectors("uvs", 3, 2) or [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    triangle = meshes.Triangles(
        np.array(vertices or np.eye(3)), np.array([[0, 1, 2]]), None if normals is None else np.array(normals), np.array(uvs)
    )
    return Rules(smooth=normals is not None), _triangles(triangle, matrix, True)


def _mesh(fields: Fields, matrix: np.ndarray, base: Folder) -> Tuple[Rules, Any]:
    name = fields.string("file", REQUIRED)
    shading = fields.choice("shading", "smooth", ("smooth", "flat"))
    triangles = box_triangles()
    if name:
        try:
            triangles = meshes.load(base.path(name))
        except SceneError as error:
            fields.error("file", str(error))
    smooth = shading == "smooth" and triangles.normals is not None
    return Rules(smooth=smooth, primitive=PRIMITIVE_NATIVE), _triangles(triangles, matrix, smooth)


READERS: Dict[str, Callable[[Fields, np.ndarray, Folder], Tuple[Rules, Any]]] = {
    "sphere": _sphere,
    "plane": _plane,
    "rectangle": _rectangle,
    "disk": _disk,
    "box": _box,
    "triangle": _triangle,
    "mesh": _mesh,
}


def read(tables: Any, materials: Any, base: Folder, errors: List[str], unsupported: List[str]) -> List[Shape]:
    """The `[[shape]]` tables, in the document's order: a shape's number is its place."""
    shapes: List[Shape] = []
    if not isinstance(tables, list):
        errors.append("shape: expected an array of tables, [[shape]]")
        return shapes
    names: Dict[str, int] = {}
    for index, table in enumerate(tables):
        fields = Fields(table, f"shape[{index}]", errors)
        kind = fields.kind()
        reader = READERS.get(kind or "")
        if reader is None:
            if kind is not None:
                unsupported.append(f"shape[{index}]: no twin for a shape of type {kind!r}; {nearest(kind, list(READERS))}")
            continue
        name = fields.string("id", None)
        if name and names.setdefault(name, index) != index:
            fields.error("id", f"{name!r} is already the id of shape[{names[name]}]")
        material = materials.number(fields.take("material"), f"shape[{index}].material")
        matrix = transforms.read(fields.take("transform"), f"shape[{index}].transform", errors)
        rules, build = reader(fields, matrix, base)
        fields.close()
        shapes.append(Shape(kind, material, rules, build))
    return shapes
