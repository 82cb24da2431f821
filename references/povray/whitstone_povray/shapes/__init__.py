"""Shapes (model §9): `twin(fields, place)` gives a `Solid`.

A twin writes its object in the shape's own space, in POV-Ray's units: lengths through
`place.length`, points through `place.point`. What stands around it (texture, interior, transform,
instances) is put there by `document`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterable, List, Optional

from .. import sdl
from ..fields import REQUIRED, Fields, Vector
from ..settings import Setting
from ..textures import Surface
from ..transforms import IDENTITY, Matrix, similarity

__all__ = ["REQUIRED", "Fields", "Matrix", "Place", "Solid", "Surface", "Vector", "axes", "similarity"]


# A direction in which POV-Ray looks for the outside of a mesh, along no edge of ours.
INSIDE = "inside_vector <0.2113, 0.6247, 0.7517>"


@dataclass(frozen=True)
class Place:
    """Where a shape stands."""

    setting: Setting
    # The shape's own transform, without those of instances around it.
    own: Matrix

    def length(self, metres: float) -> str:
        """In POV-Ray's units."""
        return sdl.number(metres * self.setting.scale)

    def point(self, metres: Iterable[float]) -> str:
        """In POV-Ray's units."""
        return sdl.vector(component * self.setting.scale for component in metres)


@dataclass(frozen=True)
class Solid:
    """An object of POV-Ray."""

    # Open: textures, interior and transforms follow, and `}`.
    body: str
    surface: Surface
    # Whether it bounds a volume, so that light can enter and leave it.
    closed: bool
    # The transform that is still to be applied: `place.own`, unless the twin has done so.
    matrix: Optional[Matrix] = None
    # Whether its normals are interpolated.
    smooth: bool = False
    # What must be declared before the object.
    head: str = ""


def axes(place: Place) -> List[str]:
    """Expressions for the coordinates in the shape's own space, in metres."""
    per_unit = sdl.number(1 / place.setting.scale)
    return [f"({name}*{per_unit})" for name in "xyz"]


def baked() -> Matrix:
    """For a twin that has applied `place.own` itself."""
    return IDENTITY


def angle(x: str, y: str) -> str:
    """phi/2pi of the point (x, y), in [0, 1)."""
    return f"select(atan2({y},{x}),atan2({y},{x})/(2*pi)+1,atan2({y},{x})/(2*pi))"
