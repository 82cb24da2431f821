"""Reads and checks the scene document (flattened TOML), following `docs/whitted-model.md` §2-§10
only.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Any, List, Optional, Tuple

from whitstone_protocol.errors import SceneError, Unsupported

from . import (
    cameras,
    compounds,
    footprints,
    lights,
    materials,
    motion,
    paths,
    patterns,
    samplers,
    shapes,
    textures,
)
from .fields import Fields, nearest, there_are
from .files import Folder

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

AOVS = ("depth", "normal", "uv", "shape_id", "primitive_id")
TABLES = ("film", "camera", "sampler", "integrator", "accelerator", "light", "texture", "material", "group", "shape", "expect")


@dataclass(frozen=True)
class Integrator:
    """The integrator (model §6)."""

    follow: bool
    max_depth: int
    min_contribution: float
    limit_background: bool
    shadows: bool
    gouraud: bool = False
    # Whether transparent surfaces attenuate shadow rays instead of blocking them.
    filtered: bool = False
    # A lamp does not count where its irradiance is below this in every channel.
    light_cutoff: float = 0.0

    def bounces(self, directions: int) -> int:
        """Upper bound on path length when every bounce splits into `directions` equally weighted
        rays.
        """
        found, share = 0, 1 / directions
        while found < self.max_depth and share >= self.min_contribution and share > 0:
            found, share = found + 1, share / directions
        return found


@dataclass(frozen=True)
class Document:
    """The scene of a document, with the model's defaults filled in."""

    width: int
    height: int
    aovs: Tuple[str, ...]
    samples: samplers.Samples
    camera: cameras.Camera
    integrator: Integrator
    lights: lights.Lights
    materials: Tuple[materials.Material, ...]
    shapes: Tuple[shapes.Shape, ...]
    folder: Folder
    # Path classes: names and expressions.
    paths: Tuple[Tuple[str, str], ...] = ()
    # Whether a surface has a texture that is filtered over footprints.
    footprints: bool = False
    # Whether a surface has a bump map with a height that depends on (u, v).
    gradients: bool = False
    # Number of times at which the film sees the scene; this is the scene at one of them.
    moments: int = 1
    # Whether any of its shapes moves.
    moves: bool = False
    # The coincident surfaces: dictionaries of shapes, form and gap, or of not_examined.
    coincident: Tuple[dict, ...] = ()

    def used(self) -> set:
        """Indices of the materials of shapes, including their parts."""
        found: set = set()
        open_ = {shape.material for shape in self.shapes}
        while open_:
            number = open_.pop()
            found.add(number)
            open_.update(set(self.materials[number].parts) - found)
        return found

    def hosted(self) -> List[dict]:
        """The plugins that are not native to Mitsuba, with reasons: dictionaries of type, twin and
        reason.
        """
        found = {}
        used = self.used()
        sources = [self.materials[number].hosted() for number in sorted(used)] + [lamp.hosted() for lamp in self.lights.lamps]
        for entry in sources:
            if entry is not None:
                found[entry[0]] = {"type": entry[0], "twin": "hosted", "reason": entry[1]}
        for shape in self.shapes:
            if shape.surface is not None:
                found[shape.type] = {"type": shape.type, "twin": "hosted", "reason": shape.reason}
        maps = [self.materials[number].directions for number in sorted(used) if self.materials[number].directions is not None]
        if maps:
            reason = "the driver looks up the map by the directions of Mitsuba's BSDFs"
            found["reflection_map"] = {"type": "reflection_map", "twin": "formula", "reason": reason}
        whole = [texture for number in used for texture in (*self.materials[number].textures.values(), self.materials[number].ambient)]
        whole += [texture for texture in maps if not isinstance(texture, lights.Cube)]
        textures = [leaf for texture in whole for leaf in compounds.leaves(texture)]
        if any(isinstance(texture, compounds.Compound) for texture in whole):
            reason = "the driver combines the values of textures: Mitsuba evaluates its own, one by one"
            found["compound"] = {"type": "compound", "twin": "hosted", "reason": reason}
        if any(isinstance(texture, compounds.VertexColor) for texture in textures):
            reason = "the driver interpolates the colours of vertices"
            found["vertex_color"] = {"type": "vertex_color", "twin": "hosted", "reason": reason}
        if any(getattr(texture, "quilted", False) for texture in textures):
            reason = "the driver synthesizes the image in Python; Mitsuba looks it up"
            found["synthesized"] = {"type": "synthesized", "twin": "hosted", "reason": reason}
        covering = [texture for texture in textures if getattr(texture, "covers", False)]
        for name in sorted({texture.filter for texture in covering}):
            reason = "ray differentials, mipmap levels and filtered values are computed in Python: Mitsuba's bitmaps have no mipmaps"
            found[name] = {"type": name, "twin": "hosted", "reason": reason}
        if any(getattr(texture, "folded", False) and not texture.covers for texture in textures):
            reason = "Mitsuba's bitmaps have one wrap mode for both axes: the second mode is applied in Python"
            found["wrap"] = {"type": "wrap", "twin": "hosted", "reason": reason}
        if any(isinstance(texture, patterns.HOSTED) for texture in textures):
            reason = "Mitsuba lacks this texture: its formula is computed in Python"
            found["pattern"] = {"type": "pattern", "twin": "hosted", "reason": reason}
        own = [texture for texture in textures if hasattr(texture, "mapping") and not isinstance(texture, patterns.HOSTED)]
        if any(not texture.mapping.usual() and not getattr(texture, "covers", False) for texture in own):
            reason = "the texture mapping is computed in Python: Mitsuba's own textures use (u, v) only"
            found["mapping"] = {"type": "mapping", "twin": "hosted", "reason": reason}
        if self.moves:
            reason = "Mitsuba has no moving shapes: the driver interpolates transforms, and averages images at fixed times"
            found["motion"] = {"type": "motion", "twin": "hosted", "reason": reason}
        camera = self.camera.hosted()
        if camera is not None:
            found[camera[0]] = {"type": camera[0], "twin": "formula", "reason": camera[1]}
        if self.lights.environments:
            reason = "the driver looks up the texture by direction: Mitsuba's own emitter takes images only, and is sampled at random"
            found["environment"] = {"type": "environment", "twin": "formula", "reason": reason}
        if self.integrator.gouraud:
            found["rasterizer"] = {"type": "rasterizer", "twin": "formula", "reason": "the driver interpolates the colours of vertices (Gouraud shading)"}
        if self.lights.ambients and any(self.materials[number].ambient is not None for number in used):
            reason = "Mitsuba has no ambient term: the driver multiplies the reflectance by the ambient radiance"
            found["ambient"] = {"type": "ambient", "twin": "formula", "reason": reason}
        if any(self.materials[number].interior != (0, 0, 0) or self.materials[number].exterior != (0, 0, 0) for number in used):
            reason = "the driver computes exp(-a t): Mitsuba's media need a volume integrator"
            found["absorption"] = {"type": "absorption", "twin": "formula", "reason": reason}
        return list(found.values())

    def twin(self) -> str:
        return twin_of(self.hosted())


