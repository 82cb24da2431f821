"""Twin of the shape `quadric`: POV-Ray's `quadric`, clipped."""

from __future__ import annotations

from . import REQUIRED, Fields, Place, Solid, Surface, axes, sdl
from . import _round


def _coefficients(fields: Fields) -> tuple:
    if fields.has("matrix") == fields.has("coefficients"):
        fields.error("", "expected exactly one of `matrix`, `coefficients`")
        return (1.0,) * 10
    if fields.has("coefficients"):
        return fields.vector("coefficients", REQUIRED, 10)
    m = fields.vectors("matrix", 4, 4) or [(1.0,) * 4] * 4
    if any(m[i][j] != m[j][i] for i in range(4) for j in range(i)):
        fields.error("matrix", "expected a symmetric matrix")
    twice = (2 * m[0][1], 2 * m[0][2], 2 * m[1][2], 2 * m[0][3], 2 * m[1][3], 2 * m[2][3])
    return (m[0][0], m[1][1], m[2][2], *twice, m[3][3])


def twin(fields: Fields, place: Place) -> Solid:
    """`matrix` or `coefficients`, `box`, `caps`."""
    coefficients = _coefficients(fields)
    low, high = fields.vectors("box", 2, 3) or [(-1.0,) * 3, (1.0,) * 3]
    if not all(a < b for a, b in zip(low, high)):
        fields.error("box", "expected the smallest and the largest corner of a box")
        high = tuple(a + 1 for a in low)
    caps = fields.flag("caps", True)
    x, y, _ = axes(place)
    u, v = (f"(({p}-{sdl.number(low[k])})/{sdl.number(high[k] - low[k])})" for k, p in enumerate((x, y)))
    body = _round.cut(place, _round.quadric(place, coefficients), low, high, caps)
    return Solid(body, Surface(u, v), caps)
