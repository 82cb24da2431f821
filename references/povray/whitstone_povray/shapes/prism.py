"""Twin of the shape `prism`: POV-Ray's `prism`, which is swept along y as well."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, axes, coincident, sdl
from ._outline import LEAST_AREA, Point, points, share, size, twice_area

# Points this close to a cap, relative to the height of the shape, lie on it.
_ON_CAP = 1e-7


def _faces(outline: list[Point], heights: tuple[float, float]) -> coincident.Outline:
    low, high = heights
    sense = 1.0 if twice_area(outline) > 0 else -1.0
    flats = []
    for (x, z), (other_x, other_z) in zip(outline, outline[1:] + outline[:1]):
        corners = ((x, low, z), (other_x, low, other_z), (other_x, high, other_z), (x, high, z))
        flats.append(coincident.Flat(corners, (sense * (other_z - z), 0.0, -sense * (other_x - x))))
    for end, (height, up) in enumerate(((low, -1.0), (high, 1.0))):
        flats.append(coincident.Flat(tuple((x, height, z) for x, z in outline), (0.0, up, 0.0), (1, end)))
    every = [corner for flat in flats[-2:] for corner in flat.corners]
    columns = list(zip(*every))
    return coincident.Outline(every, lambda: flats, True, (tuple(map(min, columns)), tuple(map(max, columns))))


def twin(fields: Fields, place: Place) -> Solid:
    """`outline`, `y`."""
    outline = points(fields, 3, [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    if abs(twice_area(outline)) <= LEAST_AREA * size(outline) ** 2:
        fields.error("outline", "encloses no area")
    low, high = fields.vector("y", (0.0, 1.0), 2)
    if not low < high:
        fields.error("y", f"expected two heights in ascending order, found {[low, high]}")
    x, y, z = axes(place)
    near = sdl.number(_ON_CAP * (high - low))
    on_side = share(outline + outline[:1], x, z)
    up = f"(({y}-{sdl.number(low)})/{sdl.number(high - low)})"

    def by_part(cap: str, side: str) -> str:
        return f"select({y}-{sdl.number(low)}-{near},{cap},select({sdl.number(high)}-{y}-{near},{cap},{side}))"

    surface = Surface(by_part(z, on_side), by_part(x, up))
    scale = place.setting.scale
    ring = ", ".join(sdl.vector((p * scale, q * scale)) for p, q in outline + outline[:1])
    body = f"prism {{ linear_sweep linear_spline {place.length(low)}, {place.length(high)}, {len(outline) + 1}, {ring}"
    return Solid(body, surface, True, outline=_faces(outline, (low, high)))
