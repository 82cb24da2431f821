"""Twin of the material `emissive`: `emission`."""

from __future__ import annotations

from . import Fields, Library, Material, Vector, finish, plain


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`radiance`; no `material`."""
    radiance = textures.value(fields, "radiance", 1.0)
    if fields.take("material") is not None:
        fields.unsupported("POV-Ray has one pigment for emission and reflection", "material")
    return Material(plain(radiance, finish(0.0, (fields.context.setting.exposure,) * 3)))
