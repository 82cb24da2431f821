"""Twin of the shape `torus`: POV-Ray's `torus`, which stands around y."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, angle, axes, sdl, similarity


def twin(fields: Fields, place: Place) -> Solid:
    """`major_radius`, `minor_radius`."""
    major = fields.number("major_radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    minor = fields.number("minor_radius", 0.25, lambda metres: metres > 0, "a radius > 0")
    if minor >= major:
        fields.error("minor_radius", f"must be less than `major_radius` = {major}, found {minor}")
    if similarity(place.own) is None:
        fields.error("transform", "must be a similarity")
    x, y, z = axes(place)
    from_circle = f"(sqrt({x}*{x}+{y}*{y})-{sdl.number(major)})"
    surface = Surface(angle(x, y), angle(from_circle, z))
    body = f"torus {{ {place.length(major)}, {place.length(minor)} sturm rotate <90,0,0>"
    return Solid(body, surface, True)
