"""Transforms of the document: a list of steps, applied in the order written (model §9), in float64.
"""

from __future__ import annotations

import math
from typing import Any, List, Optional

import numpy as np

from .fields import REQUIRED, Fields, is_number


def rotation(axis: np.ndarray, degrees: float) -> np.ndarray:
    """3x3 rotation, counter-clockwise looking against the axis (Rodrigues). Quarter turns are
    exact.
    """
    x, y, z = axis / np.linalg.norm(axis)
    quarter = degrees / 90.0
    if quarter == round(quarter):
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(round(quarter)) % 4]
    else:
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    outer = np.outer([x, y, z], [x, y, z])
    return cosine * np.eye(3) + sine * cross + (1 - cosine) * outer


def _step(value: Any, where: str, errors: List[str]) -> np.ndarray:
    """One step as a 4x4 matrix acting on columns."""
    matrix = np.eye(4)
    fields = Fields(value, where, errors)
    kinds = [kind for kind in ("translate", "scale", "rotate", "matrix") if fields.has(kind)]
    if len(kinds) != 1:
        if isinstance(value, dict):
            fields.error(None, f"expected exactly one of translate, scale, rotate, matrix, found {sorted(value)}")
        return matrix
    if kinds[0] == "translate":
        matrix[:3, 3] = fields.vector("translate", None)
    elif kinds[0] == "scale":
        if is_number(value["scale"]):
            matrix[:3, :3] *= fields.number("scale", None)
        else:
            matrix[:3, :3] = np.diag(fields.vector("scale", None))
    elif kinds[0] == "rotate":
        inner = Fields(fields.take("rotate"), where + ".rotate", errors)
        axis = np.array(inner.vector("axis", REQUIRED))
        degrees = inner.number("degrees", REQUIRED)
        inner.close()
        if not np.linalg.norm(axis) > 0:
            inner.error("axis", "must not be zero")
        else:
            matrix[:3, :3] = rotation(axis, degrees)
    else:
        rows = fields.vectors("matrix", 3, 4)
        if rows is not None:
            matrix[:3] = rows
    fields.close()
    return matrix


def read(value: Any, where: str, errors: List[str]) -> np.ndarray:
    """`world_from_object` as a 4x4 matrix (float64); the identity if `value` is None."""
    matrix = np.eye(4)
    if value is None:
        return matrix
    steps = value if isinstance(value, list) else [value]
    for number, step in enumerate(steps):
        label = f"{where}[{number}]" if isinstance(value, list) else where
        matrix = _step(step, label, errors) @ matrix
    linear = matrix[:3, :3]
    size = np.linalg.norm(linear, axis=0)
    if not np.all(np.isfinite(matrix)) or not np.all(size > 0) or abs(np.linalg.det(linear / size)) <= 1e-15:
        errors.append(f"{where}: the transform must be invertible")
        return np.eye(4)
    return matrix


def are_equal_and_perpendicular(columns: np.ndarray) -> bool:
    """Whether columns are equally long and perpendicular, to a relative 1e-9 (model §9: lengths,
    not their squares).
    """
    lengths = np.linalg.norm(columns, axis=0)
    cosines = (columns / lengths).T @ (columns / lengths) - np.eye(len(lengths))
    return bool(np.all(np.abs(lengths - lengths[0]) <= 1e-9 * lengths[0]) and np.all(np.abs(cosines) <= 1e-9))


def similarity_scale(matrix: np.ndarray) -> Optional[float]:
    """The scale of a similarity (rotation or reflection, times a positive number), or None for
    other transforms.
    """
    linear = matrix[:3, :3]
    return float(np.linalg.norm(linear[:, 0])) if are_equal_and_perpendicular(linear) else None


def mirrors(matrix: np.ndarray) -> bool:
    """Whether the transform swaps left and right."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)
