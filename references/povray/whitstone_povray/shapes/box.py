"""Twin of the shape `box`: POV-Ray's `box`."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, axes, coincident


def twin(fields: Fields, place: Place) -> Solid:
    """No keys."""
    x, y, z = axes(place)
    # The face is that of the axis along which the point is farthest out; on an edge the first of
    # them, also for rounded points. `select` returns its second argument if the first is below 0.
    edge = "1e-9"

    def by_face(on_x: str, on_y: str, on_z: str) -> str:
        later = f"select(abs({z})-abs({y})-{edge},{on_y},{on_z})"
        return f"(select(max(abs({y}),abs({z}))-abs({x})-{edge},{on_x},{later})+1)/2"

    body = f"box {{ {place.point((-1, -1, -1))}, {place.point((1, 1, 1))}"
    return Solid(body, Surface(by_face(y, z, x), by_face(z, x, y)), True, outline=coincident.box())
