"""Lights: point, directional, spot, projector, area, ambient, background, environment (model §7).

Each lamp that has a direction becomes a Mitsuba emitter whose `sample_direction` gives direction,
distance and irradiance. `falloff = "none"` has no native twin: the emitter is a Python plugin that
cancels the inverse square of the native one. An area light is a set of native point lights, one per
sample point, each multiplied by the cosine to its normal. A projector is Mitsuba's own with a white
slide: it determines whether a point is in the frame, at which image position, and how much light
arrives. The driver looks up the slide there. A spot light with an image is Mitsuba's own without a
texture, multiplied by the image, which the driver looks up by the model's formula.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from whitstone_protocol.errors import SceneError

from . import compounds, images, mappings, meshes, sky, textures, transforms
from .fields import REQUIRED, Fields, Vector, there_are
from .files import Folder
from .runtime import dr, mi


class NoFalloff(mi.Emitter):
    """A point or spot light without falloff: the nested native emitter, times d²."""

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


class Facing(NoFalloff):
    """A sample point of an area light: the nested native emitter, times the cosine to the surface's
    normal.
    """

    def __init__(self, props: "mi.Properties") -> None:
        NoFalloff.__init__(self, props)
        self.normal = mi.Vector3f(*[dr.opaque(mi.Float, props[key]) for key in ("nx", "ny", "nz")])

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        ds, value = self.inner.sample_direction(it, sample, active)
        return ds, value * dr.maximum(-dr.dot(self.normal, mi.Vector3f(ds.d)), 0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.inner.eval_direction(it, ds, active) * dr.maximum(-dr.dot(self.normal, mi.Vector3f(ds.d)), 0)

    def to_string(self) -> str:
        return f"Facing[{self.inner}]"


mi.register_emitter("whitstone_facing", lambda props: Facing(props))


def _look_up(image: Any, u: Any, v: Any, seen: Any) -> Any:
    """The colour of a projected image at (u, v) where `seen`; black elsewhere, where (u, v) may be
    NaN.
    """
    u, v = dr.select(seen, u, 0.5), dr.select(seen, v, 0.5)
    dr.eval(u, v)
    at = dr.zeros(mi.SurfaceInteraction3f, dr.width(seen))
    at.uv, at.p = mi.Point2f(u, v), mi.Point3f(u, v, 0)
    at.n = mi.Normal3f(0, 0, 1)
    at.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    return dr.select(seen, image.eval(at), 0)


class Slide(NoFalloff):
    """The nested native projector with a white slide, times a texture at the image position, and a
    colour.
    """

    def __init__(self, props: "mi.Properties") -> None:
        NoFalloff.__init__(self, props)
        self.slide = props["slide"]
        self.intensity = mi.Color3f(*[dr.opaque(mi.Float, props[key]) for key in "rgb"])

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        ds, value = self.inner.sample_direction(it, sample, active)
        seen = dr.max(value) > 0
        return ds, value * self.intensity * _look_up(self.slide, ds.uv.x, 1 - ds.uv.y, seen)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.sample_direction(it, mi.Point2f(0.5), active)[1]

    def to_string(self) -> str:
        return f"Slide[{self.inner}]"


mi.register_emitter("whitstone_slide", lambda props: Slide(props))


class SpotImage(NoFalloff):
    """The nested spot light, times a texture at the image position.

    Mitsuba's own `texture` of a spot light shows only textures of (u, v), and turned by 180
    degrees.
    """

    def __init__(self, props: "mi.Properties") -> None:
        NoFalloff.__init__(self, props)
        self.image = props["image"]
        # The rows: to the right and up in the image, each divided by half its size at 1 m, and the
        # axis.
        self.rows = [mi.Vector3f(*[dr.opaque(mi.Float, props[f"{row}{column}"]) for column in "xyz"]) for row in "uvf"]
        self.position = mi.Point3f(*[dr.opaque(mi.Float, props[f"p{column}"]) for column in "xyz"])

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        ds, value = self.inner.sample_direction(it, sample, active)
        q = mi.Vector3f(it.p - self.position)
        x, y, z = (dr.dot(row, q) for row in self.rows)
        return ds, value * _look_up(self.image, (1 + x / z) / 2, (1 + y / z) / 2, dr.max(value) > 0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.sample_direction(it, mi.Point2f(0.5), active)[1]

    def to_string(self) -> str:
        return f"SpotImage[{self.inner}]"


mi.register_emitter("whitstone_spot_image", lambda props: SpotImage(props))

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
    # For a sample point of a surface: its normal, and the offset of the target of shadow rays from
    # the surface.
    normal: Optional[Vector] = None
    off: float = 0.0
    # The image of a projector or spot light, and the intensity of a projector.
    slide: Optional[Any] = None
    intensity: Vector = (1.0, 1.0, 1.0)
    # For a spot light with an image: the rows of `SpotImage`.
    frame: Optional[np.ndarray] = None
    # Distance in metres before the lamp at which shadow rays end, if it lies in coincident
    # surfaces.
    margin: float = 0.0

    def place(self) -> Optional[np.ndarray]:
        """Its position; None for lamps at infinity."""
        if not self.finite:
            return None
        if "position" in self.plugin:
            return np.array(self.plugin["position"])
        return np.array(self.plugin["to_world"].matrix, dtype=float)[:3, 3]

    def hosted(self) -> Hosted:
        """(plugin type, reason) if the twin is not native."""
        if self.normal is not None:
            return self.type, "the sample points are Python emitters around native point lights"
        if self.frame is not None:
            return self.type, "a Python emitter looks up the image; the native spot light inside it gives cone and falloff"
        if self.slide is not None:
            return self.type, "a Python emitter looks up the slide; the native projector inside it gives frame and falloff"
        return None if self.falloff else (self.type, '`falloff = "none"` is a Python emitter around the native one')

    def build(self) -> "mi.Emitter":
        inner = mi.load_dict(self.plugin)
        if not self.falloff:
            inner = mi.load_dict({"type": "whitstone_no_falloff", "inner": inner})
        if self.normal is not None:
            normal = dict(zip(("nx", "ny", "nz"), self.normal))
            return mi.load_dict({"type": "whitstone_facing", "inner": inner, **normal})
        if self.slide is not None and self.frame is not None:
            parts = {f"{name}{axis}": float(number) for name, row in zip("uvfp", self.frame) for axis, number in zip("xyz", row)}
            return mi.load_dict({"type": "whitstone_spot_image", "inner": inner, "image": self.slide.build(), **parts})
        if self.slide is not None:
            color = dict(zip("rgb", self.intensity))
            return mi.load_dict({"type": "whitstone_slide", "inner": inner, "slide": self.slide.build(), **color})
        return inner


@dataclass(frozen=True)
class Lights:
    """All lights of a scene: lamps in the document's order, and the sums of the others."""

    lamps: Tuple[Lamp, ...]
    ambient: Vector
    ambients: Tuple[Tuple[int, Vector], ...]
    background: Vector
    # Textures on the sphere of directions, visible behind everything.
    environments: Tuple[Any, ...] = ()

    def background_emitter(self) -> "mi.Emitter":
        return mi.load_dict({"type": "constant", "radiance": _rgb(self.background)})


