"""Twin of the shape `sphere`: POV-Ray's `sphere`."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, angle, axes, coincident, sdl, similarity


def twin(fields: Fields, place: Place) -> Solid:
    """`center`, `radius`."""
    center = fields.vector("center", (0.0, 0.0, 0.0))
    radius = fields.number("radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    if similarity(place.own) is None:
        fields.error("transform", "must be a similarity")
    x, y, z = (f"({axis}-{sdl.number(c)})" for axis, c in zip(axes(place), center))
    polar = f"acos(max(-1,min(1,{z}/sqrt({x}*{x}+{y}*{y}+{z}*{z}))))"
    surface = Surface(angle(x, y), f"(pi-{polar})/pi")
    return Solid(f"sphere {{ {place.point(center)}, {place.length(radius)}", surface, True, outline=coincident.ball(center, radius))
