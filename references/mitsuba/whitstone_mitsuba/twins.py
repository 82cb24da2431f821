"""Twins of out-of-tree plugins: Python files that `serve --twin FILE` runs before the first request.

A file registers the reader of a type with a decorator. The reader gets the keys of the table
(`Fields`) and must take every key that it allows:

    from whitstone_mitsuba import twins
    from whitstone_mitsuba.surfaces import Surface

    @twins.shape("superquadric")
    def read(fields, place, base):
        return Superquadric(place.world, fields.vector("radii", (1, 1, 1)))

Write a twin from the specification of its plugin, and use another method than the plugin: two
copies of the same mistake agree.
"""

from __future__ import annotations

import importlib.util
import os
from typing import Any, Callable, Dict, Sequence, Tuple

from . import lights, materials, shapes, textures
from .errors import DriverError

Reader = Callable[..., Any]

OUT_OF_TREE = "an out-of-tree shape: its Python twin intersects it in double precision"


def _add(readers: Dict[str, Any], family: str, kind: str, reader: Reader) -> None:
    if kind in readers:
        raise DriverError(f"a twin for a {family} of type {kind!r} already exists")
    readers[kind] = reader


def shape(kind: str) -> Callable[[Reader], Reader]:
    """Registers a reader `(fields, place, base) -> surfaces.Surface`, in world space by
    `place.world`.
    """

    def add(reader: Reader) -> Reader:
        def read(fields: Any, place: Any, base: Any) -> Tuple[Any, str]:
            return reader(fields, place, base), OUT_OF_TREE

        _add(shapes.READERS, "shape", kind, read)
        return reader

    return add


def _family(family: str, readers: Dict[str, Any]) -> Callable[[str], Callable[[Reader], Reader]]:
    """A decorator for the readers of a family, by the type that they read."""

    def of(kind: str) -> Callable[[Reader], Reader]:
        def add(reader: Reader) -> Reader:
            _add(readers, family, kind, reader)
            return reader

        return add

    return of


# Of a reader `(fields, textures) -> materials.Material`.
material = _family("material", materials.READERS)
# Of a reader `(fields, base)` that returns an object with `range()` and `build()`, such as
# `textures.Constant`.
texture = _family("texture", textures.READERS)
# Of a reader `(fields, index) -> lights.Lamp`.
light = _family("light", lights.LAMPS)


def load(paths: Sequence[str]) -> None:
    """Runs the files. Raises `DriverError` with the file's name if one cannot be run."""
    for number, path in enumerate(paths):
        name = f"whitstone_twin_{number}_{os.path.splitext(os.path.basename(path))[0]}"
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise DriverError(f"{path}: expected a Python file with twins")
        try:
            spec.loader.exec_module(importlib.util.module_from_spec(spec))
        except Exception as error:  # anything that an out-of-tree file may raise
            raise DriverError(f"the twin {path} cannot be used: {type(error).__name__}: {error}") from error
