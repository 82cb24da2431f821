"""Twin of the material `whitted`: `phong`, `reflection` and a filter, which is POV-Ray's own model
except for total internal reflection.

POV-Ray gives the single ray that remains there a weight of 1, the model `k_refl + k_refr`. So
beyond the critical angle the surface has another, opaque texture that reflects the sum. POV-Ray's
pattern `aoi` gives the angle.
"""

from __future__ import annotations

import math

from .. import sdl
from . import FILTER, Fields, Library, Material, Surface, Vector, finish, grey, medium
from ._phong import Lobes


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """The keys of `phong`, and `k_refl`, `k_refr`, the indices and absorptions."""
    lobes = Lobes(fields, textures, ambient, 0.0)
    k_refl = textures.value(fields, "k_refl", 0.0).constant
    k_refr = textures.value(fields, "k_refr", 0.0).constant
    if k_refl is None or k_refr is None:
        fields.unsupported("POV-Ray has one colour of reflection and one of refraction per object: `k_refl` and `k_refr` must be colours, no textures")
        k_refl = k_refr = (0.0, 0.0, 0.0)
    media = medium(fields)
    reflection = f"{lobes.highlight(False)} reflection {{ {sdl.rgb(k_refl)} }}"
    if not any(k_refr):
        look = finish(lobes.diffuse, lobes.emission, reflection)
        return Material(lambda surface: f"texture {{ {lobes.pigment.pigment(surface)} {look} }}", branches=any(k_refl))
    if lobes.pigment.constant is None:
        fields.unsupported("POV-Ray has one pigment for `k_d` and `k_refr`: expected a colour, no texture", "k_d")
        return Material(lambda surface: "")
    # The pigment is the transmitted part. The rest is the same pigment times (1 - FILTER), which
    # must result in k_d.
    passes = tuple(component / FILTER for component in k_refr)
    stays = grey(fields, passes) * (1 - FILTER)
    diffuse = grey(fields, lobes.pigment.constant) * lobes.diffuse / stays
    own = lobes.pigment.constant if lobes.diffuse == 1.0 else (1.0, 1.0, 1.0)
    emission = tuple(light * color / stays for light, color in zip(lobes.emission, own))
    look = finish(diffuse, emission, reflection)
    clear = f"pigment {{ rgbf {sdl.vector([*passes, FILTER])} }} {look}"
    everything = f"{lobes.highlight(False)} reflection {{ {sdl.rgb(a + b for a, b in zip(k_refl, k_refr))} }}"
    total = f"{lobes.pigment.pigment(_NOWHERE)} {finish(lobes.diffuse, lobes.emission, everything)}"

    def texture(surface: Surface) -> str:
        return _side("texture", media.outside / media.inside, clear, total) + " " + _side(
            "interior_texture", media.inside / media.outside, clear, total
        )

    return Material(texture, media.interior, True, True, media.outside)


# For a constant colour.
_NOWHERE = Surface("0", "0")


def _side(word: str, eta: float, clear: str, total: str) -> str:
    """The texture of one side, for the relative index from there: total internal reflection is
    where sin >= 1/eta.
    """
    if eta <= 1:
        return f"{word} {{ {clear} }}"
    # `aoi` is 1 along the normal and 1/2 across it.
    critical = sdl.number(1 - math.asin(1 / eta) / math.pi)
    return f"{word} {{ aoi texture_map {{ [{critical} {total}] [{critical} {clear}] }} }}"
