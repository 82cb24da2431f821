"""The common part of the materials with a highlight."""

from __future__ import annotations

from .. import sdl
from ..textures import Texture
from . import Fields, Library, Material, Vector, finish, grey, plain

WHITE: Vector = (1.0, 1.0, 1.0)


class Lobes:
    """`k_d`, `k_s`, `exponent`, `k_a`."""

    def __init__(self, fields: Fields, textures: Library, ambient: Vector, default: float) -> None:
        self.k_d = textures.value(fields, "k_d", default)
        k_s = textures.value(fields, "k_s", default)
        self.exponent = fields.number("exponent", 32.0, lambda value: value > 0, "an exponent > 0")
        same = not fields.has("k_a")
        k_a = self.k_d if same else textures.value(fields, "k_a", 0.0)
        if k_s.constant is None:
            fields.unsupported("POV-Ray has one highlight strength per object: expected a colour, no texture", "k_s")
        self.k_s = grey(fields, k_s.constant or (0.0, 0.0, 0.0))
        if same or not any(ambient):
            # One pigment serves both.
            self.pigment, self.diffuse, self.emission = self.k_d, 1.0, ambient
        elif self.k_d.constant is not None and k_a.constant is not None:
            self.pigment, self.diffuse = Texture(WHITE), grey(fields, self.k_d.constant)
            self.emission = tuple(k * radiance for k, radiance in zip(k_a.constant, ambient))
        else:
            fields.unsupported("POV-Ray has one pigment for `k_d` and `k_a`: expected the same texture for both, or two colours", "k_a")
            self.pigment, self.diffuse, self.emission = self.k_d, 1.0, ambient

    def highlight(self, blinn: bool) -> str:
        """The highlight. `specular` uses the half vector, with the inverse of the exponent as
        roughness.
        """
        if blinn:
            return f"phong 0 specular {sdl.number(self.k_s)} roughness {sdl.number(1 / self.exponent)}"
        return f"specular 0 phong {sdl.number(self.k_s)} phong_size {sdl.number(self.exponent)}"


def opaque(lobes: Lobes, blinn: bool) -> Material:
    """A material that consists of the lobes only."""
    more = lobes.highlight(blinn) + " reflection { 0 }"
    return Material(plain(lobes.pigment, finish(lobes.diffuse, lobes.emission, more)))
