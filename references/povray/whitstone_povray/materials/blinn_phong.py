"""Twin of the material `blinn_phong`: POV-Ray's `specular`."""

from __future__ import annotations

from . import Fields, Library, Material, Vector
from ._phong import Lobes, opaque


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`k_d`, `k_s`, `exponent`, `k_a`."""
    return opaque(Lobes(fields, textures, ambient, 0.5), blinn=True)
