"""Transforms as lists of steps, applied in the order written (model §9). A matrix is three rows of
four numbers.
"""

from __future__ import annotations

import math
from typing import Any, List, Optional, Sequence, Tuple

from . import sdl
from .fields import REQUIRED, Context, Fields, is_number

Matrix = Tuple[Tuple[float, ...], ...]
IDENTITY: Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


def product(a: Matrix, b: Matrix) -> Matrix:
    """First b, then a."""
    full = [*b, (0.0, 0.0, 0.0, 1.0)]
    return tuple(tuple(sum(row[k] * full[k][j] for k in range(4)) for j in range(4)) for row in a)


def point(matrix: Matrix, p: Sequence[float]) -> Tuple[float, ...]:
    """The image of a point."""
    return tuple(row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3] for row in matrix)


def cofactors(matrix: Matrix) -> List[Tuple[float, ...]]:
    """Cofactors of the linear part: rows that map normals up to their length and the sign of the
    determinant.
    """
    a, b, c = (row[:3] for row in matrix)
    return [cross(b, c), cross(c, a), cross(a, b)]


def determinant(matrix: Matrix) -> float:
    """Determinant of the linear part."""
    return dot(matrix[0][:3], cofactors(matrix)[0])


def normal(matrix: Matrix, n: Sequence[float]) -> Tuple[float, ...]:
    """Transforms a normal by the inverse transpose and normalises it; zero stays zero."""
    sign = math.copysign(1.0, determinant(matrix))
    return unit([sign * dot(row, n) for row in cofactors(matrix)])


def inverse(matrix: Matrix) -> Matrix:
    """The inverse transform."""
    columns, size = cofactors(matrix), determinant(matrix)
    linear = [[column[row] / size for column in columns] for row in range(3)]
    return tuple((*row, -sum(a * line[3] for a, line in zip(row, matrix))) for row in linear)


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> Tuple[float, ...]:
    """Cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a: Sequence[float]) -> Tuple[float, ...]:
    """The vector scaled to length 1; zero stays zero."""
    length = math.hypot(*a)
    return tuple(component / length for component in a) if length > 0 else (0.0, 0.0, 0.0)


def sub(a: Sequence[float], b: Sequence[float]) -> Tuple[float, ...]:
    """a - b."""
    return tuple(x - y for x, y in zip(a, b))


def write(matrix: Matrix, scale: float) -> str:
    """POV-Ray's `matrix`, whose rows are our columns, for lengths multiplied by `scale`; empty for
    the identity.
    """
    if matrix == IDENTITY:
        return ""
    columns = [matrix[row][column] * (scale if column == 3 else 1.0) for column in range(4) for row in range(3)]
    return "matrix " + sdl.vector(columns)


def _rotation(axis: Sequence[float], degrees: float) -> Matrix:
    x, y, z = unit(axis)
    # Quarter turns are exact.
    exact = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    c, s = exact.get(degrees % 360.0) or (math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
    t = 1.0 - c
    return (
        (t * x * x + c, t * x * y - s * z, t * x * z + s * y, 0.0),
        (t * x * y + s * z, t * y * y + c, t * y * z - s * x, 0.0),
        (t * x * z - s * y, t * y * z + s * x, t * z * z + c, 0.0),
    )


def _step(value: Any, where: str, context: Context) -> Matrix:
    fields = Fields(value, where, context)
    kinds = [kind for kind in ("translate", "scale", "rotate", "matrix") if fields.has(kind)]
    matrix = IDENTITY
    if len(kinds) != 1:
        fields.error("", "expected one of translate, scale, rotate, matrix")
    elif kinds[0] == "translate":
        t = fields.vector("translate", REQUIRED)
        matrix = tuple((*row[:3], t[k]) for k, row in enumerate(IDENTITY))
    elif kinds[0] == "scale":
        s = (fields.number("scale", REQUIRED),) * 3 if is_number(value["scale"]) else fields.vector("scale", REQUIRED)
        matrix = ((s[0], 0.0, 0.0, 0.0), (0.0, s[1], 0.0, 0.0), (0.0, 0.0, s[2], 0.0))
    elif kinds[0] == "rotate":
        inner = Fields(fields.take("rotate"), where + ".rotate", context)
        matrix = _rotation(inner.vector("axis", REQUIRED), inner.number("degrees", REQUIRED))
        inner.close()
    else:
        matrix = tuple(fields.vectors("matrix", 3, 4) or IDENTITY)
    fields.close()
    return matrix


def read(value: Any, where: str, context: Context) -> Matrix:
    """`world_from_object`; the identity for None."""
    matrix = IDENTITY
    steps: List[Any] = [] if value is None else value if isinstance(value, list) else [value]
    for number, step in enumerate(steps):
        matrix = product(_step(step, f"{where}[{number}]", context), matrix)
    if determinant(matrix) == 0.0:
        context.errors.append(f"{where}: the transform must be invertible")
        return IDENTITY
    return matrix


def similarity(matrix: Matrix) -> Optional[float]:
    """The scale of a similarity; None for other transforms."""
    columns = [[row[k] for row in matrix] for k in range(3)]
    lengths = [math.hypot(*column) for column in columns]
    if any(abs(length - lengths[0]) > 1e-9 * lengths[0] for length in lengths):
        return None
    if any(abs(dot(columns[a], columns[b])) > 1e-9 * lengths[0] ** 2 for a, b in ((0, 1), (0, 2), (1, 2))):
        return None
    return lengths[0]
