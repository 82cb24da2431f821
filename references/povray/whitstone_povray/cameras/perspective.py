"""Twin of the camera `perspective`: POV-Ray's own, given by vectors."""

from __future__ import annotations

import math

from . import Camera, Fields, placed, window_of


def twin(fields: Fields, width: int, height: int) -> Camera:
    """`fov` or `window`; no near limit."""
    if fields.number("near", 0.0) != 0:
        fields.unsupported("POV-Ray's perspective camera has no near limit", "near")
    fields.choice("near_kind", "planar", ("planar", "spherical"))
    return view(fields, width, height)


def view(fields: Fields, width: int, height: int) -> Camera:
    """`fov` or `window`."""
    given = window_of(fields, "fov")
    if given is not None:
        return placed(fields, "perspective", *given, width, height)
    fov = fields.number("fov", 45.0, lambda angle: 0 < angle < 180, "an angle between 0 and 180 degrees")
    axis = fields.choice("fov_axis", "x", ("x", "y", "smaller", "larger"))
    half = math.tan(math.radians(fov) / 2)
    if axis == "x" or (axis == "smaller" and width <= height) or (axis == "larger" and width >= height):
        x, y = half, half * height / width
    else:
        x, y = half * width / height, half
    return placed(fields, "perspective", (-x, x, -y, y), 1.0, width, height)
