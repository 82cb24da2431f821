"""Twin of the camera `orthographic`: POV-Ray's own, given by vectors."""

from __future__ import annotations

from . import Camera, Fields, no_near, placed, window_of


def twin(fields: Fields, width: int, height: int) -> Camera:
    """`width` or `window`; no near limit."""
    no_near(fields)
    given = window_of(fields, "width")
    if given is not None:
        return placed(fields, "orthographic", given[0], 1.0, width, height)
    x = fields.number("width", 2.0, lambda metres: metres > 0, "a width > 0 in metres") / 2
    y = x * height / width
    return placed(fields, "orthographic", (-x, x, -y, y), 1.0, width, height)
