"""Textures (model §10): constant, checker and image with their native Mitsuba twins; those of
`patterns` are formulas.

`read` returns a small object that knows its range of values (to check it against the material that
uses it) and how to build the twin. Coordinates are the model's, v up; differences (v down in
bitmaps) go into the twin's `to_uv`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, List, Tuple

import numpy as np

from whitstone_protocol.errors import SceneError, Unsupported

from . import compounds, footprints, gltf, images, mappings, patterns, pyramid, quilting
from .fields import REQUIRED, Fields, Vector, as_color, is_number, nearest, there_are
from .files import Folder
from .runtime import mi


def _to_uv(scale: Vector, offset: Vector) -> "mi.ScalarTransform3f":
    """(u, v) -> scale * (u, v) + offset."""
    return mi.ScalarTransform3f(np.array([[scale[0], 0, offset[0]], [0, scale[1], offset[1]], [0, 0, 1]]))


def _mapped(texture: "mi.Texture", mapping: mappings.Mapping) -> "mi.Texture":
    """The texture itself if it is mapped by (u, v), otherwise wrapped in its mapping."""
    return texture if mapping.usual() else mappings.Mapped(texture, mapping)


def _color(value: Vector) -> Dict[str, Any]:
    """A colour without an upper limit. (Mitsuba's plain `rgb` refuses more than 1 where it expects
    a reflectance.)
    """
    return {"type": "srgb", "color": mi.ScalarColor3f(*value), "unbounded": True}


@dataclass(frozen=True)
class Constant:
    """The same colour everywhere. Twin: `srgb` (which is how Mitsuba reads `rgb` in an RGB
    variant).
    """

    value: Vector

    def range(self) -> Tuple[float, float]:
        return min(self.value), max(self.value)

    def build(self) -> "mi.Texture":
        return mi.load_dict(_color(self.value))


@dataclass(frozen=True)
class Checker:
    """a where floor(u') + floor(v') is even, else b. Twin: `checkerboard`, whose cells are half a
    unit wide.
    """

    a: Vector
    b: Vector
    scale: Vector
    offset: Vector
    mapping: mappings.Mapping

    def range(self) -> Tuple[float, float]:
        return min(self.a + self.b), max(self.a + self.b)

    def build(self) -> "mi.Texture":
        scale, offset = (tuple(0.5 * number for number in pair) for pair in (self.scale, self.offset))
        checkerboard = {"type": "checkerboard", "color0": _color(self.a), "color1": _color(self.b), "to_uv": _to_uv(scale, offset)}
        return _mapped(mi.load_dict(checkerboard), self.mapping)


@dataclass(frozen=True)
class Image:
    """An image file. Twin: `bitmap`, raw (the texels are linear already), rows counted from the
    top: v -> 1 - v.
    """

    pixels: np.ndarray
    filter: str
    # Along u and along v.
    wrap: Tuple[str, str]
    scale: Vector
    offset: Vector
    mapping: mappings.Mapping
    # Whether it is quilted in Python instead of a plain file.
    quilted: bool = False
    # For the filter "ewa".
    max_anisotropy: int = 16

    @property
    def covers(self) -> bool:
        """Whether it is filtered over the footprint."""
        return self.filter in footprints.FILTERS

    @property
    def folded(self) -> bool:
        """Whether its axes have different wrap modes."""
        return self.wrap[0] != self.wrap[1]

    def range(self) -> Tuple[float, float]:
        return float(self.pixels.min()), float(self.pixels.max())

    def precise(self, uv: np.ndarray) -> np.ndarray:
        """(n, 3) colours at (n, 2) coordinates by the formulas of §10, in double precision, without
        the mapping.
        """
        height, width = self.pixels.shape[:2]
        place = uv * np.array(self.scale) + np.array(self.offset)
        x, y = place[:, 0] * width, (1 - place[:, 1]) * height
        pixels = self.pixels.reshape(height, width, -1)

        def texels(i: np.ndarray, j: np.ndarray) -> np.ndarray:
            return pixels[_wrapped(j, height, self.wrap[1]), _wrapped(i, width, self.wrap[0])].astype(np.float64)

        if self.filter == "nearest":
            found = texels(np.floor(x), np.floor(y))
        else:
            i, j = np.floor(x - 0.5), np.floor(y - 0.5)
            s, t = (x - 0.5 - i)[:, None], (y - 0.5 - j)[:, None]
            upper = (1 - s) * texels(i, j) + s * texels(i + 1, j)
            found = (1 - t) * upper + t * ((1 - s) * texels(i, j + 1) + s * texels(i + 1, j + 1))
        return np.broadcast_to(found, (len(uv), 3))

    def smooth(self) -> Any:
        """See `compounds.smooth`."""
        if self.covers:
            return self.build()
        if self.filter == "nearest":
            return compounds.Still(self.build())
        return pyramid.Filtered(replace(self, filter="trilinear"), whole=True)

    def exact(self) -> Any:
        """See `compounds.exact`."""
        return Precise(self) if self.mapping.usual() and not self.covers else self.build()

    def build(self) -> "mi.Texture":
        if self.covers:
            return pyramid.Filtered(self)
        # A bitmap has one wrap mode for both axes. Mitsuba handles the axis that needs the opposite
        # end of the image; the other axis is folded before the lookup.
        to_uv = _to_uv((self.scale[0], -self.scale[1]), (self.offset[0], 1 - self.offset[1]))
        bitmap = mi.load_dict(
            {
                "type": "bitmap",
                "bitmap": mi.Bitmap(self.pixels),
                "raw": True,
                "filter_type": self.filter,
                "wrap_mode": "repeat" if "repeat" in self.wrap else "clamp" if self.folded else self.wrap[0],
                **({} if self.folded else {"to_uv": to_uv}),
            }
        )
        return _mapped(Folded(bitmap, self) if self.folded else bitmap, self.mapping)


def _wrapped(index: np.ndarray, count: int, rule: str) -> np.ndarray:
    """The texel for an index that may lie outside of the image."""
    if rule == "repeat":
        index = index % count
    elif rule == "mirror":
        index = index % (2 * count)
        index = np.minimum(index, 2 * count - 1 - index)
    return np.clip(index, 0, count - 1).astype(np.int64)


class Precise:
    """An image at texture coordinates in double precision: see `Image.precise`."""

    def __init__(self, image: Image) -> None:
        self.image = image

    def values(self, si: Any, place: Any) -> np.ndarray:
        """(n, 3) colours at `place`."""
        return self.image.precise(np.array(place.uv, dtype=np.float64).T)


class Folded(mi.Texture):
    """A Mitsuba bitmap with a separate wrap mode for each axis; all modes except repeat are applied
    here.
    """

    def __init__(self, inner: "mi.Texture", image: Image) -> None:
        mi.Texture.__init__(self, mi.Properties())
        self.inner, self.image = inner, image

    def eval(self, si: Any, active: Any = True) -> Any:
        image = self.image
        # Columns from the left, rows from the top.
        sign, start = (1, -1), (0, 1)
        places = []
        for axis, count in enumerate((image.pixels.shape[1], image.pixels.shape[0])):
            x = sign[axis] * (image.scale[axis] * np.array(si.uv[axis], dtype=np.float64) + image.offset[axis]) + start[axis]
            if image.wrap[axis] == "mirror":
                x = 1 - np.abs(x % 2 - 1)
            if image.wrap[axis] != "repeat":
                # Beyond the centre of the last texel the value is constant, as it is next to a
                # mirror image.
                x = np.clip(x, 0.5 / count, 1 - 0.5 / count)
            places.append(x)
        moved = mi.SurfaceInteraction3f(si)
        moved.uv = mi.Point2f(np.ascontiguousarray(places, dtype=np.float32))
        return self.inner.eval(moved, active)

    def to_string(self) -> str:
        return f"Folded[{self.image.wrap}]"


class Textures:
    """Reads texture values and resolves names of shared ones; each shared texture is read once."""

    def __init__(self, shared: Dict[str, Any], base: Folder, errors: List[str], unsupported: List[str]) -> None:
        self._tables = shared
        self.base = base
        self._errors = errors
        self.unsupported = unsupported
        self._read: Dict[str, Any] = {}
        # Names of shared textures that are being read, and the number of compound ones.
        self._open: List[str] = []
        self._depth = 0

    def check_unused(self) -> None:
        """Checks the type of each shared texture that nothing has read (§2)."""
        for name, table in self._tables.items():
            if name not in self._read:
                Fields(table, f"texture.{name}", self._errors).kind()

    def value(self, fields: Fields, key: str, default: Any, low: float, high: float) -> Any:
        """The texture under `key`: a number, a colour, a name or an inline table, with values in
        [low, high].

        For varying textures only the lower bound is checked: the model leaves the upper one open
        (§8).
        """
        raw = fields.take(key, default)
        if raw is None:
            return Constant((0.0, 0.0, 0.0))
        texture = self.read(raw, fields, key)
        if texture is None:
            return Constant((0.0, 0.0, 0.0))
        if not isinstance(texture, Constant):
            high = float("inf")
        least, most = texture.range()
        if least < low or most > high:
            span = f">= {low:g}" if high == float("inf") else f"from {low:g} to {high:g}"
            fields.error(key, f"expected values {span}, found {least:g} to {most:g}")
        return texture

    def read(self, raw: Any, fields: Fields, key: str) -> Any:
        """The texture that `raw`, the value of a key, describes; None (and an error) if it is
        invalid.
        """
        where = f"{fields.where}.{key}"
        if isinstance(raw, str):
            if raw not in self._tables:
                fields.error(key, f"no texture is called {raw!r}; {nearest(raw, list(self._tables))}")
                return None
            return self._shared(raw, where)
        if isinstance(raw, dict):
            return self._table(raw, where)
        color = as_color(raw)
        if color is None:
            fields.error(key, f"expected a colour, the name of a texture or a table, found {raw!r}")
            return None
        return Constant(color)

    def _shared(self, name: str, where: str) -> Any:
        """A shared texture; None (and an error) if it contains itself."""
        if name in self._open:
            self._errors.append(f"{where}: the texture {name!r} contains itself")
            return None
        if name not in self._read:
            self._open.append(name)
            self._read[name] = self._table(self._tables[name], f"texture.{name}")
            self._open.pop()
        return self._read[name]

    def _table(self, table: Any, where: str) -> Any:
        fields = Fields(table, where, self._errors)
        kind = fields.kind()
        reader = READERS.get(kind or "")
        try:
            if kind in COMPOUNDS:
                texture = self._compound(fields, kind)
            elif reader is None:
                if kind is not None:
                    known = [*READERS, *COMPOUNDS]
                    self.unsupported.append(f"{where}: no twin for a texture of type {kind!r}; {there_are(known)}")
                return Constant((0.0, 0.0, 0.0))
            else:
                texture = reader(fields, self.base)
        except Unsupported as error:
            self.unsupported.append(f"{where}: {error}")
            return Constant((0.0, 0.0, 0.0))
        fields.close()
        return texture

    def _compound(self, fields: Fields, kind: str) -> Any:
        """A texture made of others."""
        nothing = Constant((0.0, 0.0, 0.0))
        if self._depth == compounds.MAX_NESTING:
            fields.error(None, f"textures are nested more than {compounds.MAX_NESTING} deep")
            for key in ("factors", "a", "b", "weight", "input", "at"):
                fields.take(key)
            return nothing
        self._depth += 1
        found = COMPOUNDS[kind](fields, self)
        self._depth -= 1
        if found.depth > compounds.MAX_NESTING:
            fields.error(None, f"textures are nested more than {compounds.MAX_NESTING} deep")
            return nothing
        if found.size > compounds.MAX_LEAVES:
            raise Unsupported(f"no twin for more than {compounds.MAX_LEAVES} textures in one, found {found.size}")
        return found


def _pair(fields: Fields, key: str, default: Vector, number_allowed: bool) -> Vector:
    """Two numbers; a single number stands for both, where the model allows it."""
    raw = fields.take(key, default)
    if number_allowed and is_number(raw):
        return (float(raw), float(raw))
    return fields.vector(key, default, 2)


def _filter(fields: Fields) -> Tuple[str, int]:
    """The filter of an image, and its maximum anisotropy."""
    found = fields.choice("filter", "bilinear", ("bilinear", "nearest", *footprints.FILTERS))
    if fields.has("max_anisotropy") and found != "ewa":
        fields.error("max_anisotropy", 'requires `filter = "ewa"`')
    return found, fields.integer("max_anisotropy", 16, 1, 64)


WRAPS = ("repeat", "clamp", "mirror")


def _wrap(fields: Fields) -> Tuple[str, str]:
    """One wrap mode for both axes, or one for each."""
    value = fields.take("wrap", "repeat")
    pair = value if isinstance(value, list) else [value, value]
    if len(pair) != 2 or not all(word in WRAPS for word in pair):
        fields.error("wrap", f"expected one of {', '.join(map(repr, WRAPS))}, or two of them, found {value!r}")
        return ("repeat", "repeat")
    return pair[0], pair[1]


def _constant(fields: Fields, base: Folder) -> Constant:
    return Constant(fields.color("value", REQUIRED, -float("inf")))


def _checker(fields: Fields, base: Folder) -> Checker:
    return Checker(
        fields.color("a", 0.8, -float("inf")),
        fields.color("b", 0.2, -float("inf")),
        _pair(fields, "scale", (1.0, 1.0), True),
        _pair(fields, "offset", (0.0, 0.0), False),
        mappings.read(fields, "uv"),
    )


def _image(fields: Fields, base: Folder) -> Any:
    name = fields.string("file", REQUIRED)
    filtering, most = _filter(fields)
    wrap = _wrap(fields)
    channel = fields.choice("channel", "color", images.CHANNELS)
    if channel == "alpha" and fields.has("color_space"):
        fields.error("color_space", 'cannot be given together with `channel = "alpha"`')
    space = fields.choice("color_space", "auto", ("auto", "srgb", "linear"))
    scale = _pair(fields, "scale", (1.0, 1.0), True)
    offset = _pair(fields, "offset", (0.0, 0.0), False)
    mapping = mappings.read(fields, "uv")
    number = None
    if gltf.is_file(name):
        number = fields.integer("image", 0, 0, 2**31 - 1)
    elif fields.has("image"):
        fields.error("image", "requires a file ending in .gltf or .glb")
        fields.take("image")
    if not name:
        return Constant((0.0, 0.0, 0.0))
    try:
        if number is None:
            pixels = images.load(base.path(name), space, channel)
        else:
            pixels = images.inside(base.path(name), number, space, channel, base)
        return Image(pixels, filtering, wrap, scale, offset, mapping, max_anisotropy=most)
    except SceneError as error:
        fields.error("file", str(error))
        return Constant((0.0, 0.0, 0.0))


def _optimize(fields: Fields) -> Tuple[List[int], int, int, bool]:
    """Side lengths of the neighbourhoods (none if it is disabled), resolutions, iterations, and
    whether it is robust.
    """
    if not fields.has("optimize"):
        return [], 1, 0, False
    inner = Fields(fields.take("optimize"), f"{fields.where}.optimize", fields.errors)
    if inner.has("neighborhoods"):
        sides = inner.take("neighborhoods")
        if not isinstance(sides, list) or not 1 <= len(sides) <= 8 or not all(type(n) is int and 4 <= n <= 256 for n in sides):
            inner.error("neighborhoods", f"expected 1 to 8 integers from 4 to 256, found {sides!r}")
            sides = [4]
    else:
        sides = [inner.integer("neighborhood", 16, 4, 256)]
    resolutions, iterations = inner.integer("resolutions", 1, 1, 8), inner.integer("iterations", 4, 0, 64)
    robust = inner.flag("robust", False)
    inner.close()
    return sides, resolutions, iterations, robust


def _synthesized(fields: Fields, base: Folder) -> Any:
    name, size = fields.string("file", REQUIRED), fields.take("size", REQUIRED)
    if not isinstance(size, list) or len(size) != 2 or not all(type(n) is int and 1 <= n <= 4096 for n in size):
        fields.error("size", f"expected two integers from 1 to 4096, found {size!r}")
        size = [1, 1]
    block = fields.integer("block", 16, 2, 256)
    overlap = fields.integer("overlap", max(1, block // 4), 1, 128)
    tolerance = fields.number("tolerance", 0.1, lambda number: number >= 0, "a number >= 0")
    seed = fields.integer("seed", 0, 0, 2**32 - 1)
    sides, resolutions, iterations, robust = _optimize(fields)
    filtering, most = _filter(fields)
    wrap = _wrap(fields)
    space = fields.choice("color_space", "auto", ("auto", "srgb", "linear"))
    scale = _pair(fields, "scale", (1.0, 1.0), True)
    offset = _pair(fields, "offset", (0.0, 0.0), False)
    mapping = mappings.read(fields, "uv")
    try:
        sample = images.codes(base.path(name))
    except SceneError as error:
        fields.error("file", str(error))
        return Constant((0.0, 0.0, 0.0))
    if block > min(sample.shape[:2]) or 2 * overlap > block:
        fields.error("block", f"expected a block no larger than the sample and an overlap of at most half the block, found {block} and {overlap}")
        return Constant((0.0, 0.0, 0.0))
    room = min(sample.shape[:2] + tuple(size))
    if sides and (max(sides) > room or min(sides) > room >> resolutions - 1):
        coarsest = f"one of at most {room >> resolutions - 1}"
        fields.error("optimize", f"expected neighborhoods of at most {room}, {coarsest}, found {sides}")
        return Constant((0.0, 0.0, 0.0))
    picture = quilting.quilt(sample, (size[0], size[1]), block, overlap, tolerance, seed)
    values = quilting.at_all_resolutions(picture, sample, sides, resolutions, iterations, robust) / 255.0
    values = values if space == "linear" else images.srgb_to_linear(values)
    pixels = np.ascontiguousarray(values, dtype=np.float32)
    return Image(pixels, filtering, wrap, scale, offset, mapping, True, most)


def _grid_lines(fields: Fields, base: Folder) -> patterns.GridLines:
    a, b = fields.color("a", 0.8), fields.color("b", 0.2)
    width = _pair(fields, "width", (0.1, 0.1), True)
    if not all(0 <= number <= 1 for number in width):
        fields.error("width", f"expected widths from 0 to 1, found {width}")
    scale, offset = _pair(fields, "scale", (1.0, 1.0), True), _pair(fields, "offset", (0.0, 0.0), False)
    return patterns.GridLines(a, b, width, scale, offset, mappings.read(fields, "uv"))


def _positive(fields: Fields, key: str, default: float) -> float:
    return fields.number(key, default, lambda number: number > 0, "a number > 0")


def _noise(fields: Fields, base: Folder) -> patterns.Noise:
    kind = fields.choice("kind", "perlin", ("perlin", "fbm", "turbulence", "marble", "wood"))
    a, b, scale = fields.color("a", 0.2), fields.color("b", 0.8), _positive(fields, "scale", 1.0)
    octaves, lacunarity, gain, distortion = 1, 2.0, 0.5, 1.0
    if kind != "perlin":
        octaves = fields.integer("octaves", 4, 1, 16)
        lacunarity, gain = _positive(fields, "lacunarity", 2.0), _positive(fields, "gain", 0.5)
    if kind in ("marble", "wood"):
        distortion = fields.number("distortion", 1.0)
    try:
        if max(lacunarity ** (octaves - 1), sum(gain**k for k in range(octaves))) > 1e100:
            raise OverflowError
    except OverflowError:
        fields.error(None, "expected octaves that stay below 1e100; lower `lacunarity`, `gain` or `octaves`")
        lacunarity = gain = 1.0
    seed = fields.integer("seed", 0, 0, 2**32 - 1) if fields.has("seed") else None
    table = patterns.permutation(seed)
    return patterns.Noise(kind, a, b, scale, octaves, lacunarity, gain, distortion, table, mappings.read(fields, "solid"))


def _worley(fields: Fields, base: Folder) -> patterns.Worley:
    value = fields.choice("value", "f1", ("f1", "f2", "f2_minus_f1"))
    a, b, scale = fields.color("a", 0.2), fields.color("b", 0.8), _positive(fields, "scale", 1.0)
    return patterns.Worley(value, a, b, scale, fields.integer("seed", 0, 0, 2**32 - 1), mappings.read(fields, "solid"))


def _checker3d(fields: Fields, base: Folder) -> patterns.Layers:
    a, b, scale = fields.color("a", 0.8), fields.color("b", 0.2), _positive(fields, "scale", 1.0)
    offset = fields.vector("offset", (0.0, 0.0, 0.0), 3)
    return patterns.Layers("checker3d", a, b, scale, offset, mappings.read(fields, "solid"))


def _layers(kind: str) -> Callable[[Fields, Folder], patterns.Layers]:
    def read(fields: Fields, base: Folder) -> patterns.Layers:
        a, b, scale = fields.color("a", 0.8), fields.color("b", 0.2), _positive(fields, "scale", 1.0)
        return patterns.Layers(kind, a, b, scale, (fields.number("offset", 0.0),), mappings.read(fields, "solid"))

    return read


def _gradient(fields: Fields, base: Folder) -> patterns.Gradient:
    if fields.has("stops"):
        for key in ("a", "b"):
            if fields.has(key):
                fields.error(key, "cannot be given together with `stops`")
                fields.take(key)
        raw = fields.take("stops")
        if not isinstance(raw, list) or not 2 <= len(raw) <= 64:
            fields.error("stops", "expected 2 to 64 tables")
            raw = []
        stops = [Fields(table, f"{fields.where}.stops[{index}]", fields.errors) for index, table in enumerate(raw)]
        places = tuple(stop.number("at", REQUIRED, lambda at: 0 <= at <= 1, "a number from 0 to 1") for stop in stops)
        colors = tuple(stop.color("color", REQUIRED) for stop in stops)
        for stop in stops:
            stop.close()
        if any(before >= after for before, after in zip(places, places[1:])):
            fields.error("stops", f"expected positions `at` in ascending order, found {places}")
        places, colors = places or (0.0,), colors or ((0.0, 0.0, 0.0),)
    else:
        places, colors = (0.0, 1.0), (fields.color("a", 0.8), fields.color("b", 0.2))
    scale, offset = _positive(fields, "scale", 1.0), fields.number("offset", 0.0)
    wrap = fields.choice("wrap", "repeat", WRAPS)
    return patterns.Gradient(places, colors, scale, offset, wrap, mappings.read(fields, "solid"))


def _solid(fields: Fields, base: Folder) -> patterns.Solid:
    size = fields.take("size", REQUIRED)
    if not isinstance(size, list) or len(size) != 3 or not all(type(n) is int and 1 <= n <= 4096 for n in size):
        fields.error("size", f"expected three integers from 1 to 4096, found {size!r}")
        size = [1, 1, 1]
    channels = fields.take("channels", 1)
    if channels not in (1, 3):
        fields.error("channels", f"expected 1 or 3, found {channels!r}")
        channels = 1
    kind = fields.choice("format", "u8", ("u8", "f32")) if fields.has("file") else "u8"
    if fields.has("values") == fields.has("file"):
        fields.error(None, "expected either `values` or `file`")
    numbers = np.zeros(0)
    if fields.has("file"):
        name = base.path(fields.string("file", REQUIRED))
        try:
            raw = np.fromfile(name, dtype=np.uint8 if kind == "u8" else "<f4").astype(np.float64)
            numbers = raw / 255 if kind == "u8" else raw
        except OSError as error:
            fields.error("file", str(error))
    else:
        values = fields.take("values", [])
        if isinstance(values, list) and all(map(is_number, values)):
            numbers = np.array(values, dtype=np.float64)
    shape = (size[2], size[1], size[0], channels)
    if numbers.size != np.prod(shape) or not np.all(np.isfinite(numbers)) or np.any(numbers < 0):
        fields.error(None, f"expected {np.prod(shape)} finite numbers >= 0")
        shape, numbers = (1, 1, 1, 1), np.zeros(1)
    voxels = np.broadcast_to(numbers.reshape(shape), shape[:3] + (3,))
    filtering = fields.choice("filter", "trilinear", ("trilinear", "nearest"))
    wrap = fields.choice("wrap", "repeat", ("repeat", "clamp", "mirror"))
    return patterns.Solid(voxels, filtering, wrap, mappings.read(fields, "solid"))


def _product(fields: Fields, library: Textures) -> compounds.Product:
    raw = fields.take("factors", REQUIRED)
    if not isinstance(raw, list) or not 1 <= len(raw) <= 16:
        if raw is not None:
            fields.error("factors", f"expected 1 to 16 textures, found {raw!r}")
        raw = [1.0]
    found = [library.read(value, fields, f"factors[{number}]") for number, value in enumerate(raw)]
    return compounds.Product.of([part or Constant((1.0, 1.0, 1.0)) for part in found])


def _mix(fields: Fields, library: Textures) -> compounds.Mix:
    endless = float("inf")
    a, b = (library.value(fields, key, REQUIRED, -endless, endless) for key in ("a", "b"))
    return compounds.Mix.of([a, b, library.value(fields, "weight", 0.5, 0.0, 1.0)])


def _threshold(fields: Fields, library: Textures) -> compounds.Threshold:
    inner = library.value(fields, "input", REQUIRED, -float("inf"), float("inf"))
    return compounds.Threshold.of([inner], fields.number("at", 0.5))


def _vertex_color(fields: Fields, base: Folder) -> compounds.VertexColor:
    return compounds.VertexColor(fields.choice("channel", "color", ("color", "alpha")) == "alpha")


# Readers of textures that contain others.
COMPOUNDS: Dict[str, Callable[[Fields, Textures], Any]] = {"product": _product, "mix": _mix, "threshold": _threshold}

READERS = {
    "vertex_color": _vertex_color,
    "constant": _constant,
    "checker": _checker,
    "image": _image,
    "grid_lines": _grid_lines,
    "noise": _noise,
    "worley": _worley,
    "solid": _solid,
    "synthesized": _synthesized,
    "checker3d": _checker3d,
    "gradient": _gradient,
    "rings": _layers("rings"),
    "stripes": _layers("stripes"),
}
