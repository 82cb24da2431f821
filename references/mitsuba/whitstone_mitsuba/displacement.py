"""Displacement maps of meshes and heights of height fields (model §9). Textures are looked up in
float64, because single precision would roughen the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Optional, Tuple

import numpy as np

from . import compounds, patterns, textures
from .fields import REQUIRED, Fields
from .materials import tangent_of
from .subdivision import Displacement


@dataclass
class _Frame:
    n: np.ndarray


@dataclass
class _Place:
    """The point data that mappings need, one column per corner."""

    p: np.ndarray
    uv: np.ndarray
    sh_frame: _Frame


def _index(place: np.ndarray, count: int, wrap: str) -> np.ndarray:
    """The texel at an integer index."""
    place = place.astype(np.int64)
    if wrap == "clamp":
        return np.clip(place, 0, count - 1)
    if wrap == "repeat":
        return np.mod(place, count)
    folded = np.mod(place, 2 * count)
    return np.where(folded < count, folded, 2 * count - 1 - folded)


def _image(image: Any, q: np.ndarray) -> np.ndarray:
    """(n, 3) colours of an image at (n, 3) points of texture space."""
    texels = image.pixels.astype(np.float64)
    rows, columns = texels.shape[:2]
    along_u, along_v = image.wrap
    x = (q[:, 0] * image.scale[0] + image.offset[0]) * columns
    y = (1 - (q[:, 1] * image.scale[1] + image.offset[1])) * rows
    if image.filter == "nearest":
        return texels[_index(np.floor(y), rows, along_v), _index(np.floor(x), columns, along_u)]
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    right_share, low_share = (x - 0.5 - left)[:, None], (y - 0.5 - top)[:, None]
    line = []
    for row in (0, 1):
        j = _index(top + row, rows, along_v)
        two = [texels[j, _index(left + column, columns, along_u)] for column in (0, 1)]
        line.append(two[0] * (1 - right_share) + two[1] * right_share)
    return line[0] * (1 - low_share) + line[1] * low_share


def _checker(checker: Any, q: np.ndarray) -> np.ndarray:
    cell = np.floor(q[:, :2] * np.array(checker.scale) + np.array(checker.offset)).sum(axis=1)
    return np.where((np.mod(cell, 2) == 0)[:, None], np.array(checker.a), np.array(checker.b))


def _colors(texture: Any, q: np.ndarray) -> np.ndarray:
    if isinstance(texture, textures.Image):
        return _image(texture, q)
    if isinstance(texture, textures.Checker):
        return _checker(texture, q)
    assert isinstance(texture, patterns.HOSTED)
    return texture.at(q)


def colors(texture: Any, points: np.ndarray, normals: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(n, 3): a texture at corners with these positions, unit normals and texture coordinates."""
    place = _Place(points.T, uvs.T, _Frame(normals.T))
    return np.broadcast_to(_look(texture, place), (len(points), 3))


def heights(texture: Any, points: np.ndarray, normals: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(n,): the first channel of the same."""
    return colors(texture, points, normals, uvs)[:, 0]


def in_tangent_space(vectors: np.ndarray, normals: np.ndarray, direction: Tuple[float, ...], around: bool) -> np.ndarray:
    """(n, 3): vectors of tangent space in object space; zero where there is no tangent."""
    along = np.broadcast_to(np.array(direction), normals.shape)
    tangents = np.cross(along, normals) if around else along - np.sum(along * normals, axis=1, keepdims=True) * normals
    length = np.linalg.norm(tangents, axis=1, keepdims=True)
    valid = length > 1e-9
    tangents = np.divide(tangents, length, out=np.zeros_like(tangents), where=valid)
    x, y, z = (vectors[:, k, None] for k in range(3))
    return np.where(valid, x * tangents + y * np.cross(normals, tangents) + z * normals, 0)


def _look(texture: Any, place: _Place) -> np.ndarray:
    """(n, 3) colours; n is 1 if the texture is constant."""
    if isinstance(texture, textures.Constant):
        return np.array([texture.value])
    if isinstance(texture, compounds.Compound):
        return texture.combine([_look(part, place) for part in texture.parts])
    if isinstance(texture, compounds.VertexColor):
        # Meshes with a displacement have no vertex colours.
        return np.ones((1, 3))
    return texture.mapping.values(place, lambda q: _colors(texture, q))


def read(fields: Fields, library: Any, has_uv: bool) -> Displacement:
    """The key `displacement`."""
    inner = Fields(fields.take("displacement"), f"{fields.where}.displacement", fields.errors)
    key, other = ("vector_map", "height") if inner.has("vector_map") else ("height", "vector_map")
    texture = library.value(inner, key, REQUIRED, 0.0, float("inf"))
    for excluded in (other, *(("offset",) if key == "vector_map" else ("space", "tangent", "axis"))):
        if inner.has(excluded):
            inner.error(excluded, f"cannot be given together with `{key}`")
            inner.take(excluded)
    scale, offset = inner.number("scale", 1.0), inner.number("offset", 0.0)
    tangent: Optional[Tuple[Tuple[float, ...], bool]] = None
    if inner.choice("space", "object", ("object", "tangent")) == "tangent":
        tangent = tangent_of(inner)
    inner.close()
    if compounds.by_uv(texture) and not has_uv:
        inner.error(key, "is mapped by (u, v), but the mesh has no texture coordinates")

    def moves(points: np.ndarray, normals: np.ndarray, uvs: np.ndarray) -> np.ndarray:
        found = colors(texture, points, normals, uvs)
        if key == "height":
            return scale * (found[:, :1] - offset) * normals
        vectors = 2 * found - 1
        return scale * (vectors if tangent is None else in_tangent_space(vectors, normals, *tangent))

    return moves
