"""The common part of the twins of round shapes: POV-Ray's quadrics, clipped by boxes, and their
texture coordinates.
"""

from __future__ import annotations

import math
from typing import Sequence, Tuple

from . import Fields, Place, Solid, Surface, angle, axes, coincident, sdl

# Points this close to a cap, relative to the height of the shape, lie on it.
_ON_CAP = 1e-7


def heights(fields: Fields, default: Tuple[float, float], least: float = -math.inf) -> Tuple[float, float]:
    """`z`: the lower and upper end of the shape."""
    low, high = fields.vector("z", default, 2)
    if not low < high:
        fields.error("z", f"expected two heights in ascending order, found {[low, high]}")
    if low < least:
        fields.error("z", f"expected heights of at least {least:g}, found {low}")
    return low, high


def around(place: Place, z: Tuple[float, float], radii: Tuple[float, float], caps: bool) -> Surface:
    """Texture coordinates about the z axis: angle and height on the side, distance and angle on
    caps.
    """
    x, y, height = axes(place)
    (low, high), near = z, sdl.number(_ON_CAP * (z[1] - z[0]))
    turn, up = angle(x, y), f"(({height}-{sdl.number(low)})/{sdl.number(high - low)})"
    if not caps:
        return Surface(turn, up)

    def by_part(at_low: str, at_high: str, side: str) -> str:
        above = f"select({sdl.number(high)}-{height}-{near},{at_high},{side})" if radii[1] > 0 else side
        return f"select({height}-{sdl.number(low)}-{near},{at_low},{above})" if radii[0] > 0 else above

    out = [f"(sqrt({x}*{x}+{y}*{y})/{sdl.number(radius or 1.0)})" for radius in radii]
    return Surface(by_part(out[0], out[1], turn), by_part(turn, turn, up))


def quadric(place: Place, coefficients: Sequence[float]) -> str:
    """POV-Ray's `quadric` without its closing brace, from ten coefficients in metres: those of
    squares and products, of x, y, z, and the constant.
    """
    scale = place.setting.scale
    linear, constant = [scale * c for c in coefficients[6:9]], scale * scale * coefficients[9]
    # The bounding box that POV-Ray 3.7 computes for a hyperboloid is correct only if the constant
    # is 1 or -1 after completing the squares.
    at_center = constant - sum(b * b / (4 * a) for a, b in zip(coefficients[:3], linear) if a != 0)
    size = abs(at_center) or 1.0
    squares, products, linear = ([c / size for c in part] for part in (coefficients[:3], coefficients[3:6], linear))
    return f"quadric {{ {sdl.vector(squares)}, {sdl.vector(products)}, {sdl.vector(linear)}, {sdl.number(constant / size)}"


def cut(place: Place, body: str, low: Sequence[float], high: Sequence[float], caps: bool) -> str:
    """An object without its closing brace, clipped by a box: closed by the faces of the box, or
    open.
    """
    box = f"box {{ {place.point(low)}, {place.point(high)} }}"
    if caps:
        return f"intersection {{ {body} }} {box}"
    return f"{body} clipped_by {{ {box} }} bounded_by {{ clipped_by }}"


def turned(
    place: Place, z: Tuple[float, float], radii: Tuple[float, float], coefficients: Sequence[float], caps: bool
) -> Solid:
    """A quadric about the z axis, with its radii at both ends, of which the larger one is the
    widest.
    """
    wide = 2.0 * max(radii)
    body = cut(place, quadric(place, coefficients), (-wide, -wide, z[0]), (wide, wide, z[1]), caps)
    return Solid(body, around(place, z, radii, caps), caps, outline=coincident.capped(z, radii, caps, False))
