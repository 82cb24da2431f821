"""Lights (model §7): `twin(fields)` returns a `Light`.

A point light in POV-Ray falls off by `2 / (1 + (r / fade_distance)^2)`. With a fade distance that
is small compared with r, this is the inverse square to a relative (fade_distance / r)^2: below 1e-6
beyond 1 mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

from .. import registry, sdl
from ..fields import Context, Fields, Vector

# In metres.
FADE_DISTANCE = 1e-6
BLACK: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Light:
    """The parts of a light in the scene: POV-Ray objects, an ambient radiance, a background."""

    objects: str = ""
    ambient: Vector = BLACK
    background: Vector = BLACK
    # Its position, and the radius of an object around it that filters light.
    position: Optional[Vector] = None
    shell: float = 0.0


@dataclass(frozen=True)
class Lights:
    """All lights together."""

    objects: Tuple[str, ...]
    ambient: Vector
    background: Vector


def exposed(fields: Fields, color: Vector) -> Vector:
    """The colour, scaled by the exposure of this rendering."""
    return tuple(fields.context.setting.exposure * component for component in color)


def point_source(fields: Fields, position: Vector, intensity: Vector) -> str:
    """A `light_source` without its closing brace: intensity in W/sr, with the table's `falloff`."""
    scale = fields.context.setting.scale
    falls = fields.choice("falloff", "inverse_square", ("inverse_square", "none")) == "inverse_square"
    gain = 0.5 / FADE_DISTANCE**2 if falls else 1.0
    fading = f" fade_distance {sdl.number(FADE_DISTANCE * scale)} fade_power 2" if falls else ""
    color = [gain * component for component in exposed(fields, intensity)]
    return f"light_source {{ {sdl.vector([scale * c for c in position])} {sdl.rgb(color)}{fading}"


def read(tables: Any, context: Context) -> Lights:
    """Reads the `[[light]]` tables."""
    lights: List[Light] = []
    for index, table in enumerate(tables):
        fields = Fields(table, f"light[{index}]", context)
        twin = registry.find("lights", fields)
        if twin is not None:
            light = twin(fields)
            fields.close()
            for other in lights:
                if light.position and other.position and math.dist(light.position, other.position) <= light.shell + other.shell:
                    fields.unsupported("the twin of a spot light is a shell, which would also filter another light at the same place")
            lights.append(light)

    def total(colors: List[Vector]) -> Vector:
        return tuple(sum(components) for components in zip(*colors, BLACK))

    objects = tuple(light.objects for light in lights if light.objects)
    return Lights(objects, total([light.ambient for light in lights]), total([light.background for light in lights]))
