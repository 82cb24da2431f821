"""Materials (model §8): `twin(fields, textures, ambient)` returns a `Material`.

`finish` has defaults that the model lacks (`ambient 0.1`, `diffuse 0.6`), so each one sets
everything. POV-Ray has no factor 1/pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional

from .. import registry, sdl
from ..errors import NeedsChannels
from ..fields import Context, Fields, Vector
from ..textures import Library, Surface, Texture

# Keeps the formulas short: half of a transparent pigment counts as transmitted, half as reflected
# (see `whitted`).
FILTER = 0.5


@dataclass(frozen=True)
class Material:
    """The parts of an object's material in POV-Ray: textures of the outside and of the inside, and
    an interior.
    """

    texture: Callable[[Surface], str]
    interior: str = ""
    # Light passes through. So the shape must be closed, and a duplicate casts its shadow: the
    # model's shadows are opaque.
    transparent: bool = False
    # Whether it reflects or refracts rays.
    branches: bool = False
    # For a transparent material, the index outside. POV-Ray has one for the whole scene.
    outside: Optional[float] = None


def finish(diffuse: float = 0.0, emission: Vector = (0.0, 0.0, 0.0), more: str = "") -> str:
    """`finish { }` without defaults."""
    light = f"ambient 0 emission {sdl.rgb(emission)} diffuse {sdl.number(diffuse)} brilliance 1"
    return f"finish {{ {light} {more or 'phong 0 specular 0 reflection { 0 }'} }}"


def plain(texture: Texture, finish_: str) -> Callable[[Surface], str]:
    """A POV-Ray texture that is the same on both sides."""
    return lambda surface: f"texture {{ {texture.pigment(surface)} {finish_} }}"


def grey(fields: Fields, color: Vector) -> float:
    """The number for a parameter that cannot be a colour in POV-Ray."""
    if min(color) != max(color):
        raise NeedsChannels
    return color[0]


@dataclass(frozen=True)
class Medium:
    """The keys of a material that light can enter."""

    inside: float
    outside: float
    # In POV-Ray's language.
    interior: str


def medium(fields: Fields) -> Medium:
    """`interior_ior`, `exterior_ior`, `absorption`, `exterior_absorption`, as `interior { }`.

    POV-Ray has two ways to absorb by exp(-a t). Its fading does not attenuate rays that are
    reflected inside; its media do.
    """
    inside = fields.number("interior_ior", 1.5, lambda ior: ior > 0, "an index > 0")
    outside = fields.number("exterior_ior", 1.0, lambda ior: ior > 0, "an index > 0")
    absorption = [component / fields.context.setting.scale for component in fields.color("absorption", 0.0)]
    if any(fields.color("exterior_absorption", 0.0)):
        fields.unsupported("POV-Ray takes the medium outside from the enclosing object, not from this material", "exterior_absorption")
    media = f" media {{ absorption {sdl.rgb(absorption)} }}" if any(absorption) else ""
    return Medium(inside, outside, f"interior {{ ior {sdl.number(inside / outside)}{media} }}")


class Materials:
    """The shared materials of a document, and the default one."""

    def __init__(self, shared: Dict[str, Any], textures: Library, ambient: Vector, context: Context) -> None:
        self._shared = shared
        self._textures = textures
        self._ambient = ambient
        self._context = context

    def of(self, fields: Fields) -> Optional[Material]:
        """The material of a shape; None, with a reason in the context, if it has no twin."""
        value = fields.take("material", {"type": "matte"})
        where = f"{fields.where}.material"
        if isinstance(value, str):
            if value not in self._shared:
                fields.error("material", f"no material is called {value!r}")
                return None
            where, value = f"material.{value}", self._shared[value]
        inner = Fields(value, where, self._context)
        twin = registry.find("materials", inner)
        if twin is None:
            return None
        material = twin(inner, self._textures, self._ambient)
        inner.close()
        return material
