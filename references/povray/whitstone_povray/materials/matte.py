"""Twin of the material `matte`: `diffuse` of 1/pi."""

from __future__ import annotations

import math

from . import Fields, Library, Material, Vector, finish, plain


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`reflectance`."""
    reflectance = textures.value(fields, "reflectance", 0.5, 1.0)
    return Material(plain(reflectance, finish(1 / math.pi, ambient)))
