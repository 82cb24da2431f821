"""Bicubic Bézier patches as triangles (model §9): Mitsuba has no patches.

Every patch becomes level x level squares of two triangles, with the points, normals and parameters
of the surface at the vertices. The discretisation error falls with the square of the level. The
tests measure it: near level 256, 4e-6 of the size in position and 1e-5 in normals.
"""

from __future__ import annotations

import math
from typing import Any, List, Optional, Tuple

import numpy as np

from . import rounding
from .fields import Fields, is_number
from .meshes import Triangles

# Squares along each side of a patch; fewer if there are many patches, which are smaller.
LEVEL = 256
# Upper bound on the triangles of one shape.
TRIANGLES = 2**20
# With fewer squares, the mesh is too coarse to be a reference.
LEAST_LEVEL = 64

MOST_PATCHES, MOST_VERTICES = 4096, 65536


def level(patches: int) -> int:
    """Squares along each side, for this number of patches."""
    return min(LEVEL, math.isqrt(TRIANGLES // (2 * patches)))


def _rows(fields: Fields, key: str, good: Any, most: int, size: int, expected: str) -> Optional[List[Any]]:
    value = fields.take(key)
    if value is None:
        return None
    right = isinstance(value, list) and 1 <= len(value) <= most
    if not right or not all(isinstance(row, list) and len(row) == size and all(map(good, row)) for row in value):
        fields.error(key, f"expected 1 to {most} arrays of {size} {expected}")
        return None
    return value


def read(fields: Fields) -> np.ndarray:
    """Control points (patches, 4, 4, 3): the second index runs along v, the third along u."""
    flat = np.array([[[column, row, 0.0] for column in range(4)] for row in range(4)])[None]
    points = fields.vectors("points", 16, 3)
    vertices = _rows(fields, "vertices", is_number, MOST_VERTICES, 3, "finite numbers")

    def index(value: Any) -> bool:
        return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < len(vertices or ())

    patches = _rows(fields, "patches", index, MOST_PATCHES, 16, "vertex indices")
    if points is not None and vertices is None and patches is None:
        return np.array(points).reshape(1, 4, 4, 3)
    if points is None and vertices is not None and patches is not None:
        return np.array(vertices, dtype=float)[np.array(patches)].reshape(-1, 4, 4, 3)
    fields.error(None, "expected 16 `points`, or `vertices` and `patches`")
    return flat


def bernstein(x: np.ndarray, order: int = 0) -> np.ndarray:
    """The four cubic Bernstein polynomials at x, or their derivatives of some order, in powers of
    x.
    """
    powers = np.array([[1, -3, 3, -1], [0, 3, -6, 3], [0, 0, 3, -3], [0, 0, 0, 1]], dtype=float)
    for _ in range(order):
        powers = np.concatenate([powers[:, 1:] * np.arange(1, 4), np.zeros((4, 1))], axis=1)
    return (x[:, None] ** np.arange(4)) @ powers.T


def derivative(points: np.ndarray, u: np.ndarray, v: np.ndarray, by_u: int, by_v: int) -> np.ndarray:
    """A derivative of one patch (4, 4, 3) at all parameter pairs: (len(v), len(u), 3)."""
    return np.einsum("ai,ijk,bj->abk", bernstein(v, by_v), points, bernstein(u, by_u))


def normals(points: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Unit normals of the surface at all parameter pairs; on collapsed edges their limits from
    inside.
    """
    along_u, along_v = derivative(points, u, v, 1, 0), derivative(points, u, v, 0, 1)
    found = np.cross(along_u, along_v)
    mixed = derivative(points, u, v, 1, 1)
    # Derivatives of the normal along u and v, for the limit from inside.
    by_v = np.cross(mixed, along_v) + np.cross(along_u, derivative(points, u, v, 0, 2))
    by_u = np.cross(derivative(points, u, v, 2, 0), along_v) + np.cross(along_u, mixed)
    by_v *= np.where(v < 0.5, 1.0, -1.0)[:, None, None]
    by_u *= np.where(u < 0.5, 1.0, -1.0)[None, :, None]
    at_v = (np.isin(v, (0.0, 1.0)))[:, None, None]
    size = np.linalg.norm(np.ptp(points.reshape(16, 3), axis=0))
    nothing = np.linalg.norm(found, axis=2, keepdims=True) <= 1e-12 * size * size
    # In a corner, the direction along the collapsed edge gives no information.
    at_v = at_v & (np.linalg.norm(by_v, axis=2, keepdims=True) > 1e-9 * size * size)
    found = np.where(nothing, np.where(at_v, by_v, by_u), found)
    lengths = np.linalg.norm(found, axis=2, keepdims=True)
    return np.divide(found, lengths, out=np.zeros_like(found), where=lengths > 0)


def spacing(squares: int, rounded: rounding.Rounding) -> np.ndarray:
    """The parameters at which patches are split: evenly or, with stochastic rounding (setting
    `vertices`), unevenly.

    So the discretisation error varies along with the rounding. The parameters are symmetric, so
    that edges of adjacent patches still match.
    """
    steps = np.arange(squares + 1) / squares
    if rounded is rounding.nearest:
        return steps
    # Up or down, by the setting's hash.
    probes = 1 / np.arange(3.0, 19.0, 2.0)
    up = rounded(probes) > probes
    strength = (0.25 + 0.5 * np.mean(up)) * (1 if up[0] else -1)
    uneven = steps + strength * np.sin(2 * np.pi * steps) / (2 * np.pi)
    uneven[[0, -1]] = 0.0, 1.0
    return uneven


def tessellate(patches: np.ndarray, steps: np.ndarray) -> Triangles:
    """All patches in order, split at these parameters, with two triangles per square."""
    level = len(steps) - 1
    grid = np.arange((level + 1) ** 2).reshape(level + 1, level + 1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    u, v = np.meshgrid(steps, steps)
    parts: List[Tuple[np.ndarray, ...]] = []
    for number, points in enumerate(patches):
        positions = derivative(points, steps, steps, 0, 0).reshape(-1, 3)
        turned = normals(points, steps, steps).reshape(-1, 3)
        parts.append((positions, faces + number * len(positions), turned, np.stack([u, v], axis=-1).reshape(-1, 2)))
    positions, faces, turned, uvs = (np.concatenate(part) for part in zip(*parts))
    return Triangles(positions, faces, turned, uvs)
