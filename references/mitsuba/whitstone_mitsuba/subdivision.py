"""Loop subdivision (model §9) by sparse matrices, one linear map of the points per level; then
displacement.
"""

from __future__ import annotations

from typing import Callable, Optional, Tuple

import numpy as np

from .meshes import Triangles

# (points (n, 3), unit normals (n, 3), uvs (n, 2)) -> displacements (n, 3) in metres, of corners of
# triangles
Displacement = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def loop(mesh: Triangles, levels: int, displacement: Optional[Displacement] = None) -> Triangles:
    """The mesh after some levels, displaced, with normals."""
    # -0 and 0 are equal.
    points, point_of = np.unique(mesh.positions + 0.0, axis=0, return_inverse=True)
    faces = np.asarray(point_of).reshape(-1)[mesh.faces]
    real = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces, corners = faces[real], mesh.faces[real]
    uvs = mesh.uvs
    for _ in range(levels):
        edges, of_side = _edges(faces)
        points, faces = _points(points, faces, edges, of_side), _split(faces, len(points) + of_side)
        if uvs is not None:
            edges, of_side = _edges(corners)
            corners = _split(corners, len(uvs) + of_side)
            uvs = np.vstack([uvs, uvs[edges].mean(axis=1)])
    if displacement is not None:
        points = points + _moves(points, faces, None if uvs is None else uvs[corners], displacement)
    normals = _normals(points, faces)
    if uvs is None:
        return Triangles(points, faces, normals)
    # Every texture coordinate belongs to one point.
    at = np.zeros(len(uvs), dtype=np.int64)
    at[corners.ravel()] = faces.ravel()
    return Triangles(points[at], corners, normals[at], uvs)


def _normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The sum of triangle normals at each point, not normalised."""
    normals = np.zeros_like(points)
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    return normals


def _moves(points: np.ndarray, faces: np.ndarray, uvs: Optional[np.ndarray], displacement: Displacement) -> np.ndarray:
    """(n, 3): displacement of each point, the mean over its triangle corners; `uvs` is (triangles,
    3, 2).
    """
    normals = _normals(points, faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    at = faces.ravel()
    seen = displacement(points[at], normals[at], np.zeros((len(at), 2)) if uvs is None else uvs.reshape(-1, 2))
    count = np.maximum(np.bincount(at, minlength=len(points)), 1)
    mean = np.stack([np.bincount(at, weights=seen[:, k], minlength=len(points)) / count for k in range(3)], axis=1)
    return np.where(length > 0, mean, 0)


def _edges(faces: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """(edges, 2) end points, and (triangles, 3) indices of the edges ab, bc, ca."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, of_side = np.unique(sides, axis=0, return_inverse=True)
    return edges, np.asarray(of_side).reshape(-1, 3)


def _points(points: np.ndarray, faces: np.ndarray, edges: np.ndarray, of_side: np.ndarray) -> np.ndarray:
    """The vertex points, then the edge points."""
    smooth = np.bincount(of_side.ravel(), minlength=len(edges)) == 2
    # The sum of all vertices opposite an edge; a smooth edge has two.
    opposite = np.zeros((len(edges), 3))
    np.add.at(opposite, of_side.ravel(), points[np.roll(faces, 1, axis=1).ravel()])
    ends = points[edges[:, 0]] + points[edges[:, 1]]
    edge_points = np.where(smooth[:, None], 3 / 8 * ends + opposite / 8, ends / 2)

    def gather(chosen: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """For each point the sum of the other end points of the chosen edges, and their number."""
        total = np.zeros_like(points)
        np.add.at(total, chosen[:, 0], points[chosen[:, 1]])
        np.add.at(total, chosen[:, 1], points[chosen[:, 0]])
        return total, np.bincount(chosen.ravel(), minlength=len(points))

    around, k = gather(edges)
    across, sharp = gather(edges[~smooth])
    count = np.maximum(k, 1)
    beta = (5 / 8 - (3 / 8 + np.cos(2 * np.pi / count) / 4) ** 2) / count
    inside = points * (1 - k * beta)[:, None] + beta[:, None] * around
    border = 3 / 4 * points + across / 8
    vertex_points = np.where((sharp == 0)[:, None], inside, np.where((sharp == 2)[:, None], border, points))
    return np.vstack([np.where((k == 0)[:, None], points, vertex_points), edge_points])


def _split(faces: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Four triangles for each, in sequence."""
    (a, b, c), (ab, bc, ca) = faces.T, edges.T
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(triangle, axis=1) for triangle in four], axis=1).reshape(-1, 3)
