"""Converts a document to Mitsuba objects, with tables that map Mitsuba's surfaces to the model's.
"""

from __future__ import annotations

from typing import Any, Optional, Sequence, Tuple

import numpy as np

from whitstone_protocol.errors import Unsupported

from . import bodies, footprints, lights, rounding, shaders, spawn, vertices
from . import shapes as shape_module
from .document import Document
from .hosted import Host
from .runtime import dr, mi
from .settings import Setting

NOTHING = 0xFFFFFFFF


def _anchors() -> "mi.Scene":
    """Two shapes of every kind that the driver can use, which live as long as the process.

    `ray_intersect` compiles code for every kind of shape that exists in the process, whatever the
    scene. Because of these shapes, that code never changes. So one kernel, compiled once and found
    in Dr.Jit's cache, serves all scenes.
    """
    points, faces, uvs = np.eye(3), np.array([[0, 1, 2]]), np.zeros((3, 2))
    flat = [shape_module.make_mesh(points, faces, uvs, None, None) for _ in range(2)]
    smooth = [shape_module.make_mesh(points, faces, uvs, np.eye(3), None) for _ in range(2)]
    native = [mi.load_dict({"type": kind}) for kind in ("sphere", "disk", "rectangle") for _ in range(2)]
    everything = {f"anchor{number:02d}": shape for number, shape in enumerate(flat + smooth + native)}
    return mi.load_dict({"type": "scene", **everything}, parallel=False, optimize=False)


_ANCHORS: Optional["mi.Scene"] = None
# Cylinders are rare: their code is part of kernels only after the first one.
_CYLINDERS: Optional["mi.Scene"] = None


def load_shapes(
    document: Document,
    bsdfs: Sequence["mi.BSDF"],
    setting: Setting,
    extra: Optional[dict] = None,
    media: Optional[Sequence[shape_module.Media]] = None,
) -> Any:
    """(scene, shapes in the document's order, with instances expanded, None for hosted ones).

    `extra`: emitters or a sensor for the check against Mitsuba's integrators. `media`: those of
    each material, for its volume integrators; the driver itself needs none.
    """
    global _ANCHORS, _CYLINDERS
    if _ANCHORS is None:
        _ANCHORS = _anchors()
    if _CYLINDERS is None and any(shape.rules.axis is not None for shape in document.shapes):
        _CYLINDERS = mi.load_dict({"type": "scene", "a": {"type": "cylinder"}, "b": {"type": "cylinder"}}, parallel=False, optimize=False)
    rounded = rounding.of(setting.vertex_seed)
    sides = [shape_module.NO_MEDIA] * len(document.materials) if media is None else media
    built = [
        None if shape.build is None else shape.build(bsdfs[shape.material], rounded, sides[shape.material])
        for shape in document.shapes
    ]
    content = {f"shape{number:08d}": shape for number, shape in enumerate(built) if shape is not None}
    # Never optimised: merging would change the numbers of shapes and primitives.
    scene = mi.load_dict(
        {"type": "scene", "embree_use_robust_intersections": setting.robust, **content, **(extra or {})},
        parallel=False,
        optimize=False,
    )
    return scene, built


def _floats(values: Any) -> "mi.Float":
    return mi.Float(np.ascontiguousarray(np.ravel(values), dtype=np.float32))


def _integers(values: Any) -> "mi.UInt32":
    return mi.UInt32(np.ascontiguousarray(np.ravel(values), dtype=np.uint32))


def geometry(setting: Setting) -> Tuple[bool, Optional[int]]:
    """The part of a setting that the built scene depends on; the rest only affects the tracer."""
    return setting.robust, setting.vertex_seed


