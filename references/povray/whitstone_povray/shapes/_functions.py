"""Level sets by POV-Ray's `isosurface`: nested functions of coordinates in metres, each declared by
name.
"""

from __future__ import annotations

import hashlib
from typing import List, Sequence

from . import Place, Solid, Surface, axes, sdl

# In POV-Ray units of 2^-10 m: the precision of roots, far below its threshold for shadows, and the
# step of the finite differences for normals.
ACCURACY = 2e-6


class Functions:
    """The functions of one shape. Equal functions get equal names, so a declaration may occur
    twice.
    """

    def __init__(self) -> None:
        self.lines: List[str] = []

    def declare(self, parameters: Sequence[str], expression: str) -> str:
        """Declares a function; returns its name."""
        text = f"function({','.join(parameters)}) {{ {expression} }}"
        name = "F_" + hashlib.sha256(text.encode()).hexdigest()[:16]
        line = f"#ifndef({name}) #declare {name} = {text} #end"
        if line not in self.lines:
            self.lines.append(line)
        return name

    def solid(self, place: Place, name: str, container: str, steepest: float, closed: bool) -> Solid:
        """The zero set of a function of x, y, z in metres, negative inside; its slope is at most
        `steepest` per metre.
        """
        call = f"{sdl.number(place.setting.scale)}*{name}({','.join(axes(place))})"
        body = (
            f"isosurface {{ function {{ {call} }} contained_by {{ {container} }} open all_intersections "
            f"accuracy {ACCURACY} max_gradient {sdl.number(steepest)}"
        )
        return Solid(body, Surface("0", "0"), closed, head="\n".join(self.lines))


def box(place: Place, low: Sequence[float], high: Sequence[float]) -> str:
    """A bounding box, as the container."""
    return f"box {{ {place.point(low)}, {place.point(high)} }}"


def number(value: float) -> str:
    """A number as part of an expression."""
    return f"({sdl.number(value)})"
