"""What the twins of round shapes have in common: quadrics of POV-Ray, cut by boxes, and their
texture coordinates.
"""

from __future__ import annotations

import math
from typing import Sequence, Tuple

from . import Fields, Place, Solid, Surface, angle, axes, sdl

# Points are on a cap if they are so near to it, in heights of the shape.
_ON_CAP = 1e-7


def heights(fields: Fields, default: Tuple[float, float], least: float = -math.inf) -> Tuple[float, float]:
    """`z`: where the shape begins and ends."""
    low, high = fields.vector("z", default, 2)
    if not low < high:
        fields.error("z", f"expected two heights in ascending order, found {[low, high]}")
    if low < least:
        fields.error("z", f"expected heights of at least {least:g}, found {low}")
    return low, high


def around(place: Place, z: Tuple[float, float], radii: Tuple[float, float], caps: bool) -> Surface:
    """Texture coordinates about the z axis: on the side the angle and the height, on caps the
    distance and the angle.
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
    """POV-Ray's `quadric` for ten coefficients in metres, without its end: those of squares and
    products, of x, y, z, and the constant.
    """
    scale = place.setting.scale
    linear, constant = [scale * c for c in coefficients[6:9]], scale * scale * coefficients[9]
    # The box that POV-Ray 3.7 puts around a hyperboloid is right only if the constant is 1 or -1
    # once squares are completed.
    at_center = constant - sum(b * b / (4 * a) for a, b in zip(coefficients[:3], linear) if a != 0)
    size = abs(at_center) or 1.0
    squares, products, linear = ([c / size for c in part] for part in (coefficients[:3], coefficients[3:6], linear))
    return f"quadric {{ {sdl.vector(squares)}, {sdl.vector(products)}, {sdl.vector(linear)}, {sdl.number(constant / size)}"


def cut(place: Place, body: str, low: Sequence[float], high: Sequence[float], caps: bool) -> str:
    """An object without its end, as far as it is in a box: closed by the faces of the box, or open.
    """
    box = f"box {{ {place.point(low)}, {place.point(high)} }}"
    if caps:
        return f"intersection {{ {body} }} {box}"
    return f"{body} clipped_by {{ {box} }} bounded_by {{ clipped_by }}"


def turned(
    place: Place, z: Tuple[float, float], radii: Tuple[float, float], coefficients: Sequence[float], caps: bool
) -> Solid:
    """A quadric about the z axis, with its radii where it ends: the widest."""
    wide = 2.0 * max(radii)
    body = cut(place, quadric(place, coefficients), (-wide, -wide, z[0]), (wide, wide, z[1]), caps)
    return Solid(body, around(place, z, radii, caps), caps)
