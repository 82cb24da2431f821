"""Textures made of other textures: product, mix and threshold; and vertex_color, which reads the
attributes of meshes (model §10).

The parts are looked up as always; their values are combined in float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator, Sequence, Tuple

import numpy as np

from .runtime import dr, mi

# Upper bounds on the nesting depth (model §10), and on the lookups of one texture.
MAX_NESTING = 16
MAX_LEAVES = 4096


def leaves(texture: Any) -> Iterator[Any]:
    """The textures that a texture is made of, except product, mix and threshold."""
    parts = getattr(texture, "parts", None)
    if parts is None:
        yield texture
    else:
        for part in parts:
            yield from leaves(part)


def by_uv(texture: Any) -> bool:
    """Whether a texture depends on the texture coordinates of the shape."""
    return any(leaf.mapping.projection == "uv" for leaf in leaves(texture) if hasattr(leaf, "mapping"))


def depth(texture: Any) -> int:
    """Number of compound textures that are inside each other."""
    return getattr(texture, "depth", 0)


def size(texture: Any) -> int:
    """Number of leaves."""
    return getattr(texture, "size", 1)


Range = Tuple[float, float]


def _products(a: Range, b: Range) -> Range:
    # An infinite bound is not a value: its product with 0 is 0.
    found = [0.0 if 0.0 in (x, y) else x * y for x in a for y in b]
    return min(found), max(found)


@dataclass(frozen=True)
class Compound:
    """A texture that is computed from the values of other ones."""

    parts: Tuple[Any, ...]
    depth: int
    size: int

    @classmethod
    def of(cls, parts: Sequence[Any], *more: Any) -> Any:
        return cls(tuple(parts), 1 + max(map(depth, parts)), sum(map(size, parts)), *more)

    def combine(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """The result, (n, 3), from the values of all parts."""
        raise NotImplementedError

    def build(self) -> "mi.Texture":
        return Combined(self)


@dataclass(frozen=True)
class Product(Compound):
    """The product of all parts."""

    def combine(self, values: Sequence[np.ndarray]) -> np.ndarray:
        total = values[0]
        for value in values[1:]:
            total = total * value
        return total

    def range(self) -> Range:
        total = (1.0, 1.0)
        for part in self.parts:
            total = _products(total, part.range())
        return total


@dataclass(frozen=True)
class Mix(Compound):
    """The parts are a, b and weight."""

    def combine(self, values: Sequence[np.ndarray]) -> np.ndarray:
        a, b, w = values
        return a * (1 - w) + b * w

    def range(self) -> Range:
        a, b, w = (part.range() for part in self.parts)
        # The model limits the weight; values out of its range are not checked.
        low, high = min(max(w[0], 0.0), 1.0), min(max(w[1], 0.0), 1.0)
        ends = [_sum(_products(a, (1 - t, 1 - t)), _products(b, (t, t))) for t in (low, high)]
        return min(end[0] for end in ends), max(end[1] for end in ends)


def _sum(a: Range, b: Range) -> Range:
    return a[0] + b[0], a[1] + b[1]


@dataclass(frozen=True)
class Threshold(Compound):
    """1 where the only part is at least `at`, else 0."""

    at: float = 0.5

    def combine(self, values: Sequence[np.ndarray]) -> np.ndarray:
        # Native textures are single precision: the nearest such number to `at` counts as `at`.
        return np.where(values[0].astype(np.float32) >= np.float32(self.at), 1.0, 0.0)

    def range(self) -> Range:
        low, high = self.parts[0].range()
        return (1.0 if low >= self.at else 0.0), (1.0 if high >= self.at else 0.0)


class Combined(mi.Texture):
    """A compound texture as a Mitsuba texture."""

    def __init__(self, texture: Compound) -> None:
        mi.Texture.__init__(self, mi.Properties())
        self.texture = texture
        self.parts = [part.build() for part in texture.parts]

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `place`, which has `p`, `uv` and `sh_frame.n` like `si`."""
        return self.texture.combine([values(part, si, place) for part in self.parts])

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(np.ascontiguousarray(self.values(si, si).T.astype(np.float32)))

    def to_string(self) -> str:
        return f"Combined[{type(self.texture).__name__}]"


def values(part: Any, si: Any, place: Any) -> np.ndarray:
    """(n, 3) colours of any texture at `place`, which has `p`, `uv` and `sh_frame.n` like `si`; n is
    1 if the texture is constant.
    """
    if hasattr(part, "values"):
        return part.values(si, place)
    if place is not si:
        # Mitsuba's own textures look at (u, v) only.
        si = mi.SurfaceInteraction3f(si)
        si.uv = mi.Point2f(np.ascontiguousarray(np.array(place.uv), dtype=np.float32))
    return np.array(mi.Color3f(part.eval(si)), dtype=np.float64).reshape(3, -1).T


class Still:
    """A texture that counts as constant around a point."""

    def __init__(self, part: Any) -> None:
        self.part = part

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `si`, whatever the place."""
        return values(self.part, si, si)


def exact(texture: Any) -> Any:
    """A built texture that uses coordinates in double precision where it can. Mitsuba's own textures
    round them to single precision, which makes differences over small steps inaccurate.
    """
    if isinstance(texture, Compound):
        combined = Combined(texture)
        combined.parts = [exact(part) for part in texture.parts]
        return combined
    return texture.exact() if hasattr(texture, "exact") else texture.build()


def smooth(texture: Any) -> Any:
    """A built texture whose `values` have double precision, so that derivatives can be measured by
    differences: Mitsuba's own textures have single precision.
    """
    if isinstance(texture, Compound):
        combined = Combined(texture)
        combined.parts = [smooth(part) for part in texture.parts]
        return combined
    if hasattr(texture, "smooth"):
        return texture.smooth()
    built = texture.build()
    return built if hasattr(built, "values") else Still(built)


@dataclass(frozen=True)
class VertexColor:
    """The colour of the vertices of a mesh, or their alpha."""

    alpha: bool = False

    def range(self) -> Range:
        # The values are those of the files; the model does not limit them.
        return 0.0, float("inf")

    def build(self) -> "mi.Texture":
        return VertexColors(self)


class VertexColors(mi.Texture):
    """Vertex colours as a Mitsuba texture: see `vertices`."""

    def __init__(self, texture: VertexColor) -> None:
        mi.Texture.__init__(self, mi.Properties())
        self.alpha = texture.alpha

    def eval(self, si: Any, active: Any = True) -> Any:
        stored = mi.Color3f(si.dn_du.z) if self.alpha else mi.Color3f(si.dn_dv)
        return dr.select(si.prim_index > 0, stored, mi.Color3f(1))

    def to_string(self) -> str:
        return f"VertexColors[alpha={self.alpha}]"


# What is computed in Python.
HOSTED = (Compound, VertexColor)
