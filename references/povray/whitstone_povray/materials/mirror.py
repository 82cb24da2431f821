"""Twin of the material `mirror`: `reflection`."""

from __future__ import annotations

from .. import sdl
from ..textures import Texture
from . import Fields, Library, Material, Vector, finish, plain


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`reflectance`."""
    reflectance = textures.value(fields, "reflectance", 1.0, 1.0)
    if reflectance.constant is None:
        fields.unsupported("POV-Ray has one colour of reflection for a whole object, no texture", "reflectance")
        return Material(plain(Texture((0.0, 0.0, 0.0)), finish()))
    reflection = f"phong 0 specular 0 reflection {{ {sdl.rgb(reflectance.constant)} }}"
    return Material(plain(Texture((0.0, 0.0, 0.0)), finish(more=reflection)), branches=True)
