"""Mitsuba's own results for single queries, for stress tests: `ray_intersect`, spawned rays, and
the Fresnel term.

The driver's own code takes no part: `spawn_ray` and `spawn_ray_to` are Mitsuba's, with its own
offset.
"""

from __future__ import annotations

import time
from typing import Any, List, Optional, Tuple

import numpy as np

from whitstone_protocol.errors import DriverError, Unsupported

from .runtime import dr, mi
from .scene import Built


def _columns(rows: Any, count: int, key: str) -> List["mi.Float"]:
    try:
        numbers = np.asarray(rows, dtype=np.float64).reshape(-1, count)
    except (TypeError, ValueError) as error:
        raise DriverError(f"{key}: expected rows of {count} numbers: {error}") from error
    with np.errstate(over="ignore"):
        single = numbers.astype(np.float32)
    return [mi.Float(np.ascontiguousarray(single[:, column])) for column in range(count)]


def _rays(rows: Any) -> "mi.Ray3f":
    columns = _columns(rows, 6, "rays")
    return mi.Ray3f(mi.Point3f(*columns[:3]), mi.Vector3f(*columns[3:]))


# Enough rays to make the launch cost of a kernel negligible.
TIMED = 1 << 18


def closest(built: Built, rows: Any) -> Tuple[List[float], float]:
    """Ray parameters of the nearest hits, infinite for a miss; and nanoseconds per ray, from a
    second, warm query with many copies.
    """

    built.native_only("closest")

    def ask(rays: "mi.Ray3f") -> np.ndarray:
        found = built.scene.ray_intersect(rays)
        return np.asarray(dr.select(found.is_valid(), found.t, dr.inf), dtype=np.float32)

    distances = ask(_rays(rows))
    many = _rays(np.tile(np.asarray(rows, dtype=np.float64).reshape(-1, 6), (-(-TIMED // max(len(rows), 1)), 1)))
    ask(many)
    begin = time.perf_counter()
    ask(many)
    return [float(t) for t in distances], (time.perf_counter() - begin) * 1e9 / dr.width(many)


def occluded(built: Built, rows: Any, target: Any) -> List[Optional[bool]]:
    """Whether the segment from the first hit of each ray to a point is blocked; `None` for a ray
    without a hit.
    """
    built.native_only("occluded")
    found = built.scene.ray_intersect(_rays(rows))
    end = mi.Point3f(*_columns([target], 3, "target"))
    blocked = built.scene.ray_test(found.spawn_ray_to(end))
    hits = np.asarray(found.is_valid())
    return [bool(is_blocked) if hit else None for hit, is_blocked in zip(hits, np.asarray(blocked))]


def walk(built: Built, rows: Any, mode: str, limit: int) -> List[int]:
    """Number of surfaces that each ray hits in succession, until it leaves the scene or reaches
    `limit`. It continues straight ("through"), or as if reflected by mirrors ("reflect").
    """
    if mode not in ("through", "reflect"):
        raise DriverError(f'mode: expected "through" or "reflect", found {mode!r}')
    built.native_only("walk")
    ray = _rays(rows)
    counts = np.zeros(dr.width(ray), dtype=np.int64)
    active = dr.full(mi.Bool, True, dr.width(ray))
    for _ in range(limit):
        found = built.scene.ray_intersect(ray, active)
        active = active & found.is_valid()
        met = np.asarray(active)
        if not met.any():
            break
        counts += met
        direction = ray.d if mode == "through" else found.to_world(mi.reflect(found.wi))
        ray = found.spawn_ray(direction)
        dr.eval(ray, active)
    return [int(count) for count in counts]


def fresnel(cosines: Any, ior: float) -> Tuple[List[float], List[float]]:
    """Reflectances of a dielectric, and cosines of the transmitted rays (0 for total internal
    reflection), by Mitsuba's `fresnel`.
    """
    (cosine,) = _columns(cosines, 1, "cosines")
    reflectance, transmitted, _, _ = mi.fresnel(cosine, mi.Float(np.float32(ior)))
    count = dr.width(cosine)
    both = (np.broadcast_to(np.asarray(values), (count,)) for values in (reflectance, transmitted))
    first, second = ([float(value) for value in values] for values in both)
    return first, second


def camera(built: Built, positions: Any) -> List[List[float]]:
    """Directions of rays through film positions, [0, 1] x [0, 1] from the top left, by Mitsuba's
    own sensor.
    """
    if built.sensor is None:
        raise Unsupported("camera: Mitsuba has no such sensor")
    x, y = _columns(positions, 2, "positions")
    ray, _ = built.sensor.sample_ray(0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5, 0.5))
    return np.asarray(ray.d, dtype=np.float64).T.tolist()
