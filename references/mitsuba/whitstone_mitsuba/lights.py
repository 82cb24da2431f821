"""Lights: point, directional, spot, ambient, background (model §7).

Each lamp that has a direction becomes a Mitsuba emitter whose `sample_direction` gives direction, distance and irradiance.
`falloff = "none"` has no native twin: the emitter is a Python plugin that undoes the native one's inverse square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import numpy as np

from .fields import REQUIRED, Fields, Vector, nearest
from .runtime import dr, mi


class NoFalloff(mi.Emitter):
    """A point or spot light whose irradiance does not fall with the distance: the nested native emitter's, times d²."""

    def __init__(self, props: "mi.Properties") -> None:
        mi.Emitter.__init__(self, props)
        self.inner = props["inner"]
        self.m_flags = mi.EmitterFlags.DeltaPosition

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        ds, value = self.inner.sample_direction(it, sample, active)
        return ds, value * dr.square(ds.dist)

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return mi.Float(0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.inner.eval_direction(it, ds, active) * dr.square(ds.dist)

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(0)

    def bbox(self) -> Any:
        return self.inner.bbox()

    def to_string(self) -> str:
        return f"NoFalloff[{self.inner}]"


mi.register_emitter("whitstone_no_falloff", lambda props: NoFalloff(props))

Hosted = Optional[Tuple[str, str]]


def _rgb(value: Vector) -> dict:
    return {"type": "rgb", "value": list(value)}


@dataclass(frozen=True)
class Lamp:
    """A light with a direction. `index` is its number in the document."""

    index: int
    plugin: dict
    finite: bool
    falloff: bool
    type: str

    def hosted(self) -> Hosted:
        """(plugin type, reason) where the twin is not Mitsuba's own."""
        return None if self.falloff else (self.type, 'falloff = "none" is a Python emitter around the native one')

    def build(self) -> "mi.Emitter":
        inner = mi.load_dict(self.plugin)
        return inner if self.falloff else mi.load_dict({"type": "whitstone_no_falloff", "inner": inner})


@dataclass(frozen=True)
class Lights:
    """All lights of a scene: lamps in the document's order, the sums of the others."""

    lamps: Tuple[Lamp, ...]
    ambient: Vector
    ambients: Tuple[Tuple[int, Vector], ...]
    background: Vector

    def background_emitter(self) -> "mi.Emitter":
        return mi.load_dict({"type": "constant", "radiance": _rgb(self.background)})


def facing(forward: np.ndarray) -> np.ndarray:
    """A 3x3 rotation whose third column is `forward` (unit length); the other two are any that fit."""
    helper = np.eye(3)[np.argmin(np.abs(forward))]
    x = np.cross(helper, forward)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(forward, x), forward])


def _direction(fields: Fields, key: str, value: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(value)
    if not length > 0:
        fields.error(key, "must have a direction (its length is zero)")
        return np.array([0.0, 0.0, 1.0])
    return value / length


def _falloff(fields: Fields) -> bool:
    return fields.choice("falloff", "inverse_square", ("inverse_square", "none")) == "inverse_square"


def _point(fields: Fields, index: int) -> Lamp:
    position = fields.vector("position", REQUIRED)
    intensity = fields.color("intensity", REQUIRED)
    plugin = {"type": "point", "position": list(position), "intensity": _rgb(intensity)}
    return Lamp(index, plugin, True, _falloff(fields), "point")


def _directional(fields: Fields, index: int) -> Lamp:
    direction = _direction(fields, "direction", np.array(fields.vector("direction", REQUIRED)))
    irradiance = fields.color("irradiance", REQUIRED)
    plugin = {"type": "directional", "direction": direction.tolist(), "irradiance": _rgb(irradiance)}
    return Lamp(index, plugin, False, True, "directional")


def _spot(fields: Fields, index: int) -> Lamp:
    position = np.array(fields.vector("position", REQUIRED))
    target = np.array(fields.vector("target", REQUIRED))
    intensity = fields.color("intensity", REQUIRED)
    cutoff = fields.number("cutoff_angle", 20.0, lambda angle: 0 < angle < 90, "a half angle between 0 and 90 degrees")
    expected = f"a half angle from 0 to below the cutoff of {cutoff:g} degrees"
    beam = fields.number("beam_width", 0.75 * cutoff, lambda angle: 0 <= angle < cutoff, expected)
    matrix = np.eye(4)
    matrix[:3, :3] = facing(_direction(fields, "target", target - position))
    matrix[:3, 3] = position
    plugin = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f(matrix),
        "intensity": _rgb(intensity),
        "cutoff_angle": cutoff,
        "beam_width": beam,
    }
    return Lamp(index, plugin, True, _falloff(fields), "spot")


LAMPS = {"point": _point, "directional": _directional, "spot": _spot}


def read(tables: Any, errors: List[str], unsupported: List[str]) -> Lights:
    """The `[[light]]` tables."""
    lamps: List[Lamp] = []
    ambients: List[Tuple[int, Vector]] = []
    background = np.zeros(3)
    if not isinstance(tables, list):
        errors.append("light: expected an array of tables, [[light]]")
        tables = []
    for index, table in enumerate(tables):
        fields = Fields(table, f"light[{index}]", errors)
        kind = fields.kind()
        if kind in LAMPS:
            lamps.append(LAMPS[kind](fields, index))
        elif kind == "ambient":
            ambients.append((index, fields.color("radiance", REQUIRED)))
        elif kind == "background":
            background = background + np.array(fields.color("radiance", REQUIRED))
        else:
            if kind is not None:
                known = [*LAMPS, "ambient", "background"]
                unsupported.append(f"light[{index}]: no twin for a light of type {kind!r}; {nearest(kind, known)}")
            continue
        fields.close()
    ambient = np.sum([value for _, value in ambients], axis=0) if ambients else np.zeros(3)
    return Lights(tuple(lamps), tuple(ambient), tuple(ambients), tuple(background))
