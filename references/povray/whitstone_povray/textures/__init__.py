"""Textures (model §10): `twin(fields)` gives a `Texture`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional

from .. import registry, sdl
from ..fields import Context, Fields, Vector, as_color


@dataclass(frozen=True)
class Surface:
    """Texture coordinates as expressions of POV-Ray's functions in its x, y, z; `mapped` where POV-Ray puts u, v in the place of x, y."""

    u: str
    v: str
    mapped: bool = False


@dataclass(frozen=True)
class Texture:
    """A colour, or a pattern on a surface: what stands in `pigment { }`."""

    constant: Optional[Vector]
    pattern: Optional[Callable[[Surface], str]] = None

    def pigment(self, surface: Surface) -> str:
        """In full."""
        if self.constant is not None or self.pattern is None:
            return f"pigment {{ {sdl.rgb(self.constant or (0.0, 0.0, 0.0))} }}"
        return f"pigment {{ {'uv_mapping ' if surface.mapped else ''}{self.pattern(surface)} }}"


class Library:
    """The shared textures of a document."""

    def __init__(self, shared: Dict[str, Any], context: Context) -> None:
        self._shared = shared
        self._context = context

    def value(self, fields: Fields, key: str, default: Any, high: float = math.inf) -> Texture:
        """What a key says: a colour, a texture, or the name of a shared one."""
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
