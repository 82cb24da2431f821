"""Level sets by POV-Ray's `isosurface`: functions of metres, declared one by one and called by one
another.
"""

from __future__ import annotations

import hashlib
from typing import List, Sequence

from . import Place, Solid, Surface, axes, sdl

# In POV-Ray's units of 2^-10 m: the depth of roots, far less than its guard of shadows, and the
# step of the differences that normals are made of.
ACCURACY = 2e-6


class Functions:
    """The functions of one shape. Equal ones have equal names, so that a declaration may be met
    twice.
    """

    def __init__(self) -> None:
        self.lines: List[str] = []

    def declare(self, parameters: Sequence[str], expression: str) -> str:
        """Its name."""
        text = f"function({','.join(parameters)}) {{ {expression} }}"
        name = "F_" + hashlib.sha256(text.encode()).hexdigest()[:16]
        line = f"#ifndef({name}) #declare {name} = {text} #end"
        if line not in self.lines:
            self.lines.append(line)
        return name

    def solid(self, place: Place, name: str, container: str, steepest: float, closed: bool) -> Solid:
        """The surface where a function of x, y, z in metres is 0, negative inside; it changes by
        `steepest` per metre at most.
        """
        call = f"{sdl.number(place.setting.scale)}*{name}({','.join(axes(place))})"
        body = (
            f"isosurface {{ function {{ {call} }} contained_by {{ {container} }} open all_intersections "
            f"accuracy {ACCURACY} max_gradient {sdl.number(steepest)}"
        )
        return Solid(body, Surface("0", "0"), closed, head="\n".join(self.lines))


def box(place: Place, low: Sequence[float], high: Sequence[float]) -> str:
    """A container."""
    return f"box {{ {place.point(low)}, {place.point(high)} }}"


def number(value: float) -> str:
    """Part of an expression."""
    return f"({sdl.number(value)})"
