"""Translates the scene document (flattened TOML) to a POV-Ray scene, following
`docs/whitted-model.md` only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Optional, Tuple

import tomllib

from whitstone_protocol.errors import SceneError, Unsupported

from . import cameras, checks, coincident, lights, registry, sdl, transforms
from .fields import REQUIRED, Context, Fields, nearest
from .materials import Material, Materials
from .settings import Setting
from .shapes import INSIDE, Place, Solid
from .textures import Library

TABLES = ("film", "camera", "sampler", "integrator", "accelerator", "light", "texture", "material", "group", "shape", "expect")
# POV-Ray's own limit on `max_trace_level`.
MAX_LEVEL = 256
# Upper bound on the nesting depth of groups (model §9).
MAX_NESTING = 16
# Upper bound on the shape instances in one scene file.
MAX_COPIES = 20000
# Upper bound on the scenes whose separated shapes are remembered.
MAX_SEPARATED = 16
_SEPARATED: Dict[Tuple[str, str, float], Tuple[Dict[int, coincident.Moves], List[Dict[str, Any]]]] = {}


@dataclass
class Document:
    """A scene that is ready to be written, for all channels or one."""

    width: int
    height: int
    # Positions inside the pixel, x to the right, y down, and indices of lens samples.
    samples: List[Tuple[float, float, int]]
    camera: cameras.Camera
    setting: Setting
    head: str
    body: str
    # Plugins that are composed of POV-Ray features by formula: (type, reason).
    formulas: List[Tuple[str, str]]
    # A program with the checks that only POV-Ray can do, to be run once; may be empty.
    check: str
    # The entries `coincident` of PROTOCOL.md.
    coincident: List[Dict[str, Any]] = field(default_factory=list)

    def write(self, sample: Tuple[float, float, int]) -> str:
        """The scene in POV-Ray's language, for one position in every pixel and one lens sample.
        POV-Ray itself samples the pixel centre.
        """
        dx, dy = sample[0] - 0.5 + self.setting.dx, sample[1] - 0.5 + self.setting.dy
        return "\n".join([self.head, self.camera.write(self.setting, dx, dy, sample[2]), self.body, ""])


@dataclass(frozen=True)
class _Shape:
    """A declared shape."""

    name: str
    solid: Solid
    material: Material
    # Its own transform, also if the twin has applied it.
    own: transforms.Matrix


@dataclass(frozen=True)
class _Placed:
    """An instance of a shape; `place` is the position of its table."""

    shape: _Shape
    around: "_Around"
    place: str
    # See `coincident.Placed`.
    rank: Tuple[str, int, int]


@dataclass(frozen=True)
class _Around:
    """What encloses the shapes of a list."""

    world: transforms.Matrix = transforms.IDENTITY
    # The index, in the list of the document, of the shape or instance that contains them.
    outermost: Optional[int] = None
    # The `materials` of the instances, from the innermost.
    replaced: Tuple[Dict[str, Any], ...] = ()
    casts_shadow: bool = True

    def shown(self, material: Any) -> Any:
        """The material that is seen of a shape with this one (model §9)."""
        for replaced in self.replaced:
            if isinstance(material, str):
                material = replaced.get(material, material)
        return material


@dataclass
class _Scene:
    """Collects objects while the shapes are traversed."""

    context: Context
    materials: Materials
    groups: Dict[str, Any]
    shadows: bool
    declarations: List[str] = field(default_factory=list)
    objects: List[str] = field(default_factory=list)
    used: List[Material] = field(default_factory=list)
    # By position of a shape's table: its name, its twin, its material. Instances share them.
    known: Dict[str, Optional["_Shape"]] = field(default_factory=dict)
    placed: List["_Placed"] = field(default_factory=list)
    open: List[str] = field(default_factory=list)
    # Placed objects that light can enter.
    entered: List[checks.Body] = field(default_factory=list)

    def walk(self, tables: Any, group: str, around: "_Around") -> None:
        """Adds the shapes of one list: of a group, or of the document if its name is empty."""
        where = f"group.{group}." if group else ""
        if not isinstance(tables, list):
            self.context.errors.append(f"{where}shape: expected an array of tables")
            return
        for index, table in enumerate(tables):
            place = f"{where}shape[{index}]"
            inside = around if around.outermost is not None else replace(around, outermost=index)
            if isinstance(table, dict) and table.get("casts_shadow") is False:
                inside = replace(inside, casts_shadow=False)
            if isinstance(table, dict) and table.get("type") == "instance":
                self.instance(Fields(table, place, self.context), inside)
                continue
            shown = table
            if isinstance(table, dict) and "material" in table:
                shown = {**table, "material": around.shown(table["material"])}
            key = place if shown == table else f"{place} with {shown['material']}"
            if key not in self.known:
                self.known[key] = self.shape(Fields(shown, place, self.context))
            entry = self.known[key]
            if entry is not None:
                rank = (group, index, len(self.placed))
                self.placed.append(_Placed(entry, inside, place, rank))
                if len(self.placed) > MAX_COPIES:
                    raise Unsupported(f"shape: POV-Ray has no twin of more than {MAX_COPIES} copies of shapes")

    def shape(self, fields: Fields) -> Optional["_Shape"]:
        """Reads a shape and declares its geometry."""
        twin = registry.find("shapes", fields)
        if twin is None:
            return None
        fields.text("id")
        fields.flag("casts_shadow", True)
        if fields.take("motion", None) is not None:
            fields.unsupported("POV-Ray renders one time: it has no motion blur", "motion")
        own = transforms.read(fields.take("transform"), f"{fields.where}.transform", self.context)
        material = self.materials.of(fields)
        solid = twin(fields, Place(self.context.setting, own))
        fields.close()
        if material is None:
            return None
        if material.transparent and not solid.closed:
            fields.unsupported("POV-Ray has no twin of what light enters and leaves through a shape that is not closed, or inside out")
        if material.branches and solid.smooth:
            # The model drops a branch to the wrong side of the surface (rule G).
            fields.unsupported("POV-Ray bends reflections back that interpolated normals send into the surface; the model drops them")
        if solid.smooth and not (self.shadows and solid.closed):
            # With shadows, a closed surface blocks such light itself (rule G).
            fields.unsupported("POV-Ray lights by interpolated normals even from behind the surface; the model does not")
        if solid.matrix is None:
            solid = replace(solid, matrix=own)
        elif material.transparent:
            solid = replace(solid, body=f"{solid.body} {INSIDE}")
        name = f"S{len(self.known)}"
        self.declarations += [solid.head] if solid.head else []
        self.declarations.append(f"#declare {name} = {solid.body} }}")
        self.used.append(material)
        return _Shape(name, solid, material, own)

    def put_all(self, key: Tuple[str, str, float]) -> List[Dict[str, Any]]:
        """Adds the objects of all shapes, and separates those that coincide. Returns the entries
        `coincident` of PROTOCOL.md. The scene and the scale identify the result: a scene is read
        many times, at several exposures and positions in the pixel.
        """
        outlined = [
            coincident.Placed(p.shape.solid.outline, transforms.product(p.around.world, p.shape.own), p.rank, p.around.outermost or 0) for p in self.placed
        ]
        if key not in _SEPARATED:
            if len(_SEPARATED) == MAX_SEPARATED:
                _SEPARATED.clear()
            _SEPARATED[key] = coincident.separate(outlined, self.context.setting.scale)
        moves, told = _SEPARATED[key]
        for number, placed in enumerate(self.placed):
            self.put(placed, *moves.get(number, coincident.STAYS))
        return told

    def put(self, placed: "_Placed", inner: transforms.Matrix, outer: transforms.Matrix) -> None:
        """Adds an instance of a shape. The maps `inner`, of object space, and `outer`, of world
        space, separate it from others.
        """
        name, solid, material, around = placed.shape.name, placed.shape.solid, placed.shape.material, placed.around.world
        scale = self.context.setting.scale
        own = solid.matrix or transforms.IDENTITY
        if (inner, outer) != coincident.STAYS:
            own_moved, around_moved = transforms.product(own, inner), transforms.product(outer, around)
        else:
            own_moved, around_moved = own, around
        moves = " ".join(transforms.write(matrix, scale) for matrix in (own_moved, around_moved))
        shadows = self.shadows and placed.around.casts_shadow
        dark = not shadows or material.transparent
        flag = (" no_shadow" if dark else "") + (" hollow" if material.transparent else "")
        # Textures see the point before the separation.
        surface = solid.surface.placed(transforms.product(around, own), scale)
        self.objects.append(f"object {{ {name} {material.texture(surface)} {material.interior} {moves}{flag} }}")
        if material.transparent:
            self.entered.append(checks.Body(placed.place, name, moves))
        if material.transparent and shadows:
            black = "texture { pigment { rgb 0 } finish { ambient 0 diffuse 0 } }"
            self.objects.append(f"object {{ {name} {black} {moves} no_image no_reflection }}")
        if len(self.objects) > MAX_COPIES:
            raise Unsupported(f"shape: POV-Ray has no twin of more than {MAX_COPIES} copies of shapes")

    def instance(self, fields: Fields, around: "_Around") -> None:
        """Adds an instance of the shapes of a group."""
        fields.take("type")
        fields.text("id")
        fields.flag("casts_shadow", True)
        if fields.take("motion", None) is not None:
            fields.unsupported("POV-Ray renders one time: it has no motion blur", "motion")
        replaced = fields.take("materials", {})
        if not isinstance(replaced, dict):
            fields.error("materials", "expected a table from names of materials to materials")
            replaced = {}
        own = transforms.read(fields.take("transform"), f"{fields.where}.transform", self.context)
        name = fields.text("group", REQUIRED)
        fields.close()
        if name not in self.groups:
            fields.error("group", f"no group is called {name!r}")
        elif name in self.open or len(self.open) == MAX_NESTING:
            fields.error("group", f"{name!r} contains itself, or groups are nested too deep")
        else:
            group = Fields(self.groups[name], f"group.{name}", self.context)
            group.take("accelerator")
            tables = group.take("shape", REQUIRED)
            group.close()
            self.open.append(name)
            world = transforms.product(around.world, own)
            self.walk(tables, name, replace(around, world=world, replaced=(replaced, *around.replaced)))
            self.open.pop()


def _film(table: Any, context: Context) -> Tuple[int, int]:
    fields = Fields(table, "film", context)
    width, height = fields.integer("width", 512, 1, 65536), fields.integer("height", 512, 1, 65536)
    for key in ("aovs", "paths"):
        if fields.take(key, None):
            fields.unsupported("POV-Ray has no layers other than the radiance", key)
    # Without moving shapes, which have no twin, the image is the same at all times.
    fields.take("time", None)
    fields.close()
    return width, height


def _sampler(table: Any, context: Context) -> List[Tuple[float, float]]:
    fields = Fields(table, "sampler", context)
    kind = fields.take("type", REQUIRED)
    n = 1
    if kind == "grid":
        n = fields.integer("samples_per_axis", 2, 1, 64)
    elif kind != "center":
        fields.unsupported(f"POV-Ray has no twin of the sampler type {kind!r}; {nearest(str(kind), ['center', 'grid'])}")
        return []
    fields.close()
    return [((a + 0.5) / n, (b + 0.5) / n) for b in range(n) for a in range(n)]


@dataclass(frozen=True)
class _Integrator:
    level: int
    shadows: bool
    # Whether the background shows beyond the depth limit.
    limit_shown: bool


def _integrator(table: Any, context: Context) -> _Integrator:
    fields = Fields(table, "integrator", context)
    kind = fields.take("type", REQUIRED)
    level, shown = 1, False
    shadowing = fields.choice("shadows", "opaque", ("opaque", "filtered", "none"))
    if shadowing == "filtered":
        fields.unsupported("POV-Ray's shadows through what is transparent follow a rule of its own", "shadows")
    shadows = shadowing != "none"
    if fields.number("light_cutoff", 0.0, lambda value: value >= 0, "a number >= 0") > 0:
        fields.unsupported("POV-Ray cuts off no faint lights", "light_cutoff")
    if kind == "whitted":
        level = 1 + fields.integer("max_depth", 6, 0, 100000)
        if level > MAX_LEVEL:
            fields.unsupported(f"POV-Ray follows at most {MAX_LEVEL - 1} reflections", "max_depth")
        if fields.number("min_contribution", 0.0, lambda value: value >= 0, "a number >= 0") > 0:
            fields.unsupported("POV-Ray cuts off faint branches by another rule", "min_contribution")
        shown = fields.choice("at_max_depth", "background", ("background", "black")) == "background"
    elif kind == "rasterizer":
        if fields.choice("interpolation", "phong", ("phong", "gouraud")) == "gouraud":
            fields.unsupported("POV-Ray does not interpolate colours of vertices", "interpolation")
    elif kind != "appel":
        known = ["appel", "rasterizer", "whitted"]
        fields.unsupported(f"POV-Ray has no twin of the integrator type {kind!r}; {nearest(str(kind), known)}")
        return _Integrator(1, True, False)
    fields.close()
    return _Integrator(level, shadows, shown)


def _check_media(used: List[Material], context: Context) -> None:
    """Refuses nested media. If a ray leaves one object for an enclosing one, POV-Ray 3.7 computes
    the Fresnel reflectance for a relative index of 1.
    """
    outsides = sorted({material.outside for material in used if material.outside is not None})
    if len(outsides) > 1:
        context.unsupported.append(
            f"material: POV-Ray's Fresnel reflection is wrong where one medium is inside another (here with indices outside of {outsides})"
        )


def _formulas(root: Dict[str, Any]) -> List[Tuple[str, str]]:
    """The plugins that are composed of POV-Ray features by formula, because POV-Ray's own differ.
    """
    found = []
    kinds = [light.get("type") for light in root.get("light", []) if isinstance(light, dict)]
    if "spot" in kinds:
        found.append(("spot", "POV-Ray's own spot falls off by a cubic of the cosine: a shell lets through what the model says"))
    if '"dielectric"' in repr(root).replace("'", '"'):
        found.append(("dielectric", "POV-Ray does not scale by the squared relative index: its filter does"))
    if '"conductor"' in repr(root).replace("'", '"'):
        found.append(("conductor", "POV-Ray knows real indices only: a map of mirrors by the angle does what the model says"))
    return found


def parse(text: str, base: str, setting: Setting, channel: Optional[int] = None) -> Document:
    """Reads a document. Raises `SceneError` with every problem, or `Unsupported` if only twins are
    missing.
    """
    try:
        root = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"not valid TOML: {error}") from error
    context = Context(base, setting, channel)
    for key in root:
        if key not in TABLES:
            context.errors.append(f"{key}: unknown table; {nearest(key, TABLES)}")
    width, height = _film(root.get("film", {}), context)
    camera = cameras.read(root.get("camera"), width, height, context)
    samples = _sampler(root.get("sampler", {"type": "center"}), context)
    integrator = _integrator(root.get("integrator", {"type": "whitted"}), context)
    lit = lights.read(root.get("light", []), context)
    library = Library(root.get("texture", {}), context)
    materials = Materials(root.get("material", {}), library, lit.ambient, context)
    scene = _Scene(context, materials, root.get("group", {}), integrator.shadows)
    scene.walk(root.get("shape", []), "", _Around())
    told = [] if context.errors else scene.put_all((text, base, setting.scale))
    _check_media(scene.used, context)
    if integrator.limit_shown and any(lit.background) and any(material.branches for material in scene.used):
        context.unsupported.append("integrator.at_max_depth: POV-Ray shows black where it goes no deeper, not the background")
    if context.errors:
        raise SceneError("\n".join(dict.fromkeys(context.errors)))
    if context.unsupported:
        raise Unsupported("\n".join(dict.fromkeys(context.unsupported)))
    assert camera is not None
    head = (
        "#version 3.7;\n"
        f"global_settings {{ assumed_gamma 1.0 max_trace_level {integrator.level} adc_bailout 0 ambient_light rgb 1 }}\n"
        f"background {{ {sdl.rgb(lit.background)} }}"
    )
    body = "\n".join([*lit.objects, *scene.declarations, *scene.objects])
    places = camera.samples(samples)
    check = checks.program(head, scene.declarations, scene.entered, camera.origins(setting, places))
    return Document(width, height, places, camera, setting, head, body, _formulas(root), check, told)
