"""Twin of the material `dielectric`: `reflection { 0, 1 fresnel }` with `conserve_energy`, and a
filter.

POV-Ray does not scale transmitted radiance by the squared relative index. Here the filter of the
outside is that factor, and that of the inside its inverse.
"""

from __future__ import annotations

from .. import sdl
from . import Fields, Library, Material, Surface, Vector, finish, medium

_FINISH = finish(more="phong 0 specular 0 reflection { rgb 0, rgb 1 fresnel on } conserve_energy")


def _side(word: str, passes: float) -> str:
    return f"{word} {{ pigment {{ rgbf {sdl.vector([passes] * 3 + [1.0])} }} {_FINISH} }}"


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`interior_ior`, `exterior_ior`, `absorption`, `exterior_absorption`; no `priority`."""
    if fields.take("priority") is not None:
        fields.unsupported("POV-Ray has no priorities for bodies that overlap", "priority")
    media = medium(fields)
    squared = (media.outside / media.inside) ** 2

    def texture(surface: Surface) -> str:
        return _side("texture", squared) + " " + _side("interior_texture", 1 / squared)

    return Material(texture, media.interior, True, True, media.outside)
