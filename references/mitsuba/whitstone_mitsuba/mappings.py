"""Texture mappings (model §10, `mapping`): the point of texture space for a surface point, in
float64.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Callable

import numpy as np

from . import transforms
from .fields import Fields
from .runtime import mi

PROJECTIONS = ("uv", "solid", "planar", "spherical", "cylindrical", "cube", "triplanar")


def _turn(q: np.ndarray) -> np.ndarray:
    """phi/2pi in [0, 1)."""
    phi = np.arctan2(q[:, 1], q[:, 0])
    return np.where(phi < 0, phi + 2 * np.pi, phi) / (2 * np.pi)


def project(projection: str, q: np.ndarray) -> np.ndarray:
    """(n, 3) points of texture space for (n, 3) points after the transform."""
    nothing = np.zeros(len(q))
    if projection in ("uv", "solid"):
        return q
    if projection == "planar":
        return np.column_stack([q[:, 0], q[:, 1], nothing])
    if projection == "spherical":
        theta = np.arctan2(np.hypot(q[:, 0], q[:, 1]), q[:, 2])
        return np.column_stack([_turn(q), (np.pi - theta) / np.pi, nothing])
    if projection == "cylindrical":
        return np.column_stack([_turn(q), q[:, 2], nothing])
    lanes, a = np.arange(len(q)), np.argmax(np.abs(q), axis=1)
    m = np.abs(q[lanes, a])
    with np.errstate(invalid="ignore"):
        return np.column_stack([(q[lanes, (a + 1) % 3] / m + 1) / 2, (q[lanes, (a + 2) % 3] / m + 1) / 2, nothing])


@dataclass(frozen=True)
class Mapping:
    """Projection, transform and sharpness of a mapping."""

    projection: str
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    sharpness: float = 4.0
    # Which texture coordinates of a mesh "uv" uses: 0, or 1 for the second set.
    uv_set: int = 0

    def usual(self) -> bool:
        """Whether it is the default mapping by (u, v), which Mitsuba's textures apply themselves.
        """
        return self.projection == "uv" and self.uv_set == 0 and np.array_equal(self.matrix, np.eye(4))

    def weights(self, normal: np.ndarray) -> np.ndarray:
        """(n, 3): blend weights of the projections of "triplanar", by n_s."""
        normal = np.abs(normal @ np.linalg.inv(self.matrix[:3, :3]))
        with np.errstate(invalid="ignore"):
            return (normal / normal.max(axis=1, keepdims=True)) ** self.sharpness

    def values(self, si: Any, at: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """(n, 3) colours at Mitsuba's surface interactions; `at` gives them for (n, 3) points of
        texture space.
        """
        uv = self.projection == "uv"
        if self.uv_set == 1:
            source = second_uv(si)
        else:
            source = np.array(si.uv if uv else si.p, dtype=np.float64).T
        if uv:
            source = np.column_stack([source, np.zeros(len(source))])
        q = source @ self.matrix[:3, :3].T + self.matrix[:3, 3]
        if self.projection != "triplanar":
            return at(project(self.projection, q))
        weight = self.weights(np.array(si.sh_frame.n, dtype=np.float64).T)
        total = np.zeros((len(q), 3))
        for a in range(3):
            place = np.column_stack([q[:, (a + 1) % 3], q[:, (a + 2) % 3], np.zeros(len(q))])
            total += weight[:, [a]] * at(place)
        return total / weight.sum(axis=1, keepdims=True)


def second_uv(si: Any) -> np.ndarray:
    """(n, 2): the second texture coordinates, (0, 0) on surfaces without: see `vertices`."""
    count = np.array(si.uv).reshape(2, -1).shape[1]
    if getattr(si, "prim_index", None) is None:
        return np.zeros((count, 2))
    stored = np.array(si.dn_du, dtype=np.float64).reshape(3, -1).T[:, :2]
    return np.broadcast_to(np.where(np.array(si.prim_index)[:, None] > 0, stored, 0.0), (count, 2))


def read(fields: Fields, usual: str) -> Mapping:
    """The key `mapping`; `usual` is the default projection."""
    table = fields.take("mapping")
    if table is None:
        return Mapping(usual)
    inner = Fields(table, f"{fields.where}.mapping", fields.errors)
    projection = inner.choice("projection", usual, PROJECTIONS)
    matrix = transforms.read(inner.take("transform"), f"{inner.where}.transform", fields.errors)
    sharpness = 4.0
    if projection == "triplanar":
        sharpness = inner.number("sharpness", 4.0, lambda number: number > 0, "a number > 0")
    uv_set = inner.integer("uv_set", 0, 0, 1) if projection == "uv" else 0
    inner.close()
    return Mapping(projection, matrix, sharpness, uv_set)


class Mapped(mi.Texture):
    """A native texture, looked up at the point that a mapping gives."""

    def __init__(self, inner: "mi.Texture", mapping: Mapping) -> None:
        mi.Texture.__init__(self, mi.Properties())
        self.inner, self.mapping = inner, mapping

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `place`, which has `p`, `uv` and `sh_frame.n` like `si`."""

        def at(points: np.ndarray) -> np.ndarray:
            moved = mi.SurfaceInteraction3f(si)
            moved.uv = mi.Point2f(np.ascontiguousarray(points[:, :2].T.astype(np.float32)))
            return np.array(self.inner.eval(moved), dtype=np.float64).T

        return self.mapping.values(place, at)

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(np.ascontiguousarray(self.values(si, si).T.astype(np.float32)))

    def to_string(self) -> str:
        return f"Mapped[{self.mapping.projection}]"