def twin_of(hosted: List[dict]) -> str:
    """The least independent kind of twin in use: native, hosted or formula."""
    kinds = {entry["twin"] for entry in hosted}
    return next((kind for kind in ("formula", "hosted") if kind in kinds), "native")


def _film(table: Any, errors: List[str]) -> Tuple[int, int, Tuple[str, ...], Tuple[Tuple[str, str], ...]]:
    fields = Fields(table, "film", errors)
    width, height = fields.integer("width", 512, 1, 65536), fields.integer("height", 512, 1, 65536)
    if width * height > 2**28:
        fields.error(None, f"at most 2^28 pixels in all, found {width} x {height}")
    names = fields.take("aovs", [])
    if not isinstance(names, list) or any(name not in AOVS for name in names):
        fields.error("aovs", f"expected a list of names from {', '.join(AOVS)}, found {names!r}")
        names = []
    classes = paths.read(fields.take("paths", {}), errors)
    fields.take("time")  # read by `motion`
    fields.close()
    return width, height, tuple(name for name in AOVS if name in names), classes


def _integrator(table: Any, errors: List[str], unsupported: List[str]) -> Optional[Integrator]:
    fields = Fields(table, "integrator", errors)
    kind = fields.kind()
    if kind not in ("whitted", "appel", "rasterizer"):
        if kind is not None:
            known = ["whitted", "appel", "rasterizer"]
            unsupported.append(f"integrator: no twin for an integrator of type {kind!r}; {there_are(known)}")
        return None
    shadowing = fields.choice("shadows", "opaque", ("opaque", "filtered", "none"))
    shadows, filtered = shadowing != "none", shadowing == "filtered"
    faintest = fields.number("light_cutoff", 0.0, lambda value: value >= 0, "a number >= 0")
    depth, cut, limit = 0, 0.0, False
    if kind == "whitted":
        depth = fields.integer("max_depth", 6, 0, 100000)
        cut = fields.number("min_contribution", 0.0, lambda value: value >= 0, "a number >= 0")
        limit = fields.choice("at_max_depth", "background", ("background", "black")) == "background"
    gouraud = kind == "rasterizer" and fields.choice("interpolation", "phong", ("phong", "gouraud")) == "gouraud"
    fields.close()
    return Integrator(kind == "whitted", depth, cut, limit, shadows, gouraud, filtered, faintest)


