"""Vertices of the triangles that were hit, with their barycentric weights (model §6, rasterizer).
"""

from __future__ import annotations

from typing import Any, List, Tuple

import numpy as np

from .runtime import mi
from .scene import Built

# Position, normal (zero if there is none), texture coordinates and weight: one row per lane.
Corner = Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _table(parameters: Any, name: str, width: int) -> np.ndarray:
    return np.array(parameters[name]).reshape(-1, width)


def corners(built: Built, valid: np.ndarray, shape: np.ndarray, primitive: np.ndarray, p: np.ndarray) -> List[Corner]:
    """The three vertices of the triangle that each lane hit at p; weights are 0 on a miss."""
    count = len(valid)
    found = [(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2)), np.zeros(count)) for _ in range(3)]
    for number in np.unique(shape[valid]):
        lanes = np.flatnonzero(valid & (shape == number))
        parameters = mi.traverse(built.meshes[number])
        vertices = _table(parameters, "faces", 3)[primitive[lanes]]
        points = _table(parameters, "vertex_positions", 3).astype(np.float64)[vertices]
        smooth = bool(built.document.shapes[number].rules.smooth)
        across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        size = np.einsum("ij,ij->i", across, across)
        for corner, (positions, normals, uvs, weights) in enumerate(found):
            after, last = points[:, (corner + 1) % 3], points[:, (corner + 2) % 3]
            # Area of the sub-triangle opposite the vertex.
            part = np.cross(after - p[lanes], last - p[lanes])
            weights[lanes] = np.einsum("ij,ij->i", part, across) / size
            positions[lanes] = points[:, corner]
            uvs[lanes] = _table(parameters, "vertex_texcoords", 2)[vertices[:, corner]]
            if smooth:
                normals[lanes] = _table(parameters, "vertex_normals", 3)[vertices[:, corner]]
    return found
