"""Twin of the shape `triangle`: POV-Ray's `triangle` or `smooth_triangle`, in double precision."""

from __future__ import annotations

from .. import transforms
from ..transforms import cross, dot, point, sub
from . import Fields, Place, Solid, Surface, baked, coincident, sdl


def twin(fields: Fields, place: Place) -> Solid:
    """`vertices`, `normals`, `uvs`."""
    vertices = fields.vectors("vertices", 3, 3)
    if vertices is None:
        fields.error("vertices", "is required")
        vertices = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    normals = fields.vectors("normals", 3, 3)
    uvs = fields.vectors("uvs", 3, 2) or [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]
    # Normals are normalised at the vertices after the shape's own transform.
    a, b, c = (point(place.own, vertex) for vertex in vertices)
    e, f = sub(b, a), sub(c, a)
    n = cross(e, f)
    area = dot(n, n)
    # The barycentric coordinates of b and c as functions of the point.
    of_b, of_c = ([component / area for component in cross(side, n)] if area > 0 else [0.0] * 3 for side in (f, e))
    of_c = [-component for component in of_c]

    def coordinate(k: int) -> str:
        along = [(uvs[1][k] - uvs[0][k]) * p + (uvs[2][k] - uvs[0][k]) * q for p, q in zip(of_b, of_c)]
        terms = (f"{sdl.number(g)}*({x}*{sdl.number(1 / place.setting.scale)}-{sdl.number(o)})" for g, x, o in zip(along, "xyz", a))
        return f"{sdl.number(uvs[0][k])}+" + "+".join(terms)

    surface = Surface(coordinate(0), coordinate(1))
    outline = coincident.sheet(vertices, cross(sub(vertices[1], vertices[0]), sub(vertices[2], vertices[0])))
    corners = list(map(place.point, (a, b, c)))
    if normals is None:
        return Solid(f"triangle {{ {', '.join(corners)}", surface, False, baked(), outline=outline)
    turned = [sdl.vector(transforms.normal(place.own, normal)) for normal in normals]
    pairs = ", ".join(f"{corner}, {normal}" for corner, normal in zip(corners, turned))
    return Solid(f"smooth_triangle {{ {pairs}", surface, False, baked(), smooth=True, outline=outline)