def _only_triangles(tables: Any, camera: Optional[cameras.Camera], errors: List[str]) -> None:
    """Checks that a rasterizer can render the scene."""
    kinds = {table.get("type") for table in tables if isinstance(table, dict)} - {"triangle", "mesh", "heightfield"}
    if kinds:
        errors.append(f"integrator: a rasterizer renders triangles only, found {', '.join(sorted(map(str, kinds)))}")
    if camera is not None and camera.kind not in ("perspective", "orthographic"):
        errors.append(f"integrator: a rasterizer needs a perspective or orthographic camera, found {camera.kind}")


def _check_ray_count(integrator: Integrator, all_materials: List[materials.Material], shape_list: List[shapes.Shape], errors: List[str]) -> None:
    """Checks that surfaces which spread their branches do not produce too many rays."""
    for number in sorted({shape.material for shape in shape_list}):
        spread = [all_materials[number].rays(letter) for letter in "RT"] if number < len(all_materials) else [1]
        bounces = integrator.bounces(max(spread)) if max(spread) > 1 else 0
        together = sum(rays for rays in spread if rays > 1)
        if together**bounces > 2**24:
            errors.append(f"material: glossy surfaces may split a camera ray into {together}^{bounces} rays, more than 2^24")


def _shared(value: Any, name: str, errors: List[str]) -> dict:
    if isinstance(value, dict):
        return value
    errors.append(f"{name}: expected tables, [{name}.ID]")
    return {}


def parse(text: str, base: str, moment: int = 0) -> Document:
    """Reads a document, at the time of the film with this number. Raises `SceneError` with every problem, or `Unsupported` if only twins are
    missing.
    """
    try:
        root = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"not valid TOML: {error}") from error
    folder = Folder(base)
    errors: List[str] = []
    unsupported: List[str] = []
    for key in root:
        if key not in TABLES:
            errors.append(f"{key}: unknown table; {nearest(key, TABLES)}")
    width, height, aovs, classes = _film(root.get("film", {}), errors)
    moves = motion.any_moves(root)
    root, moments = motion.still(root, moment, errors)
    camera = cameras.read(root.get("camera"), width, height, errors, unsupported)
    sampler = samplers.read(root.get("sampler", {"type": "center"}), errors, unsupported)
    integrator = _integrator(root.get("integrator", {"type": "whitted"}), errors, unsupported)
    if isinstance(root.get("integrator"), dict) and root["integrator"].get("type") == "rasterizer":
        _only_triangles(root.get("shape", []), camera, errors)
        if integrator is not None and integrator.gouraud and camera is not None and (camera.kind != "perspective" or camera.near != 0):
            errors.append("integrator.interpolation: Gouraud shading needs a perspective camera without a near limit")
    if classes and integrator is not None and integrator.gouraud:
        errors.append("film.paths: Gouraud shading has no path classes")
    texture_reader = textures.Textures(_shared(root.get("texture", {}), "texture", errors), folder, errors, unsupported)
    lamps = lights.read(root.get("light", []), texture_reader, folder, errors, unsupported)
    material_reader = materials.Materials(_shared(root.get("material", {}), "material", errors), texture_reader, errors, unsupported)
    groups = _shared(root.get("group", {}), "group", errors)
    shape_list, found = shapes.read(root, groups, material_reader, texture_reader, folder, errors, unsupported)
    material_reader.check_unused()
    texture_reader.check_unused()
    covered = gradients = False
    if integrator is not None:
        _check_ray_count(integrator, material_reader.all, shape_list, errors)
    if not errors and not unsupported:
        covered = footprints.used(material_reader.all, shape_list)
        gradients = footprints.gradients_used(material_reader.all, shape_list)
        unsupported += footprints.unsupported(material_reader.all, shape_list)
    # A document can be both invalid and unsupported; errors take precedence.
    if errors:
        raise SceneError("\n".join(errors))
    if unsupported:
        raise Unsupported("\n".join(unsupported))
    assert camera is not None and integrator is not None
    if found.planes:
        places = [(lamp, lamp.place()) for lamp in lamps.lamps]
        margins = tuple(lamp if place is None else replace(lamp, margin=found.margin(place)) for lamp, place in places)
        lamps = replace(lamps, lamps=margins)
    return Document(width, height, aovs, samplers.Samples.all(sampler, camera.lens_points()), camera, integrator, lamps, tuple(material_reader.all), tuple(shape_list), folder, classes, covered, gradients, moments, moves, tuple(found.reported))
