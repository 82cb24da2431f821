"""The common part of the twins of `prism` and `lathe`: the points of their outlines, and the length
along an outline.
"""

from __future__ import annotations

import math
from typing import Any, List, Sequence, Tuple

from ..fields import is_number
from . import Fields, sdl

Point = Tuple[float, float]

MOST_POINTS = 4096
LEAST_AREA = 1e-9
# Points this close to a segment, relative to the size of the outline, lie on it.
_ON_SEGMENT = 1e-6


def points(fields: Fields, least: int, default: Sequence[Point]) -> List[Point]:
    """`outline`. It does not check that edges meet only at their ends; the tested program does."""

    def good(value: Any) -> bool:
        return isinstance(value, list) and len(value) == 2 and all(map(is_number, value))

    value = fields.take("outline")
    if not isinstance(value, list) or not least <= len(value) <= MOST_POINTS or not all(map(good, value)):
        fields.error("outline", f"expected {least} to {MOST_POINTS} arrays of 2 finite numbers")
        return list(default)
    found = [(float(a), float(b)) for a, b in value]
    if len(set(found)) < len(found):
        fields.error("outline", "two points are equal")
        return list(default)
    return found


def twice_area(outline: Sequence[Point]) -> float:
    """Twice the area of a closed outline, positive if the second number comes after the first by a
    quarter turn.
    """
    a, b = outline[0]
    moved = [(p - a, q - b) for p, q in outline]
    return math.fsum(p[0] * q[1] - q[0] * p[1] for p, q in zip(moved, moved[1:] + moved[:1]))


def size(outline: Sequence[Point]) -> float:
    """The diagonal of the bounding rectangle."""
    return math.hypot(*(max(column) - min(column) for column in zip(*outline)))


def share(path: Sequence[Point], a: str, b: str) -> str:
    """The length of a path up to the point (a, b) on it, over its whole length."""
    ends = list(zip(path, path[1:]))
    lengths = [math.dist(*pair) for pair in ends]
    before = [math.fsum(lengths[:number]) for number in range(len(ends))]
    near = sdl.number((_ON_SEGMENT * size(path)) ** 2)
    found = ""
    for (first, last), length, start in reversed(list(zip(ends, lengths, before))):
        along = [(y - x) / length for x, y in zip(first, last)]
        away = [f"({name}-{sdl.number(value)})" for name, value in zip((a, b), first)]
        reach = f"({away[0]}*{sdl.number(along[0])}+{away[1]}*{sdl.number(along[1])})"
        on = f"min(max({reach},0),{sdl.number(length)})"
        here = f"(({sdl.number(start)}+{on})/{sdl.number(math.fsum(lengths))})"
        aside = [f"({name}-{on}*{sdl.number(part)})" for name, part in zip(away, along)]
        off = f"{aside[0]}*{aside[0]}+{aside[1]}*{aside[1]}"
        found = f"select({off}-{near},{here},{found})" if found else here
    return found