def place(directions: np.ndarray, known: Optional[np.ndarray] = None) -> Any:
    """(n, 3) directions on an environment, as an interaction for texture lookups; `known`: their
    (n, 2) coordinates.
    """
    x, y, z = directions.T.astype(np.float64)
    if known is None:
        uv = np.stack([0.5 + np.arctan2(x, -z) / (2 * np.pi), 0.5 + np.arctan2(y, np.hypot(x, z)) / np.pi])
    else:
        uv = known.T
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.p = mi.Point3f(np.ascontiguousarray(directions.T, dtype=np.float32))
    si.uv = mi.Point2f(np.ascontiguousarray(uv, dtype=np.float32))
    si.n = mi.Normal3f(si.p)
    si.sh_frame = mi.Frame3f(mi.Vector3f(si.p))
    return si


# For a direction (x, y, z), the axes to the right and up on each face: axis and sign.
FACES = {
    "px": ((2, 1), (1, 1)),
    "nx": ((2, -1), (1, 1)),
    "py": ((0, 1), (2, 1)),
    "ny": ((0, 1), (2, -1)),
    "pz": ((0, -1), (1, 1)),
    "nz": ((0, 1), (1, 1)),
}


def on_cube(directions: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """The index of the face that each of (n, 3) directions hits, and (n, 2) coordinates on its
    image.
    """
    lanes, axis = np.arange(len(directions)), np.argmax(np.abs(directions), axis=1)
    m = directions[lanes, axis]
    which = 2 * axis + (m < 0)
    table = np.array([[a, right, b, up] for (a, right), (b, up) in FACES.values()])[which]
    across, upwards = table[:, 1] * directions[lanes, table[:, 0]], table[:, 3] * directions[lanes, table[:, 2]]
    return which, (1 + np.column_stack([across, upwards]) / np.abs(m)[:, None]) / 2


class CubeLookup:
    """Six native bitmaps; each direction looks up one of them."""

    def __init__(self, faces: Sequence["mi.Texture"]) -> None:
        self.faces = faces

    def eval(self, si: Any) -> Any:
        d = np.array(si.p, dtype=np.float64).T
        lanes, axis = np.arange(len(d)), np.argmax(np.abs(d), axis=1)
        which = 2 * axis + (d[lanes, axis] < 0)
        m = np.abs(d[lanes, axis])
        total = np.zeros((len(d), 3))
        for number, (face, ((a, right), (b, up))) in enumerate(zip(self.faces, FACES.values())):
            with np.errstate(invalid="ignore"):
                uv = np.stack([(1 + right * d[:, a] / m) / 2, (1 + up * d[:, b] / m) / 2])
            si.uv = mi.Point2f(np.ascontiguousarray(np.where(which == number, uv, 0.5), dtype=np.float32))
            seen = np.array(face.eval(si), dtype=np.float64).reshape(3, -1).T
            total = np.where((which == number)[:, None], seen, total)
        return mi.Color3f(np.ascontiguousarray(total.T, dtype=np.float32))


@dataclass(frozen=True)
class Cube:
    """The faces of a cube map, in the order of `FACES`."""

    faces: Tuple[Any, ...]

    def build(self) -> CubeLookup:
        return CubeLookup([face.build() for face in self.faces])


def _faces(fields: Fields, base: Folder) -> Any:
    inner = Fields(fields.take("faces"), f"{fields.where}.faces", fields.errors)
    found: List[textures.Image] = []
    for name in FACES:
        face = Fields(inner.take(name, REQUIRED) or {}, f"{inner.where}.{name}", fields.errors)
        try:
            pixels = images.load(base.path(face.string("file", REQUIRED)), "auto")
        except SceneError as error:
            face.error("file", str(error))
            continue
        face.close()
        height, width = pixels.shape[:2]
        if width != height or (found and pixels.shape != found[0].pixels.shape):
            face.error("file", f"expected square images of equal size, found {width} x {height}")
        if pixels.min() < 0:
            face.error("file", "expected values >= 0")
        found.append(textures.Image(pixels, "bilinear", ("clamp", "clamp"), (1.0, 1.0), (0.0, 0.0), mappings.Mapping("uv")))
    inner.close()
    return Cube(tuple(found)) if len(found) == len(FACES) and not fields.errors else textures.Constant((0.0, 0.0, 0.0))


def direction_map(fields: Fields, reader: Any) -> Any:
    """The keys `radiance` and `faces`: a texture on the sphere of directions."""
    if not fields.has("faces"):
        return reader.value(fields, "radiance", REQUIRED, 0.0, float("inf"))
    if fields.has("radiance"):
        fields.take("radiance")
        fields.error("faces", "expected either `radiance` or `faces`, found both")
    return _faces(fields, reader.base)


def _environment(fields: Fields, index: int, reader: Any) -> Tuple[Any, List[Lamp]]:
    radiance = direction_map(fields, reader)
    n = fields.integer("samples", 0, 0, 32)
    lamps: List[Lamp] = []
    if n > 0:
        faces = radiance.faces if isinstance(radiance, Cube) else None
        for direction, color in zip(*sky.directions(n, sky.parts(radiance, faces), lambda uv, d: _sky(radiance, uv, d))):
            plugin = {"type": "directional", "direction": (-direction).tolist(), "irradiance": _rgb(tuple(color.tolist()))}
            lamps.append(Lamp(index, plugin, False, True, "environment"))
    return radiance, lamps


def _sky(radiance: Any, uv: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 3) radiances at (n, 2) coordinates, for which the directions are given as well.

    Images are looked up in double precision: next to a sun, single precision would misplace light.
    """
    if isinstance(radiance, Cube):
        which, places = on_cube(directions)
        seen = np.zeros((len(uv), 3))
        for number, face in enumerate(radiance.faces):
            seen[which == number] = face.precise(places[which == number])
        return seen
    if isinstance(radiance, compounds.Compound):
        return np.broadcast_to(radiance.combine([_sky(part, uv, directions) for part in radiance.parts]), (len(uv), 3))
    if isinstance(radiance, textures.Image) and radiance.mapping.usual():
        return radiance.precise(uv)
    seen = np.array(radiance.build().eval(place(directions, uv)), dtype=np.float64)
    return np.broadcast_to(seen.reshape(3, -1).T, (len(uv), 3))


def facing(forward: np.ndarray) -> np.ndarray:
    """A 3x3 rotation whose third column is `forward` (unit length); the other two are arbitrary."""
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


def _across(fields: Fields, forward: np.ndarray) -> np.ndarray:
    """The unit vector to the right in a projected image, by the key `up`."""
    upwards = _direction(fields, "up", np.array(fields.vector("up", (0.0, 1.0, 0.0))))
    right = np.cross(forward, upwards)
    if np.linalg.norm(right) <= 1e-12:
        fields.error("up", "must not be parallel to the direction from position to target")
        right = np.array([1.0, 0.0, 0.0])
    return right / np.linalg.norm(right)


def _spot(fields: Fields, index: int, reader: Any) -> Lamp:
    position = np.array(fields.vector("position", REQUIRED))
    target = np.array(fields.vector("target", REQUIRED))
    intensity = fields.color("intensity", REQUIRED)
    cutoff = fields.number("cutoff_angle", 20.0, lambda angle: 0 < angle < 90, "a half angle between 0 and 90 degrees")
    expected = f"a half angle from 0 to below the cutoff of {cutoff:g} degrees"
    beam = fields.number("beam_width", 0.75 * cutoff, lambda angle: 0 <= angle < cutoff, expected)
    matrix = np.eye(4)
    forward = _direction(fields, "target", target - position)
    matrix[:3, :3] = facing(forward)
    matrix[:3, 3] = position
    slide, frame = None, None
    if fields.has("image"):
        slide = reader.value(fields, "image", REQUIRED, 0.0, float("inf"))
        right = _across(fields, forward)
        half = np.tan(np.radians(cutoff))
        frame = np.stack([right / half, np.cross(right, forward) / half, forward, position])
    elif fields.has("up"):
        fields.take("up")
        fields.error("up", "requires `image`")
    plugin = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f(matrix),
        "intensity": _rgb(intensity),
        "cutoff_angle": cutoff,
        "beam_width": beam,
    }
    return Lamp(index, plugin, True, _falloff(fields), "spot", slide=slide, frame=frame)


def _projector(fields: Fields, index: int, reader: Any) -> Lamp:
    position = np.array(fields.vector("position", REQUIRED))
    target = np.array(fields.vector("target", REQUIRED))
    fov = fields.number("fov", 45.0, lambda angle: 0 < angle < 180, "an angle between 0 and 180 degrees")
    aspect = fields.number("aspect", 1.0, lambda ratio: 0.001 <= ratio <= 1000, "a ratio from 0.001 to 1000")
    slide = reader.value(fields, "image", REQUIRED, 0.0, float("inf"))
    intensity = fields.color("intensity", REQUIRED)
    forward = _direction(fields, "target", target - position)
    right = _across(fields, forward)
    matrix = np.eye(4)
    # Mitsuba's x runs to the left. It treats a white slide as square, so a wider frame is stretched
    # horizontally.
    matrix[:3, :3] = np.column_stack([-right, np.cross(right, forward) / aspect, forward])
    matrix[:3, 3] = position
    # It gives pi times its scale on a screen perpendicular to the axis at 1 m.
    plugin = {
        "type": "projector",
        "to_world": mi.ScalarTransform4f(matrix),
        "fov": fov,
        "irradiance": {"type": "srgb", "color": mi.ScalarColor3f(1.0), "unbounded": True},
        "scale": 1 / np.pi,
    }
    return Lamp(index, plugin, True, True, "projector", slide=slide, intensity=intensity)


# Offset of the targets of shadow rays from the light's surface, relative to its size, so that a
# shape at the same place does not block it.
OFF_SURFACE = 2.0**-19

# Upper bound on the sample points of a mesh light.
MOST_POINTS = 4096


def _mesh(fields: Fields, index: int, base: Folder) -> List[Lamp]:
    """The centroids of n² equal parts of each triangle."""
    matrix = transforms.read(fields.take("transform"), f"{fields.where}.transform", fields.errors)
    radiance = np.array(fields.color("radiance", REQUIRED))
    n = fields.integer("samples", 1, 1, 32)
    falls = _falloff(fields)
    name = fields.string("file", REQUIRED)
    try:
        triangles = meshes.load(base.path(name), base=base)
    except SceneError as error:
        fields.error("file", str(error))
        return []
    if len(triangles.faces) * n * n > MOST_POINTS:
        fields.error("samples", f"expected at most {MOST_POINTS} sample points, found {len(triangles.faces) * n * n}: {n * n} for each triangle")
        return []
    world = triangles.positions @ matrix[:3, :3].T + matrix[:3, 3]
    off = OFF_SURFACE * np.abs(world).max(initial=0.0)
    upright = [(3 * i + 1, 3 * j + 1) for j in range(n) for i in range(n - j)]
    turned = [(3 * i + 2, 3 * j + 2) for j in range(n - 1) for i in range(n - 1 - j)]
    lamps = []
    for a, b, c in world[triangles.faces]:
        across = np.cross(b - a, c - a)
        twice = np.linalg.norm(across)
        if not twice > 0:
            continue
        normal = across / twice * (-1 if transforms.mirrors(matrix) else 1)
        for s, t in upright + turned:
            place = a + (b - a) * (s / (3 * n)) + (c - a) * (t / (3 * n))
            power = _rgb(tuple(radiance * (twice / (2 * n**2))))
            plugin = {"type": "point", "position": place.tolist(), "intensity": power}
            lamps.append(Lamp(index, plugin, True, falls, "area", tuple(normal.tolist()), off))
    if not lamps:
        fields.error("file", f"{name}: every triangle is degenerate")
    return lamps


def _area(fields: Fields, index: int, base: Folder) -> List[Lamp]:
    kind = fields.choice("shape", "rectangle", ("rectangle", "disk", "sphere", "mesh"))
    if kind == "mesh":
        return _mesh(fields, index, base)
    matrix = transforms.read(fields.take("transform"), f"{fields.where}.transform", fields.errors)
    radiance = np.array(fields.color("radiance", REQUIRED))
    n = fields.integer("samples", 4, 1, 32)
    falls = _falloff(fields)
    middles = (np.arange(n) + 0.5) / n
    u, v = np.tile(middles, n), np.repeat(middles, n)
    linear = matrix[:3, :3]
    across = np.linalg.norm(np.cross(linear[:, 0], linear[:, 1]))
    circle = np.array([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)])
    normals = np.tile([0.0, 0.0, 1.0], (n * n, 1))
    if kind == "rectangle":
        area, points = 4 * across, np.column_stack([2 * u - 1, 2 * v - 1, 0 * u])
    elif kind == "disk":
        area, points = np.pi * across, np.column_stack([*(np.sqrt(v) * circle), 0 * u])
    else:
        scale = transforms.similarity_scale(matrix)
        if scale is None:
            fields.error("transform", "must be a similarity (rotation, reflection, translation, one scale for all axes) for a spherical light")
            scale = 1.0
        area = 4 * np.pi * scale**2
        points = np.column_stack([*(np.sqrt(1 - (1 - 2 * v) ** 2) * circle), 1 - 2 * v])
        normals = points
    places = points @ linear.T + matrix[:3, 3]
    normals = normals @ np.linalg.inv(linear)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off = OFF_SURFACE * np.abs(matrix[:3, :4]).sum(axis=1).max()
    lamps = []
    for place, normal in zip(places, normals):
        plugin = {"type": "point", "position": place.tolist(), "intensity": _rgb(tuple(radiance * (area / n**2)))}
        lamps.append(Lamp(index, plugin, True, falls, "area", tuple(normal.tolist()), off))
    return lamps


LAMPS = {"point": _point, "directional": _directional}


def read(tables: Any, reader: Any, base: Folder, errors: List[str], unsupported: List[str]) -> Lights:
    """Reads the `[[light]]` tables."""
    lamps: List[Lamp] = []
    ambients: List[Tuple[int, Vector]] = []
    background = np.zeros(3)
    environments: List[Any] = []
    if not isinstance(tables, list):
        errors.append("light: expected an array of tables, [[light]]")
        tables = []
    for index, table in enumerate(tables):
        fields = Fields(table, f"light[{index}]", errors)
        kind = fields.kind()
        if kind in LAMPS:
            lamps.append(LAMPS[kind](fields, index))
        elif kind == "environment":
            radiance, sky_lamps = _environment(fields, index, reader)
            environments.append(radiance)
            lamps.extend(sky_lamps)
        elif kind == "area":
            lamps.extend(_area(fields, index, base))
        elif kind == "spot":
            lamps.append(_spot(fields, index, reader))
        elif kind == "projector":
            lamps.append(_projector(fields, index, reader))
        elif kind == "ambient":
            ambients.append((index, fields.color("radiance", REQUIRED)))
        elif kind == "background":
            background = background + np.array(fields.color("radiance", REQUIRED))
        else:
            if kind is not None:
                known = [*LAMPS, "spot", "area", "projector", "ambient", "background", "environment"]
                unsupported.append(f"light[{index}]: no twin for a light of type {kind!r}; {there_are(known)}")
            continue
        fields.close()
    ambient = np.sum([value for _, value in ambients], axis=0) if ambients else np.zeros(3)
    return Lights(tuple(lamps), tuple(ambient), tuple(ambients), tuple(background), tuple(environments))