class Built:
    """A scene that is ready for tracing. Tables end with a spare entry, so that their size is never
    1 (another kernel).
    """

    def __init__(self, document: Document, setting: Setting) -> None:
        self.document = document
        self.geometry = geometry(setting)
        self.bsdfs = [material.build() for material in document.materials]
        self.vertices = vertices.Table(document.shapes)
        self.shaders = shaders.build(document.materials, self.bsdfs, self.vertices)
        self.bodies = bodies.Bodies(document.shapes, document.materials)
        self.emitters = [lamp.build() for lamp in document.lights.lamps]
        self.background = document.lights.background_emitter()
        self.environments = [texture.build() for texture in document.lights.environments]
        self.sensor = document.camera.build() if document.camera.native() else None
        self.scene, self._shapes = load_shapes(document, self.bsdfs, setting)
        surfaces = [(place, shape.surface) for place, shape in enumerate(document.shapes) if shape.surface is not None]
        # The shapes that the driver intersects itself; None if Mitsuba has all shapes.
        self.host = Host(surfaces, len(document.shapes)) if surfaces else None
        self.surfaces = footprints.Surfaces(document.shapes, self._shapes)
        self._tables()

    def native_only(self, what: str) -> None:
        """Refuses an operation that needs Mitsuba's own scene, if that scene lacks some of the
        shapes.
        """
        if self.host is not None:
            raise Unsupported(f"{what}: Mitsuba's scene lacks the hosted shapes, which the driver intersects")

    def behind(self, directions: Any) -> Any:
        """Background radiance in unit directions."""
        count = dr.width(directions)
        radiance = self.background.eval(dr.zeros(mi.SurfaceInteraction3f, count))
        if self.environments:
            dr.eval(directions)
            si = lights.place(np.array(directions).T)
            for texture in self.environments:
                radiance = radiance + texture.eval(si)
        return radiance

    @property
    def meshes(self) -> Sequence["mi.Mesh"]:
        """The shapes in the document's order."""
        return self._shapes

    def _tables(self) -> None:
        shapes = self.document.shapes
        rules = [shape.rules for shape in shapes] + [shape_module.Rules()] * 2
        # The model's numbers: all instances of a shape have the same one.
        self.numbers = np.array([shape.number for shape in shapes] + [NOTHING], dtype=np.uint32)
        # Dr.Jit numbers all shapes of the process; this maps its numbers to indices in the
        # document.
        native = [place for place, shape in enumerate(self._shapes) if shape is not None]
        registry = [int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(self._shapes[place]))[0]) for place in native]
        number_of = np.full(max(registry, default=0) + 2, NOTHING, dtype=np.uint32)
        number_of[registry] = native
        self.shape_of_registry = _integers(number_of)
        self.flip = _floats([-1.0 if rule.flip else 1.0 for rule in rules])
        self.smooth_normals = _integers([int(rule.smooth) for rule in rules])
        self.uv_rule = _integers([rule.uv for rule in rules])
        self.primitive_rule = _integers([rule.primitive for rule in rules])
        planes = [np.zeros((2, 4)) if rule.plane is None else rule.plane for rule in rules]
        self.plane_rows = _floats(planes)
        flats = [np.zeros(4) if rule.project is None else rule.project for rule in rules]
        self.flats = _floats(flats)
        # The largest coordinate of each shape, at most 1 m; 1 m for unbounded shapes.
        boxes = [None if shape is None else shape.bbox() for shape in self._shapes]
        reach = [0.0 if box is None else np.abs(np.array([box.min, box.max], dtype=np.float64)).max(initial=0.0) for box in boxes]
        self.sizes = _floats([min(size, 1.0) for size in reach] + [1.0, 1.0])
        balls = [np.zeros(4) if rule.ball is None else rule.ball for rule in rules]
        axes = [np.zeros(3) if rule.axis is None else rule.axis for rule in rules]
        wraps = [np.zeros((3, 4)) if rule.wrap is None else rule.wrap for rule in rules]
        self.balls = spawn.Balls(np.array(balls), np.array(axes), np.array(wraps))
        self.material_of_shape = _integers([shape.material for shape in shapes] + [0, 0])
        self.casts_shadow = np.array([shape.casts_shadow for shape in shapes] + [True, True])
        self.ambient_light = mi.Color3f(*[dr.opaque(mi.Float, float(value)) for value in self.document.lights.ambient])
        dr.eval(self.ambient_light)


class Cache:
    """The most recently used scenes, so that probing after rendering is cheap. The number is
    bounded, because Embree's structures can be large.
    """

    def __init__(self, size: int = 8) -> None:
        self._size = size
        self._entries: dict = {}

    def get(self, key: Any, make: Any) -> Any:
        """The entry for `key`, created by `make()` if it is new; the least recently used entry is
        evicted.
        """
        if key in self._entries:
            self._entries[key] = self._entries.pop(key)
        else:
            self._entries[key] = make()
            while len(self._entries) > self._size:
                self._entries.pop(next(iter(self._entries)))
        return self._entries[key]

    def forget(self, key: Any) -> None:
        """Drops an entry."""
        self._entries.pop(key, None)
