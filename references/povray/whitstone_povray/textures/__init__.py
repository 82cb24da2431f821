"""Textures (model §10): `twin(fields)` returns a `Texture`, usually made with `function`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

from .. import registry, sdl
from ..fields import Context, Fields, Vector, as_color
from ..transforms import Matrix
from . import _mapping
from ._mapping import Mapping, Point

__all__ = ["Fields", "Library", "Point", "Surface", "Texture", "Vector", "cell", "function", "two_colors"]


@dataclass(frozen=True)
class Surface:
    """A surface point, as expressions in the x, y, z of POV-Ray's functions: texture coordinates,
    and the world-space position in metres.

    `mapped` if POV-Ray replaces x, y by u, v for a texture by texture coordinates.
    """

    u: str
    v: str
    mapped: bool = False
    world: Point = ("x", "y", "z")

    def placed(self, matrix: Matrix, scale: float) -> "Surface":
        """The surface in world space, with `scale` POV-Ray units per metre."""
        return replace(self, world=_mapping.affine(matrix, ("x", "y", "z"), 1 / scale))


@dataclass(frozen=True)
class Texture:
    """A colour; or a number in [0, 1] for each point of texture space, with a colour map."""

    constant: Optional[Vector]
    value: Optional[Callable[[Point], str]] = None
    # In ascending order; linear in between, constant beyond the first and the last.
    stops: Tuple[Tuple[float, Vector], ...] = ()
    mapping: Mapping = Mapping("uv")

    def pattern(self, surface: Surface) -> str:
        """The pattern that selects an entry of a map, with entries at `entry`."""
        by_uv = surface.mapped and self.mapping.projection == "uv"
        assert self.value is not None, "a constant has no pattern"
        # Patterns repeat beyond 0 and 1, so both limits are avoided.
        return f"{'uv_mapping ' if by_uv else ''}function {{ 0.25+0.5*({self.value(self.mapping.point(surface))}) }}"

    def choose(self, surface: Surface, look: Callable[[Vector], str]) -> str:
        """The inside of `texture { }`; `look` gives the appearance for one colour, and must be
        linear in it.
        """
        if self.constant is not None or self.value is None:
            return look(self.constant or (0.0, 0.0, 0.0))
        looks = " ".join(f"[{entry(place)} {look(color)}]" for place, color in self.stops)
        return f"{self.pattern(surface)} texture_map {{ {looks} }}"

    def pigment(self, surface: Surface) -> str:
        """The complete pigment."""
        if self.constant is not None or self.value is None:
            return f"pigment {{ {sdl.rgb(self.constant or (0.0, 0.0, 0.0))} }}"
        colors = " ".join(f"[{entry(place)} {sdl.rgb(color)}]" for place, color in self.stops)
        return f"pigment {{ {self.pattern(surface)} color_map {{ {colors} }} }}"


def entry(place: float) -> str:
    """The position in a map of a number in [0, 1]."""
    return sdl.number(0.25 + 0.5 * place)


def function(
    fields: Fields, usual: str, stops: Sequence[Tuple[float, Vector]], value: Callable[[Point], str]
) -> Texture:
    """A texture by a function, with the key `mapping`."""
    return Texture(None, value, tuple(stops), _mapping.read(fields, usual))


def two_colors(fields: Fields) -> Tuple[Tuple[float, Vector], ...]:
    """`a` and `b`, at 0 and 1."""
    return (0.0, fields.color("a", 0.8)), (1.0, fields.color("b", 0.2))


def cell(x: str) -> str:
    """c of the model: the index of the cell, with slightly shifted borders."""
    return f"floor({x}+1/4096)"


class Library:
    """The shared textures of a document."""

    def __init__(self, shared: Dict[str, Any], context: Context) -> None:
        self._shared = shared
        self._context = context

    def value(self, fields: Fields, key: str, default: Any, high: float = math.inf) -> Texture:
        """The value of a key: a colour, a texture, or the name of a shared one."""
        value = fields.take(key, default)
        where = f"{fields.where}.{key}"
        if as_color(value) is not None:
            return Texture(fields.color(key, default, high))
        if isinstance(value, str):
            if value not in self._shared:
                fields.error(key, f"no texture is called {value!r}")
                return Texture((0.0, 0.0, 0.0))
            where, value = f"texture.{value}", self._shared[value]
        inner = Fields(value, where, self._context)
        twin = registry.find("textures", inner)
        if twin is None:
            return Texture((0.0, 0.0, 0.0))
        texture = twin(inner)
        inner.close()
        return texture
