"""Twin of the material `conductor`: a `texture_map` of mirrors by the angle of incidence, POV-Ray's
pattern `aoi`.

POV-Ray 3.7 has the Fresnel equations for real indices only. Between two mirrors of the map it
interpolates linearly. So the reflectance is piecewise linear, with knots where its curvature is
largest, within 1e-6 of the formula.
"""

from __future__ import annotations

import bisect
import math
from typing import List, Tuple

from .. import sdl
from ..fields import REQUIRED
from . import Fields, Library, Material, Vector, finish

# Knots per map, of which POV-Ray allows 256, and number of maps.
CORNERS, MAPS = 200, 8
# Largest accepted error of the piecewise linear function.
ERROR = 1e-6
# Number of angles at which the curvature is evaluated.
FINE = 20000

# Index and extinction, from the model.
METALS = {
    "Ag": ((0.15528, 0.11673, 0.13839), (4.82835, 3.12222, 2.14690)),
    "Al": ((1.65750, 0.88040, 0.52124), (9.22381, 6.26950, 4.83700)),
    "Au": ((0.14304, 0.37531, 1.44205), (3.98300, 2.38556, 1.60336)),
    "Be": ((4.18501, 3.18503, 2.78406), (3.83547, 3.01012, 2.86899)),
    "Cr": ((4.36967, 2.91651, 1.65490), (5.20655, 4.23131, 3.75470)),
    "Cu": ((0.20101, 0.92375, 1.10222), (3.91326, 2.45305, 2.14209)),
    "Hg": ((2.39894, 1.44003, 0.90957), (6.32759, 4.37192, 3.42176)),
    "Ir": ((3.08630, 2.08219, 1.61791), (5.59215, 4.06709, 3.26731)),
    "Ni": ((2.36730, 1.66337, 1.46708), (4.49881, 3.05015, 2.34544)),
    "W": ((4.37082, 3.30025, 2.99841), (3.50064, 2.60487, 2.27323)),
}


def reflectance(eta: float, k: float, c: float) -> float:
    """R of the model at a cosine, in complex numbers: Fresnel amplitudes for the index eta + ik."""
    index = complex(eta, k)
    if index == 1 or c <= 0:
        return 0.0 if index == 1 and c > 0 else 1.0
    inside = (index * index - (1 - c * c)) ** 0.5
    r_s = (c - inside) / (c + inside)
    r_p = (index * index * c - inside) / (index * index * c + inside)
    return (abs(r_s) ** 2 + abs(r_p) ** 2) / 2


def corners(eta: Vector, k: Vector) -> List[float]:
    """Angles from 0 to 90 degrees, as far apart as the curvature of the reflectance allows."""
    step = math.pi / 2 / FINE
    rows = [[reflectance(e, x, math.cos(n * step)) for n in range(FINE + 1)] for e, x in zip(eta, k)]
    density = [0.0]
    for n in range(1, FINE):
        bend = max(abs(row[n - 1] - 2 * row[n] + row[n + 1]) for row in rows)
        density.append(density[-1] + math.sqrt(bend) + 1e-5)
    density.append(density[-1])
    count = CORNERS * MAPS
    found = [bisect.bisect_left(density, density[-1] * number / count) * step for number in range(count)]
    return sorted({0.0, *found, math.pi / 2})


def _indices(fields: Fields) -> Tuple[Vector, Vector]:
    if fields.has("metal"):
        metal = fields.choice("metal", "", tuple(METALS))
        for key in ("eta", "k"):
            if fields.has(key):
                fields.take(key)
                fields.error(key, "cannot be given together with `metal`")
        return tuple(map(fields.seen, METALS[metal]))
    eta, k = fields.color("eta", REQUIRED, 1000.0), fields.color("k", REQUIRED, 1000.0)
    if not all(component > 0 for component in eta) and not fields.context.errors:
        fields.error("eta", "expected components > 0")
    return tuple(component or 1.0 for component in eta), k


def error(angles: List[float], eta: Vector, k: Vector) -> float:
    """The error of the piecewise linear function half way between its knots."""
    worst = 0.0
    for e, x in zip(eta, k):
        values = [reflectance(e, x, math.cos(angle)) for angle in angles]
        for a, b, first, last in zip(angles, angles[1:], values, values[1:]):
            worst = max(worst, abs(reflectance(e, x, math.cos((a + b) / 2)) - (first + last) / 2))
    return worst


def twin(fields: Fields, textures: Library, ambient: Vector) -> Material:
    """`metal` or `eta` and `k`, `tint`."""
    eta, k = _indices(fields)
    tint = textures.value(fields, "tint", 1.0, 1.0)
    angles = corners(eta, k)
    if error(angles, eta, k) > ERROR:
        fields.unsupported("the twin interpolates the reflectance linearly by the angle, and this one bends too sharply: eta below 1 with a small k")

    def mirror(angle: float, color: Vector) -> str:
        seen = [t * reflectance(e, x, math.cos(angle)) for t, e, x in zip(color, eta, k)]
        # `aoi` is 1 along the normal and 1/2 across it.
        return f"[{_aoi(angle)} pigment {{ rgb 0 }} {finish(more=f'phong 0 specular 0 reflection {{ {sdl.rgb(seen)} }}')}]"

    def look(color: Vector) -> str:
        maps = []
        for first in reversed(range(0, len(angles) - 1, CORNERS)):
            part = angles[first : first + CORNERS + 1]
            inner = f"aoi texture_map {{ {' '.join(mirror(angle, color) for angle in reversed(part))} }}"
            maps.append(f"[{_aoi(part[-1])} {inner}] [{_aoi(part[0])} {inner}]")
        return f"aoi texture_map {{ {' '.join(maps)} }}"

    return Material(lambda surface: f"texture {{ {tint.choose(surface, look)} }}", branches=True)


def _aoi(angle: float) -> str:
    return sdl.number(1 - angle / math.pi)
