"""Twin of the camera `thin_lens`: POV-Ray's perspective camera at every lens sample (its own lens
is random).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Tuple

from ..fields import REQUIRED
from . import Camera, Fields, perspective


def _disk(p: float, q: float) -> Tuple[float, float]:
    """The model's map from the square to the disk."""
    if p == 0.0 and q == 0.0:
        return 0.0, 0.0
    s, phi = (p, math.pi / 4 * q / p) if abs(p) > abs(q) else (q, math.pi / 2 - math.pi / 4 * p / q)
    return s * math.cos(phi), s * math.sin(phi)


def twin(fields: Fields, width: int, height: int) -> Camera:
    """As `perspective`, with a lens."""
    camera = perspective.view(fields, width, height)
    aperture = fields.number("aperture", REQUIRED, lambda metres: metres >= 0, "a radius >= 0 in metres")
    focus = fields.number("focus_distance", REQUIRED, lambda metres: metres > 0, "a distance > 0 in metres")
    n = fields.integer("lens_samples", 4, 1, 64)
    points = [_disk(2 * (i + 0.5) / n - 1, 2 * (j + 0.5) / n - 1) for j in range(n) for i in range(n)]
    return replace(camera, lens=tuple((aperture * x, aperture * y) for x, y in points), focus=focus)
