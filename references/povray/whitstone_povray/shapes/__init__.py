"""Shapes (model §9): `twin(fields, place)` returns a `Solid`.

A twin writes its object in object space, in POV-Ray's units: lengths with `place.length`, points
with `place.point`. `document` adds texture, interior, transform and instances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterable, List, Optional

from .. import coincident, sdl
from ..fields import REQUIRED, Fields, Vector
from ..settings import Setting
from ..textures import Surface
from ..transforms import IDENTITY, Matrix, similarity

__all__ = ["REQUIRED", "Fields", "Matrix", "Place", "Solid", "Surface", "Vector", "axes", "coincident", "similarity"]


# The direction in which POV-Ray looks for the outside of a mesh; parallel to no edge of ours.
INSIDE = "inside_vector <0.2113, 0.6247, 0.7517>"


@dataclass(frozen=True)
class Place:
    """The placement of a shape."""

    setting: Setting
    # The shape's own transform, without those of enclosing instances.
    own: Matrix

    def length(self, metres: float) -> str:
        """A length in POV-Ray's units."""
        return sdl.number(metres * self.setting.scale)

    def point(self, metres: Iterable[float]) -> str:
        """A point in POV-Ray's units."""
        return sdl.vector(component * self.setting.scale for component in metres)


@dataclass(frozen=True)
class Solid:
    """A POV-Ray object."""

    # Without the closing brace: textures, interior and transforms follow.
    body: str
    surface: Surface
    # Whether it bounds a volume that light can enter and leave.
    closed: bool
    # The transform that remains to be applied: `place.own`, unless the twin has applied it.
    matrix: Optional[Matrix] = None
    # Whether its normals are interpolated.
    smooth: bool = False
    # Declarations that must precede the object.
    head: str = ""
    # Its surfaces that may coincide with those of other shapes; None if the model has no rule for
    # them.
    outline: Optional[coincident.Outline] = None


def axes(place: Place) -> List[str]:
    """Expressions for the object-space coordinates in metres."""
    per_unit = sdl.number(1 / place.setting.scale)
    return [f"({name}*{per_unit})" for name in "xyz"]


def baked() -> Matrix:
    """The remaining transform of a twin that has applied `place.own` itself."""
    return IDENTITY


def angle(x: str, y: str) -> str:
    """phi/2pi of the point (x, y), in [0, 1)."""
    return f"select(atan2({y},{x}),atan2({y},{x})/(2*pi)+1,atan2({y},{x})/(2*pi))"
