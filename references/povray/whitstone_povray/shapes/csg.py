"""Twin of the shape `csg`: POV-Ray's `merge`, `intersection` and `difference`."""

from __future__ import annotations

from dataclasses import replace
from typing import Optional

from .. import registry, transforms
from ..errors import Unsupported
from ..textures import Point
from . import INSIDE, Fields, Place, Solid, Surface

# Half size in metres of the box that replaces a plane; POV-Ray sees little beyond.
_FAR = 1e4
_NAMES = {"union": "merge", "intersection": "intersection", "difference": "difference"}
# Upper bounds on the nesting depth and the number of operands (model §9).
_MAX_NESTING = 16
_MAX_OPERANDS = 256


class _OfOperands:
    """Texture coordinates of the operand that is visible: they have no twin if they are used. The
    world-space position is known.
    """

    mapped = False

    def __init__(self, world: Point = ("x", "y", "z")) -> None:
        self.world = world

    def placed(self, matrix: transforms.Matrix, scale: float) -> "_OfOperands":
        """See `Surface`."""
        return _OfOperands(Surface("0", "0").placed(matrix, scale).world)

    @property
    def u(self) -> str:
        """Not a single expression."""
        raise Unsupported("shape: POV-Ray has no twin of texture coordinates on a csg: they are those of its operands")

    v = u


def _operand(table: object, where: str, fields: Fields, place: Place, depth: int) -> Optional[Solid]:
    """A closed operand, with its transform relative to the result."""
    inner = Fields(table, where, fields.context)
    plane = isinstance(table, dict) and table.get("type") == "plane"
    nested = isinstance(table, dict) and table.get("type") == "csg"
    if nested and depth == _MAX_NESTING:
        inner.error("", f"operands are nested more than {_MAX_NESTING} deep")
        return None
    found = registry.find("shapes", inner)
    if found is None:
        return None
    own = transforms.read(inner.take("transform"), f"{where}.transform", fields.context)
    stands = Place(place.setting, transforms.product(place.own, own))
    solid = _twin(inner, stands, depth + 1) if nested else found(inner, stands)
    inner.close()
    # POV-Ray 3.7 clips the bounding box of a difference by a rotated plane, and loses parts. So a
    # box replaces planes.
    body = f"box {{ {place.point((-_FAR, -_FAR, -_FAR))}, {place.point((_FAR, _FAR, 0))}" if plane else solid.body
    if not (plane or solid.closed):
        inner.error("", "is not closed, so it cannot be an operand")
    if solid.matrix is not None:
        # A mesh is in world space already, so the enclosing transform must be undone.
        own = transforms.inverse(place.own)
        body = f"{body} {INSIDE}"
    return replace(solid, body=f"{body} {transforms.write(own, place.setting.scale)} }}")


def _twin(fields: Fields, place: Place, depth: int) -> Solid:
    operation = fields.choice("operation", "", tuple(_NAMES))
    tables = fields.take("operands")
    if not isinstance(tables, list) or not 2 <= len(tables) <= _MAX_OPERANDS:
        fields.error("operands", f"expected 2 to {_MAX_OPERANDS} tables of shapes")
        tables = []
    found = [_operand(table, f"{fields.where}.operands[{number}]", fields, place, depth) for number, table in enumerate(tables)]
    operands = [operand for operand in found if operand is not None]
    inside = "\n  ".join(operand.body for operand in operands)
    head = "\n".join(operand.head for operand in operands if operand.head)
    return Solid(f"{_NAMES[operation]} {{\n  {inside}", _OfOperands(), True, smooth=any(o.smooth for o in operands), head=head)


def twin(fields: Fields, place: Place) -> Solid:
    """`operation`, `operands`."""
    return _twin(fields, place, 1)
