"""Twin of the material `mirror`: `reflection`; for a texture, a `texture_map` of mirrors, since the
result is linear in the reflectance.
"""

from __future__ import annotations

from .. import sdl
from . import Fields, Library, Material, Vector, finish


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`reflectance`."""
    reflectance = textures.value(fields, "reflectance", 1.0, 1.0)

    def look(color: Vector) -> str:
        reflection = f"phong 0 specular 0 reflection {{ {sdl.rgb(color)} }}"
        return f"pigment {{ rgb 0 }} {finish(more=reflection)}"

    return Material(lambda surface: f"texture {{ {reflectance.choose(surface, look)} }}", branches=True)
