"""Ray differentials (model §10, *Footprints*): the footprint of a sample, for filtered textures.

They are exact first derivatives (Igehy 1999), per sample to the right and per sample below. They
are stored next to the rays as float64 NumPy arrays. Documents without filtered textures do not use
this module: their rays have no column for it, and their kernels are the same as without it.

Textures find the footprint in four fields of Mitsuba's surface interaction: `duv_dx` and `duv_dy`
as Mitsuba uses them, and `dp_du` and `dp_dv`, which none of the BSDFs in use reads, as the steps of
the point.

Bump maps whose height depends on (u, v) need the gradients of u and v on the surface (model §8),
which follow from the same derivatives. They are in `dp_du` and `dp_dv`, so a document has either
gradients or footprints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Sequence, Tuple

import numpy as np

from . import compounds
from .cameras import Camera
from .runtime import mi

# The least cosine between a ray and the normal by which a step in the tangent plane is lengthened.
GRAZING = 2.0**-20
# Upper bound on the derivative of a branch direction, in radians per sample.
WIDEST = 1.0

# Filters that average over the footprint.
FILTERS = ("trilinear", "ewa")

# Shapes whose derivatives are implemented.
SHAPES = ("sphere", "plane", "rectangle", "disk", "box", "triangle", "mesh", "heightfield")


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=-1, keepdims=True)


# ---- documents
# --------------------------------------------------------------------------------------------------


def _textures(materials: Sequence[Any], number: int) -> Iterator[Any]:
    """All textures of a material and of its parts."""
    material = materials[number]
    for texture in (*material.textures.values(), material.ambient):
        yield from compounds.leaves(texture)
    for part in material.parts:
        yield from _textures(materials, part)


def _filtered(materials: Sequence[Any], number: int) -> bool:
    return any(getattr(texture, "covers", False) for texture in _textures(materials, number))


def used(materials: Sequence[Any], shapes: Sequence[Any]) -> bool:
    """Whether a surface has a texture that is filtered over the footprint."""
    return any(_filtered(materials, number) for number in {shape.material for shape in shapes})


def _by_uv(materials: Sequence[Any], number: int) -> bool:
    """Whether a material, or a part of it, is a bump map with a height that depends on (u, v)."""
    material = materials[number]
    height = material.textures.get("height") if material.type == "bump" else None
    return (height is not None and compounds.by_uv(height)) or any(_by_uv(materials, part) for part in material.parts)


def _second(materials: Sequence[Any], number: int) -> bool:
    """Whether a material, or a part of it, has a normal by the second texture coordinates."""
    material = materials[number]
    maps = [material.textures[key] for key in ("map", "vectors") if key in material.textures and material.type in ("normal_map", "bump")]
    own = any(leaf.mapping.uv_set == 1 for map_ in maps for leaf in compounds.leaves(map_) if hasattr(leaf, "mapping"))
    return own or any(_second(materials, part) for part in material.parts)


def gradients_used(materials: Sequence[Any], shapes: Sequence[Any]) -> bool:
    """Whether a surface has a bump map that needs the gradients of (u, v)."""
    return any(_by_uv(materials, number) for number in {shape.material for shape in shapes})


def _unsupported_gradients(materials: Sequence[Any], shapes: Sequence[Any]) -> List[str]:
    found = []
    if gradients_used(materials, shapes) and used(materials, shapes):
        found.append("scene: no twin for a bump map by (u, v) in a scene with footprints: the driver has one place for the derivatives of both")
    for shape in shapes:
        if _by_uv(materials, shape.material) and (shape.type not in SHAPES or shape.surface is not None):
            found.append(f"shape {shape.number}: no twin for a bump map by (u, v) on a shape of type {shape.type!r}: the driver lacks its derivatives")
    return found


def unsupported(materials: Sequence[Any], shapes: Sequence[Any]) -> List[str]:
    """The reasons why the derivatives of such a document are not available."""
    found = _unsupported_gradients(materials, shapes)
    if not used(materials, shapes):
        return found
    for shape in shapes:
        material = materials[shape.material]
        if not material.branches and not _filtered(materials, shape.material):
            continue
        if shape.type not in SHAPES or shape.surface is not None:
            found.append(f"shape {shape.number}: no twin for footprints on a shape of type {shape.type!r}: the driver lacks its derivatives")
        if material.branches and _second(materials, shape.material):
            found.append(f"shape {shape.number}: no twin for footprints behind a normal_map or bump by the second texture coordinates: the driver lacks their derivatives")
    return sorted(set(found))


# ---- cameras
# --------------------------------------------------------------------------------------------------


def _normalised(q: np.ndarray, change: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """The unit vector along `q`, and its derivative."""
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    unit = q / length
    return unit, (change - unit * _dot(unit, change)) / length


def of_camera(camera: Camera, x: np.ndarray, y: np.ndarray, point: Any, distance: float) -> np.ndarray:
    """(n, 2, 2, 3): for rays through these raster positions, the derivatives of origin and
    direction, to the right and below.

    `distance` is the sample distance in pixels.
    """
    u, v, w = camera.axes.T
    found = np.zeros((len(x), 2, 2, 3))
    fx, fy = (x / camera.width)[:, None], (y / camera.height)[:, None]
    if camera.kind == "environment":
        phi, theta = math.pi * (2 * fx - 1), math.pi * (0.5 - fy)
        level = np.sin(phi) * u - np.cos(phi) * w
        found[:, 0, 1] = 2 * math.pi / camera.width * np.cos(theta) * (np.cos(phi) * u + np.sin(phi) * w)
        found[:, 1, 1] = -math.pi / camera.height * (np.cos(theta) * v - np.sin(theta) * level)
        return found * distance
    left, right, bottom, top, depth = camera.window
    across = (left + (right - left) * fx) * u + (top - (top - bottom) * fy) * v
    for side, change in enumerate(((right - left) / camera.width * u, -(top - bottom) / camera.height * v)):
        if camera.kind == "orthographic":
            found[:, side, 0] = change
            continue
        q, scale = across - depth * w, 1.0
        if camera.lens is not None and point is not None:
            lens = camera.lens.points()[point.astype(np.int64)]
            scale = camera.lens.focus / depth
            q = scale * q - (lens[:, :1] * u + lens[:, 1:] * v)
        found[:, side, 1] = _normalised(q, np.broadcast_to(scale * change, q.shape))[1]
        if camera.spherical:
            found[:, side, 0] = camera.near * found[:, side, 1]
        else:
            # The intersection of the ray with the plane at the near limit.
            found[:, side, 0] = camera.near / depth * change
    return found * distance


# ---- surfaces
# --------------------------------------------------------------------------------------------------


@dataclass
class Footprint:
    """Steps of the point, of (u, v) and of n_s for each lane, to the right and below."""

    # (n, 2, 3)
    position: np.ndarray
    # (n, 2, 2)
    uv: np.ndarray
    # (n, 2, 3)
    normal: np.ndarray

    def put(self, si: Any, lanes: np.ndarray) -> None:
        """Stores the footprint of some lanes for textures."""
        uv, position = self.uv[lanes].astype(np.float32), self.position[lanes].astype(np.float32)
        si.duv_dx, si.duv_dy = (mi.Vector2f(np.ascontiguousarray(uv[:, side].T)) for side in (0, 1))
        si.dp_du, si.dp_dv = (mi.Vector3f(np.ascontiguousarray(position[:, side].T)) for side in (0, 1))


def _rows(array: Any) -> np.ndarray:
    """Dr.Jit vectors as float64 rows."""
    return np.array(array, dtype=np.float64).T


class Surfaces:
    """Derivatives of (u, v) and n_s on the shapes of a scene."""

    def __init__(self, shapes: Sequence[Any], built: Sequence[Any]) -> None:
        self._shapes, self._built = shapes, built
        self._meshes: Dict[int, Any] = {}

    def _mesh(self, number: int) -> Dict[str, np.ndarray]:
        """Vertices of the triangles of a mesh."""
        if number not in self._meshes:
            parameters = mi.traverse(self._built[number])
            faces = np.array(parameters["faces"]).reshape(-1, 3)

            def corners(name: str, width: int) -> np.ndarray:
                return np.array(parameters[name]).reshape(-1, width).astype(np.float64)[faces]

            table = {"points": corners("vertex_positions", 3), "uvs": corners("vertex_texcoords", 2)}
            if self._shapes[number].rules.smooth:
                table["normals"] = corners("vertex_normals", 3)
            self._meshes[number] = table
        return self._meshes[number]

    def meet(self, rays: Any, hits: Any) -> Footprint:
        """Footprints of rays with differentials at their hits; zero on a miss."""
        valid, shape, primitive = (array.numpy() for array in (hits.valid, hits.shape, hits.primitive))
        d, n_g, p = (_rows(array) for array in (rays.d, hits.n_g, hits.p))
        t = np.where(valid, np.array(hits.t, dtype=np.float64), 0.0)
        cosine = _dot(d, n_g)
        cosine = np.copysign(np.maximum(np.abs(cosine), GRAZING), cosine)
        moved = rays.differentials[:, :, 0] + t[:, None, None] * rays.differentials[:, :, 1]
        step = moved - (_dot(moved, n_g[:, None]) / cosine[:, None]) * d[:, None]
        step[~valid] = 0
        found = self._along(step, valid, shape, primitive, p)
        # Rule S flips the normal, and its derivative with it.
        turned = _dot(_rows(hits.n_s), _rows(hits.n_raw)) < 0
        found.normal = np.where(turned[:, :, None], -found.normal, found.normal)
        return found

    def gradients(self, hits: Any, lanes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(n, 3) each: the gradients of u and v at some lanes; zero on a miss."""
        valid, shape, primitive = (array.numpy()[lanes] for array in (hits.valid, hits.shape, hits.primitive))
        n_g, p = (_rows(array)[lanes] for array in (hits.n_g, hits.p))
        # Two unit vectors across the normal: any axis that is far from it gives the first.
        axis = np.eye(3)[np.argmin(np.abs(n_g), axis=1)]
        tangent = np.cross(n_g, axis)
        length = np.linalg.norm(tangent, axis=1, keepdims=True)
        tangent = np.divide(tangent, length, out=np.zeros_like(tangent), where=length > 0)
        pair = np.stack([tangent, np.cross(n_g, tangent)], axis=1)
        change = self._along(pair, valid, shape, primitive, p).uv
        change = np.where(np.isfinite(change), change, 0.0)
        # The sum over both vectors of the change along it times itself, for u and for v.
        u, v = (np.einsum("ns,nsi->ni", change[:, :, k], pair) for k in (0, 1))
        return u, v

    def _along(self, step: np.ndarray, valid: np.ndarray, shape: np.ndarray, primitive: np.ndarray, p: np.ndarray) -> Footprint:
        """The changes by (n, 2, 3) steps in the tangent planes at points of these shapes."""
        found = Footprint(step, np.zeros((len(valid), 2, 2)), np.zeros((len(valid), 2, 3)))
        for number in np.unique(shape[valid]):
            lanes = np.flatnonzero(valid & (shape == number))
            rules = self._shapes[number].rules
            # Shapes of other types have no bump map by (u, v) and no footprint: see `unsupported`.
            if self._shapes[number].type not in SHAPES or self._shapes[number].surface is not None:
                continue
            if rules.object_from_world is None:
                self._on_triangles(number, lanes, primitive[lanes], p[lanes], found)
            else:
                self._on_curve(self._shapes[number], lanes, p[lanes], found)
        return found

    def _on_curve(self, shape: Any, lanes: np.ndarray, p: np.ndarray, found: Footprint) -> None:
        """On Mitsuba's analytic shapes: sphere, plane, rectangle, disk."""
        rules = shape.rules
        linear, origin = rules.object_from_world[:, :3], rules.object_from_world[:, 3]
        q, step = p @ linear.T + origin, found.position[lanes] @ linear.T
        if shape.type == "plane":
            found.uv[lanes] = step[:, :, :2]
        elif shape.type == "rectangle":
            found.uv[lanes] = step[:, :, :2] / 2
        elif shape.type == "disk":
            # (r, phi/2pi)
            with np.errstate(all="ignore"):
                radius = np.hypot(q[:, 0], q[:, 1])[:, None]
                found.uv[lanes, :, 0] = (q[:, :1] * step[:, :, 0] + q[:, 1:2] * step[:, :, 1]) / radius
            found.uv[lanes, :, 1] = turn_step(q[:, None], step)
        else:
            assert shape.type == "sphere" and rules.ball is not None
            found.uv[lanes] = sphere_step(q[:, None], step)
            found.normal[lanes] = found.position[lanes] / rules.ball[3]

    def _on_triangles(self, number: int, lanes: np.ndarray, primitive: np.ndarray, p: np.ndarray, found: Footprint) -> None:
        mesh = self._mesh(number)
        # The first of the two triangles of a box face; both have the same derivatives.
        triangle = primitive * max(self._shapes[number].rules.primitive, 1)
        a, b, c = np.moveaxis(mesh["points"][triangle], 1, 0)
        normal = np.cross(b - a, c - a)
        # The barycentric coordinates of b and c are the products of the point with these vectors,
        # the dual basis of both edges.
        dual = np.stack([np.cross(c - a, normal), np.cross(normal, b - a)], axis=1) / _dot(normal, normal)[:, None]
        step = np.einsum("nsi,nki->nsk", found.position[lanes], dual)

        def change(values: np.ndarray) -> np.ndarray:
            return np.einsum("nsk,nkj->nsj", step, values[:, 1:] - values[:, :1])

        found.uv[lanes] = change(mesh["uvs"][triangle])
        if "normals" in mesh:
            normals = mesh["normals"][triangle]
            weight = np.einsum("ni,nki->nk", p - a, dual)
            blend = normals[:, 0] + np.einsum("nk,nkj->nj", weight, normals[:, 1:] - normals[:, :1])
            with np.errstate(all="ignore"):
                turned = _normalised(blend[:, None], change(normals))[1]
            found.normal[lanes] = np.where(np.isfinite(turned), turned, 0.0)


