"""Twin of the camera `orthographic`: POV-Ray's own, given by vectors."""

from __future__ import annotations

from dataclasses import replace

from . import Camera, Fields, placed, window_of


def twin(fields: Fields, width: int, height: int) -> Camera:
    """`width` or `window`; all rays start `near` metres further on."""
    near = fields.number("near", 0.0)
    given = window_of(fields, "width")
    if given is None:
        x = fields.number("width", 2.0, lambda metres: metres > 0, "a width > 0 in metres") / 2
        y = x * height / width
        window = (-x, x, -y, y)
    else:
        window = given[0]
    camera = placed(fields, "orthographic", window, 1.0, width, height)
    backwards = camera.axes[2]
    return replace(camera, origin=tuple(e - near * r for e, r in zip(camera.origin, backwards)))
