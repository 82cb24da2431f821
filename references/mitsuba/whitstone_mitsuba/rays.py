"""Nearest hits of single rays by Mitsuba's own `ray_intersect`, for a program that embeds this
package.
"""

from __future__ import annotations

import os
from typing import Union

import numpy as np

from . import document, scene
from .runtime import dr, mi
from .settings import Setting


def closest(text: str, folder: Union[str, os.PathLike], rays: bytes) -> bytes:
    """The ray parameters (float32) of the nearest hits with the shapes of a document, infinite for
    a miss.

    `rays` holds six numbers per ray (float32): origin and direction.
    """
    built = scene.Built(document.parse(text, os.fspath(folder)), Setting())
    built.native_only("closest")
    numbers = np.frombuffer(rays, dtype=np.float32).reshape(-1, 6).T
    origin, direction = (mi.Float(np.ascontiguousarray(row)) for row in numbers[:3]), (mi.Float(np.ascontiguousarray(row)) for row in numbers[3:])
    found = built.scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*direction)))
    distances = dr.select(found.is_valid(), found.t, dr.inf)
    return np.asarray(distances, dtype=np.float32).tobytes()
