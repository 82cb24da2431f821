"""Texture mappings (model §10, `mapping`) as expressions of POV-Ray's functions: the point of
texture space for a surface point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Tuple

from .. import sdl, transforms
from ..fields import Fields
from ..transforms import IDENTITY, Matrix

# Expressions for three coordinates.
Point = Tuple[str, str, str]
PROJECTIONS = ("uv", "solid", "planar", "spherical", "cylindrical", "cube", "triplanar")


def affine(matrix: Matrix, point: Point, factor: float = 1.0) -> Point:
    """The image of a point; `factor` applies only to its coordinates."""
    rows = []
    for row in matrix:
        terms = [f"{sdl.number(number * factor)}*{x}" for number, x in zip(row, point) if number != 0]
        rows.append("(" + "+".join(terms + ([sdl.number(row[3])] if row[3] != 0 or not terms else [])) + ")")
    return (rows[0], rows[1], rows[2])


def turn(x: str, y: str) -> str:
    """phi/2pi, in [0, 1)."""
    return f"select(atan2({y},{x}),atan2({y},{x})/(2*pi)+1,atan2({y},{x})/(2*pi))"


@dataclass(frozen=True)
class Mapping:
    """The parsed mapping."""

    projection: str
    matrix: Matrix = IDENTITY

    def point(self, surface: Any) -> Point:
        """The point of texture space for a surface."""
        if self.projection == "uv":
            return affine(self.matrix, (f"({surface.u})", f"({surface.v})", "0"))
        x, y, z = affine(self.matrix, surface.world)
        if self.projection == "planar":
            return x, y, "0"
        if self.projection == "spherical":
            return turn(x, y), f"((pi-atan2(sqrt({x}*{x}+{y}*{y}),{z}))/pi)", "0"
        if self.projection == "cylindrical":
            return turn(x, y), z, "0"
        if self.projection == "cube":
            # `select` returns its second argument if the first is below 0: the lowest axis wins
            # ties.
            def by_axis(on_x: str, on_y: str, on_z: str) -> str:
                return f"select(abs({x})-max(abs({y}),abs({z})),select(abs({y})-abs({z}),{on_z},{on_y}),{on_x})"

            far = f"max(abs({x}),max(abs({y}),abs({z})))"
            return f"(({by_axis(y, z, x)}/{far}+1)/2)", f"(({by_axis(z, x, y)}/{far}+1)/2)", "0"
        return x, y, z


def read(fields: Fields, usual: str) -> Mapping:
    """The key `mapping`; `usual` is the default projection."""
    table = fields.take("mapping")
    if table is None:
        return Mapping(usual)
    inner = Fields(table, f"{fields.where}.mapping", fields.context)
    given = inner.has("projection")
    projection = inner.choice("projection", usual, PROJECTIONS) if given else usual
    matrix = transforms.read(inner.take("transform"), f"{inner.where}.transform", fields.context)
    if projection == "triplanar":
        inner.number("sharpness", 4.0, lambda number: number > 0, "a number > 0")
        inner.unsupported("POV-Ray's functions of a point have no access to the normal", "projection")
    if projection == "uv" and inner.integer("uv_set", 0, 0, 1) == 1:
        inner.unsupported("POV-Ray has one set of texture coordinates", "uv_set")
    inner.close()
    return Mapping(projection, matrix)
