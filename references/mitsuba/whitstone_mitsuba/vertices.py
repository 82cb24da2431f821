"""Vertex attributes of meshes (model §8 to §10): colours, the second set of texture coordinates,
and mesh tangents.

The driver interpolates them itself, at the points of hits. Textures find them in fields of
Mitsuba's surface interaction that none of the BSDFs in use reads: `dn_dv` is the colour, `dn_du`
consists of the second (u, v) and alpha. `prim_index` is the row in the table of all triangles with
attributes, and 0 elsewhere. (Materials with mesh tangents look them up by this row.)
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from .meshes import Triangles
from .runtime import dr, mi
from .solids import Solid
from .surfaces import ClosedMesh, Surface


@dataclass(frozen=True)
class Attributes:
    """The attributes of triangles at their vertices."""

    # (n, 3, 3), in world space.
    points: np.ndarray
    # (n, 3, 4), RGBA.
    colors: np.ndarray
    # (n, 3, 2), the second set.
    uvs: np.ndarray
    # (n, 3, 3), X in world space, not normalised.
    tangents: np.ndarray
    # (n,), h.
    signs: np.ndarray

    @staticmethod
    def none(count: int) -> "Attributes":
        """The attributes of shapes without any."""
        points = np.tile(np.eye(3), (count, 1, 1))
        return Attributes(points, np.ones((count, 3, 4)), np.zeros((count, 3, 2)), np.zeros((count, 3, 3)), np.ones(count))

    @staticmethod
    def joined(parts: Sequence["Attributes"]) -> "Attributes":
        return Attributes(*[np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Attributes)])


def of(triangles: Triangles, positions: np.ndarray, matrix: np.ndarray) -> Optional[Attributes]:
    """The attributes of a mesh whose vertices have these positions in world space; None if it has
    none. `matrix` is its `world_from_object`.
    """
    if triangles.colors is None and triangles.second is None and triangles.tangents is None:
        return None
    found = Attributes.none(len(triangles.faces))
    colors, uvs, tangents, signs = found.colors, found.uvs, found.tangents, found.signs
    if triangles.colors is not None:
        colors = triangles.colors[triangles.faces]
    if triangles.second is not None:
        uvs = triangles.second[triangles.faces]
    if triangles.tangents is not None and triangles.signs is not None:
        linear = matrix[:3, :3]
        tangents = triangles.tangents[triangles.faces] @ linear.T
        signs = triangles.signs * np.sign(np.linalg.det(linear))
    return Attributes(positions[triangles.faces], colors, uvs, tangents, signs)


def of_surface(surface: Optional[Surface]) -> Optional[Attributes]:
    """The attributes of a surface that the driver intersects, by the code of its parts; None if
    there are none.
    """
    if isinstance(surface, ClosedMesh):
        return surface.attributes
    if not isinstance(surface, Solid):
        return None
    parts = [of_surface(operand) for operand in surface.operands]
    if all(part is None for part in parts):
        return None
    return Attributes.joined([Attributes.none(operand.codes) if part is None else part for operand, part in zip(surface.operands, parts)])


class Table:
    """The attributes of all shapes of a scene. Row 0 is that of surfaces without attributes."""

    def __init__(self, shapes: Sequence[Any]) -> None:
        found = [shape.rules.attributes if shape.surface is None else of_surface(shape.surface) for shape in shapes]
        parts: List[Attributes] = [Attributes.none(1)]
        # The first row of each shape; 0 of shapes without attributes.
        self.first = np.zeros(len(shapes) + 1, dtype=np.int64)
        following = 1
        for number, part in enumerate(found):
            if part is not None:
                parts.append(part)
                self.first[number] = following
                following += len(part.signs)
        self.any = following > 1
        self.rows = Attributes.joined(parts)

    def _interpolated(self, rows: np.ndarray, p: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values of vertices, interpolated at (n, 3) points of these triangles."""
        points = self.rows.points[rows]
        across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        size = np.einsum("ij,ij->i", across, across)
        weights = np.zeros((len(rows), 3))
        for corner in (1, 2):
            # Area of the sub-triangle opposite the vertex.
            part = np.cross(points[:, (corner + 1) % 3] - p, points[:, (corner + 2) % 3] - p)
            weights[:, corner] = np.einsum("ij,ij->i", part, across) / np.where(size > 0, size, 1.0)
        # They add up to 1, so that equal values stay as they are.
        first = values[rows][:, 0]
        change = values[rows] - first[:, None]
        return first + np.einsum("nk,nkj->nj", np.where(np.isfinite(weights), weights, 0.0), change)

    def put(self, si: Any, shape: Any, facet: Any) -> None:
        """Stores the attributes at hits of these shapes and facets for textures."""
        if not self.any:
            return
        numbers = np.minimum(np.array(shape, dtype=np.int64), len(self.first) - 1)
        first = self.first[numbers]
        rows = np.where(first > 0, first + np.array(facet, dtype=np.int64), 0)
        rows = np.where(rows < len(self.rows.signs), rows, 0)
        p = np.array(si.p, dtype=np.float64).reshape(3, -1).T
        colors, uvs = self._interpolated(rows, p, self.rows.colors), self._interpolated(rows, p, self.rows.uvs)
        si.prim_index = mi.UInt32(rows.astype(np.uint32))
        si.dn_dv = _vector(colors[:, :3])
        si.dn_du = _vector(np.column_stack([uvs, colors[:, 3]]))
        dr.eval(si.prim_index, si.dn_du, si.dn_dv)

    def tangents(self, si: Any) -> Tuple[Any, Any]:
        """X, which may be 0, and h at hits whose attributes were stored."""
        p = np.array(si.p, dtype=np.float64).reshape(3, -1).T
        rows = np.broadcast_to(np.array(si.prim_index, dtype=np.int64), (len(p),))
        if not self.any:
            rows = np.zeros(len(p), dtype=np.int64)
        x = self._interpolated(rows, p, self.rows.tangents)
        length = np.linalg.norm(x, axis=1, keepdims=True)
        x = np.divide(x, length, out=np.zeros_like(x), where=length > 0)
        return _vector(x), mi.Float(self.rows.signs[rows].astype(np.float32))


def _vector(rows: np.ndarray) -> Any:
    return mi.Vector3f(np.ascontiguousarray(rows.T, dtype=np.float32))
