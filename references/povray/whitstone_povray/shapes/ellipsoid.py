"""Twin of the shape `ellipsoid`: POV-Ray's `sphere`, scaled."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, angle, axes, sdl


def twin(fields: Fields, place: Place) -> Solid:
    """`radii`."""
    radii = fields.vector("radii", (1.0, 1.0, 1.0))
    if min(radii) <= 0:
        fields.error("radii", "expected three numbers greater than 0")
    x, y, z = (f"({axis}/{sdl.number(radius)})" for axis, radius in zip(axes(place), radii))
    polar = f"acos(max(-1,min(1,{z}/sqrt({x}*{x}+{y}*{y}+{z}*{z}))))"
    body = f"sphere {{ <0,0,0>, {place.length(1)} scale {sdl.vector(radii)}"
    return Solid(body, Surface(angle(x, y), f"(pi-{polar})/pi"), True)