def turn_step(q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The derivative of phi/2pi; not finite on the axis."""
    with np.errstate(all="ignore"):
        return (q[..., 0] * step[..., 1] - q[..., 1] * step[..., 0]) / (2 * np.pi * (q[..., 0] ** 2 + q[..., 1] ** 2))


def sphere_step(q: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The derivatives of (phi/2pi, (pi - theta)/pi)."""
    with np.errstate(all="ignore"):
        radius = np.hypot(q[..., 0], q[..., 1])
        outward = (q[..., 0] * step[..., 0] + q[..., 1] * step[..., 1]) / radius
        theta = (q[..., 2] * outward - radius * step[..., 2]) / (radius**2 + q[..., 2] ** 2)
    return np.stack([turn_step(q, step), -theta / np.pi], axis=-1)


# ---- branches
# --------------------------------------------------------------------------------------------------


def normals(level: Any, lanes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """n_s at some lanes, and its changes along the steps."""
    return _rows(level.hits.n_s)[lanes], level.footprint.normal[lanes]


def branch(level: Any, lanes: np.ndarray, letter: str, specular: Any, bent: Tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(n, 2, 2, 3): the differentials of a branch at some lanes; `bent` are the normals by which it
    is bent, with their changes.
    """
    rays, hits, footprint = level.rays, level.hits, level.footprint
    v, n_g, (n, change_of_n) = -_rows(rays.d)[lanes], _rows(hits.n_g)[lanes], bent
    inside = _dot(v, n_g) < 0
    n = np.where(inside, -n, n)[:, None]
    normal = np.where(inside[:, :, None], -change_of_n, change_of_n)
    view, v = -rays.differentials[lanes, :, 1], v[:, None]
    cosine, change = _dot(n, v), _dot(normal, v) + _dot(n, view)
    if letter == "R":
        found = 2 * change * n + 2 * cosine * normal - view
    elif specular.straight is True:
        found = -view
    else:
        # n_i/n_t.
        eta = 1 / np.broadcast_to(np.array(specular.eta, dtype=np.float64), (len(lanes),))[:, None, None]
        with np.errstate(all="ignore"):
            behind = np.sqrt(1 - eta**2 * (1 - cosine**2))
            found = (eta * change - eta**2 * cosine * change / behind) * n + (eta * cosine - behind) * normal - eta * view
        straight = np.broadcast_to(np.array(specular.straight, dtype=bool), (len(lanes),))
        found = np.where(straight[:, None, None], -view, found)
    with np.errstate(all="ignore"):
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        found = np.where(length > WIDEST, found * (WIDEST / length), found)
    found = np.where(np.isfinite(found).all(axis=-1, keepdims=True), found, 0.0)
    return np.stack([footprint.position[lanes], found], axis=2)
