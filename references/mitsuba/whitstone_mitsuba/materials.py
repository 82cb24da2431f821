"""Readers of materials (model §8), and their BSDFs.

Matte, mirror, conductor, dielectric, thin_dielectric and plastic are Mitsuba's own BSDFs. The Phong
family and the constant k_refl / k_refr of the lectures are one Python BSDF, `PhongFamily`: it is
hosted by Mitsuba's geometry and frames, but its formulas are ours. So is the BSDF of `tabulated`.
Ambient terms have no twin in Mitsuba; the driver computes them from the reflectance texture.
Composite materials have no BSDF: see `shaders.py`.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Optional, Sequence, Set, Tuple

from . import tabulated
from .compounds import Product, leaves
from .fields import REQUIRED, Fields, Vector, nearest, there_are
from .lights import direction_map
from .runtime import dr, mi
from .textures import Constant, Textures

REFLECT, TRANSMIT = "R", "T"
BLACK: Vector = (0.0, 0.0, 0.0)


class PhongFamily(mi.BSDF):
    """k_d [n.l]+ + k_s lobe^exponent, and delta branches of constant weight; `eval` includes the
    cosine where the model has it.

    It works in the local frame of the shading normal; Mitsuba's `wi` is the model's v, `wo` its l.
    It is two-sided.
    """

    def __init__(self, props: "mi.Properties") -> None:
        mi.BSDF.__init__(self, props)
        self.k_d, self.k_s = props["k_d"], props["k_s"]
        self.k_refl, self.k_refr = props["k_refl"], props["k_refr"]
        self.blinn = props["blinn"]
        # Opaque: the values must not become constants of the kernel, or every scene would compile
        # its own.
        self.exponent = dr.opaque(mi.Float, props["exponent"])
        self.eta = dr.opaque(mi.Float, props["eta"])
        self.m_components = [
            mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide,
            mi.BSDFFlags.DeltaReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide,
            mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide | mi.BSDFFlags.NonSymmetric,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1] | self.m_components[2]

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        v = si.wi
        side = dr.select(v.z < 0, mi.Float(-1), mi.Float(1))
        cosine = wo.z * side
        if self.blinn:
            half = dr.normalize(wo + v)
            lobe = half.z * side
        else:
            lobe = dr.dot(mi.Vector3f(-wo.x, -wo.y, wo.z), v)
        highlight = dr.select(lobe > 0, dr.power(dr.clip(lobe, 0, 1), self.exponent), 0)
        value = self.k_d.eval(si, active) * dr.maximum(cosine, 0) + self.k_s.eval(si, active) * highlight
        return dr.select(active & (cosine > 0), value, 0)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return mi.Float(0)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval(ctx, si, wo, active), mi.Float(0)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        """The delta branch that `ctx.type_mask` requests, with its full weight (probability 1)."""
        _, cos_t, eta_it, eta_ti = mi.fresnel(mi.Frame3f.cos_theta(si.wi), self.eta)
        total = cos_t == 0
        k_refl, k_refr = self.k_refl.eval(si, active), self.k_refr.eval(si, active)
        reflects = ctx.is_enabled(mi.BSDFFlags.DeltaReflection, 1)
        transmits = ctx.is_enabled(mi.BSDFFlags.DeltaTransmission, 2) and not reflects
        bs = dr.zeros(mi.BSDFSample3f)
        bs.pdf, bs.eta = mi.Float(1), mi.Float(1)
        if transmits:
            bs.wo = mi.refract(si.wi, cos_t, eta_ti)
            bs.eta = eta_it
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DeltaTransmission)
            bs.sampled_component = mi.UInt32(2)
            return bs, dr.select(active & ~total, k_refr, 0)
        bs.wo = mi.reflect(si.wi)
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DeltaReflection)
        bs.sampled_component = mi.UInt32(1)
        return bs, dr.select(active, k_refl + dr.select(total, k_refr, mi.Color3f(0)), 0)

    def to_string(self) -> str:
        return f"PhongFamily[blinn={self.blinn}]"


mi.register_bsdf("whitstone_phong_family", lambda props: PhongFamily(props))


@dataclass(frozen=True)
class Material:
    """A material from the document; `build` creates its twin."""

    type: str
    # The texture that is multiplied by the ambient light; None if there is no ambient term.
    ambient: Optional[Any] = None
    # The delta branches it can have, in the model's order.
    branches: Tuple[str, ...] = ()
    smooth: bool = False
    # Absorption coefficients per metre, of the medium inside and of the one outside.
    interior: Vector = BLACK
    exterior: Vector = BLACK
    textures: Dict[str, Any] = field(default_factory=dict)
    numbers: Dict[str, float] = field(default_factory=dict)
    # Indices of the materials that it is composed of.
    parts: Tuple[int, ...] = ()
    # Whether it can refract rays.
    refracts: bool = False
    # Whether it replaces the shading normal.
    normal_mapped: bool = False
    # For a normal map and a vector bump map: the tangent, or the axis that the tangent goes around.
    direction: Vector = (1.0, 0.0, 0.0)
    around: bool = False
    # Whether a vector bump map is relative to that tangent instead of in world space.
    tangent: bool = False
    # Whether the tangent of a normal map is that of the mesh.
    mesh_tangent: bool = False
    # For a conductor: eta and k as colours.
    index: Tuple[Vector, Vector] = (BLACK, BLACK)
    # The priority of a dielectric; None if it has none.
    priority: Optional[int] = None
    # Maximum number of reflected rays per hit, and of transmitted ones.
    spread: int = 1
    through: int = 1
    # Whether it can have holes.
    holes: bool = False
    # The map that reflections are looked up in; None if they are traced.
    directions: Any = None
    # The BRDF of a tabulated material.
    table: Any = None

    def rays(self, letter: str) -> int:
        """The maximum number of branches of a kind."""
        return self.spread if letter == REFLECT else self.through

    def hosted(self) -> Optional[Tuple[str, str]]:
        """(plugin type, reason) if the twin is not native."""
        if self.type in ("phong", "blinn_phong", "whitted", "tabulated"):
            return self.type, "its reflection formula is a Python BSDF, which Mitsuba lacks"
        if self.type in COMPOSITES:
            return self.type, "the driver combines the BSDFs of its parts, which Mitsuba evaluates"
        if self.type == "plastic":
            return self.type, "the driver scales the diffuse part of Mitsuba's, which approximates the diffuse Fresnel reflectance by a polynomial"
        if self.type == "glossy":
            return self.type, "the driver chooses the directions around Mitsuba's mirror direction; Mitsuba's rough metals sample theirs at random"
        if self.priority is not None:
            return "priority", "the driver tracks the media that a ray is in; Mitsuba only evaluates the Fresnel equations"
        return None

    def build(self) -> "mi.BSDF":
        built = {name: texture.build() for name, texture in self.textures.items()}
        if self.type == "matte":
            return mi.load_dict({"type": "twosided", "inner": {"type": "diffuse", "reflectance": built["reflectance"]}})
        if self.type in ("mirror", "glossy"):
            inner = {"type": "conductor", "material": "none", "specular_reflectance": built["reflectance"]}
            return mi.load_dict({"type": "twosided", "inner": inner})
        if self.type == "conductor":
            eta, k = (Constant(value).build() for value in self.index)
            inner = {"type": "conductor", "eta": eta, "k": k, "specular_reflectance": built["tint"]}
            return mi.load_dict({"type": "twosided", "inner": inner})
        if self.type == "thin_dielectric":
            ior = self.numbers
            plugin = {"type": "thindielectric", "int_ior": ior["interior_ior"], "ext_ior": ior["exterior_ior"]}
            return mi.load_dict({**plugin, "specular_transmittance": built["tint"]})
        if self.type == "tabulated":
            return tabulated.Tabulated(self.table, built["tint"])
        if self.type == "plastic":
            ior = self.numbers
            # Its texture is the driver's: Mitsuba asks for its mean, which Python textures lack.
            inner = {"type": "plastic", "int_ior": ior["interior_ior"], "ext_ior": ior["exterior_ior"], "diffuse_reflectance": 1.0}
            return mi.load_dict({"type": "twosided", "inner": inner})
        if self.type in COMPOSITES:
            # The BSDF of Mitsuba's shape; it is never evaluated.
            return mi.load_dict({"type": "diffuse"})
        if self.type == "dielectric":
            ior = self.numbers
            return mi.load_dict({"type": "dielectric", "int_ior": ior["interior_ior"], "ext_ior": ior["exterior_ior"]})
        eta = self.numbers.get("interior_ior", 1.0) / self.numbers.get("exterior_ior", 1.0)
        zero = Constant(BLACK)
        return mi.load_dict(
            {
                "type": "whitstone_phong_family",
                "blinn": self.type == "blinn_phong",
                "exponent": self.numbers["exponent"],
                "eta": eta,
                "k_d": built["k_d"],
                "k_s": built["k_s"],
                "k_refl": built.get("k_refl") or zero.build(),
                "k_refr": built.get("k_refr") or zero.build(),
            }
        )


def _is_nonzero(texture: Any) -> bool:
    """Whether a texture is not black everywhere."""
    return texture.range()[1] > 0


def _matte(fields: Fields, textures: Textures) -> Material:
    reflectance = textures.value(fields, "reflectance", 0.5, 0.0, 1.0)
    return Material("matte", reflectance, (), True, textures={"reflectance": reflectance})


def _phong(fields: Fields, textures: Textures, kind: str, default: float = 0.5) -> Material:
    k_d = textures.value(fields, "k_d", default, 0.0, math.inf)
    k_s = textures.value(fields, "k_s", default, 0.0, math.inf)
    exponent = fields.number("exponent", 32.0, lambda value: value > 0, "an exponent > 0")
    k_a = textures.value(fields, "k_a", None, 0.0, math.inf) if fields.has("k_a") else k_d
    fields.take("k_a")
    return Material(kind, k_a, (), True, textures={"k_d": k_d, "k_s": k_s}, numbers={"exponent": exponent})


def _tabulated(fields: Fields, textures: Textures) -> Material:
    table = tabulated.read(fields)
    tint = textures.value(fields, "tint", 1.0, 0.0, 1.0)
    albedo = Constant(tuple(float(part) for part in table.normal_albedo()))
    ambient = Product.of([tint, albedo])
    if isinstance(tint, Constant):
        ambient = Constant(tuple(a * b for a, b in zip(tint.value, albedo.value)))
    return Material("tabulated", ambient, (), True, textures={"tint": tint}, table=table)


def _indices(fields: Fields) -> Dict[str, float]:
    return {
        key: fields.number(key, default, lambda value: value > 0, "an index of refraction > 0")
        for key, default in (("interior_ior", 1.5), ("exterior_ior", 1.0))
    }


def _media(fields: Fields) -> Tuple[Dict[str, float], Vector, Vector]:
    return _indices(fields), fields.color("absorption", 0.0), fields.color("exterior_absorption", 0.0)


def _whitted(fields: Fields, textures: Textures) -> Material:
    lobes = _phong(fields, textures, "whitted", 0.0)
    k_refl = textures.value(fields, "k_refl", 0.0, 0.0, math.inf)
    k_refr = textures.value(fields, "k_refr", 0.0, 0.0, math.inf)
    ior, interior, exterior = _media(fields)
    branches = (REFLECT,) * (_is_nonzero(k_refl) or _is_nonzero(k_refr)) + (TRANSMIT,) * _is_nonzero(k_refr)
    return Material(
        "whitted",
        lobes.ambient,
        branches,
        True,
        interior,
        exterior,
        {**lobes.textures, "k_refl": k_refl, "k_refr": k_refr},
        {**lobes.numbers, **ior},
        refracts=_is_nonzero(k_refr),
    )


def _mirror(fields: Fields, textures: Textures) -> Material:
    return Material("mirror", None, (REFLECT,), textures={"reflectance": textures.value(fields, "reflectance", 1.0, 0.0, 1.0)})


def _lobe(fields: Fields, samples: int) -> Tuple[Dict[str, float], int]:
    """The numbers of a lobe, whose `samples` have this default, and the number of its directions."""
    exponent = fields.number("exponent", 100.0, lambda value: value > 0, "an exponent > 0")
    n = fields.integer("samples", samples, 1, 8)
    return {"exponent": exponent, "samples": n}, n * n


def _glossy(fields: Fields, textures: Textures) -> Material:
    reflectance = textures.value(fields, "reflectance", 1.0, 0.0, 1.0)
    numbers, spread = _lobe(fields, 4)
    return Material("glossy", None, (REFLECT,), textures={"reflectance": reflectance}, numbers=numbers, spread=spread)


def _plastic(fields: Fields, textures: Textures) -> Material:
    reflectance = textures.value(fields, "reflectance", 0.5, 0.0, 1.0)
    ior = _indices(fields)
    numbers, spread = _lobe(fields, 1)
    return Material("plastic", reflectance, (REFLECT,), True, textures={"reflectance": reflectance}, numbers={**ior, **numbers}, spread=spread)


def _dielectric(fields: Fields, textures: Textures) -> Material:
    ior, interior, exterior = _media(fields)
    priority = fields.integer("priority", None, 0, 65535) if fields.has("priority") else None
    if priority is not None and (ior["exterior_ior"] != 1 or exterior != BLACK):
        fields.error("priority", "the medium outside follows from the surrounding bodies: `exterior_ior` must be 1, `exterior_absorption` 0")
    return Material("dielectric", None, (REFLECT, TRANSMIT), False, interior, exterior, {}, ior, refracts=True, priority=priority)


# eta and k of measured metals, as listed in the model.
METALS: Dict[str, Tuple[Vector, Vector]] = {
    "Ag": ((0.15528, 0.11673, 0.13839), (4.82835, 3.12222, 2.14690)),
    "Al": ((1.65750, 0.88040, 0.52124), (9.22381, 6.26950, 4.83700)),
    "Au": ((0.14304, 0.37531, 1.44205), (3.98300, 2.38556, 1.60336)),
    "Be": ((4.18501, 3.18503, 2.78406), (3.83547, 3.01012, 2.86899)),
    "Cr": ((4.36967, 2.91651, 1.65490), (5.20655, 4.23131, 3.75470)),
    "Cu": ((0.20101, 0.92375, 1.10222), (3.91326, 2.45305, 2.14209)),
    "Hg": ((2.39894, 1.44003, 0.90957), (6.32759, 4.37192, 3.42176)),
    "Ir": ((3.08630, 2.08219, 1.61791), (5.59215, 4.06709, 3.26731)),
    "Ni": ((2.36730, 1.66337, 1.46708), (4.49881, 3.05015, 2.34544)),
    "W": ((4.37082, 3.30025, 2.99841), (3.50064, 2.60487, 2.27323)),
}


def _conductor(fields: Fields, textures: Textures) -> Material:
    tint = textures.value(fields, "tint", 1.0, 0.0, 1.0)
    if fields.has("metal"):
        if fields.has("eta") or fields.has("k"):
            fields.error("metal", "cannot be given together with `eta` or `k`")
        index = METALS[fields.choice("metal", None, tuple(METALS))]
    else:
        index = fields.color("eta", REQUIRED, 0.0, 1000.0), fields.color("k", REQUIRED, 0.0, 1000.0)
        if min(index[0]) <= 0:
            fields.error("eta", f"expected components > 0, found {index[0]}")
    return Material("conductor", None, (REFLECT,), textures={"tint": tint}, index=index)


def _thin_dielectric(fields: Fields, textures: Textures) -> Material:
    ior = _indices(fields)
    tint = textures.value(fields, "tint", 1.0, 0.0, 1.0)
    return Material("thin_dielectric", None, (REFLECT, TRANSMIT), textures={"tint": tint}, numbers=ior)


def _composite_of(kind: str, parts: Sequence[Material], **more: Any) -> Material:
    """A composite material with the capabilities of all its parts."""
    branches = tuple(letter for letter in (REFLECT, TRANSMIT) if any(letter in part.branches for part in parts))
    return Material(kind, None, branches, any(part.smooth for part in parts), refracts=any(part.refracts for part in parts),
        normal_mapped=any(part.normal_mapped for part in parts), spread=max([part.spread for part in parts], default=1),
        through=max([part.through for part in parts], default=1), holes=any(part.holes for part in parts), **more)


def _emissive(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    radiance = textures.value(fields, "radiance", 1.0, 0.0, math.inf)
    return replace(_composite_of("emissive", parts, textures={"radiance": radiance}), smooth=True)


def _reflection_map(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    made = _composite_of("reflection_map", parts)
    transmitted = tuple(letter for letter in made.branches if letter != REFLECT)
    return replace(made, branches=transmitted, smooth=True, spread=1, directions=direction_map(fields, textures))


def _mask(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    if parts[0].refracts:
        fields.error("material", "a material that refracts cannot have holes")
    opacity = textures.value(fields, "opacity", 0.5, 0.0, 1.0)
    made = _composite_of("mask", parts, textures={"opacity": opacity})
    branches = made.branches if TRANSMIT in made.branches else (*made.branches, TRANSMIT)
    return replace(made, branches=branches, holes=made.holes or opacity.range()[0] < 1)


def _rough(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    if parts[0].holes:
        fields.error("material", "must not have holes, which would be blurred, too")
    if max(parts[0].spread, parts[0].through) > 1:
        fields.error("material", "must not spread its rays already")
    numbers, rays = _lobe(fields, 4)
    made = _composite_of("rough", parts, numbers=numbers)
    spread, through = (rays if letter in made.branches else 1 for letter in (REFLECT, TRANSMIT))
    return replace(made, spread=spread, through=through, refracts=made.refracts or through > 1)


def _mix(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    if all(TRANSMIT in part.branches for part in parts) and any(part.refracts for part in parts):
        fields.error("b", "both materials transmit rays, and at least one of them refracts")
    if all(REFLECT in part.branches for part in parts) and any(part.normal_mapped for part in parts):
        fields.error("b", "both materials reflect, and at least one of them replaces the normal")
    if all(REFLECT in part.branches for part in parts) and any(part.spread > 1 for part in parts):
        fields.error("b", "both materials reflect, and at least one of them is glossy")
    return _composite_of("mix", parts, textures={"weight": textures.value(fields, "weight", 0.5, 0.0, 1.0)})


def _two_sided(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    return _composite_of("two_sided", parts)


def tangent_of(fields: Fields) -> Tuple[Vector, bool]:
    """A unit vector, and whether the tangent goes around it."""
    around = fields.has("axis")
    if around and fields.has("tangent"):
        fields.error("axis", "cannot be given together with `tangent`")
        fields.take("tangent")
    direction = fields.vector("axis", REQUIRED) if around else fields.vector("tangent", (1.0, 0.0, 0.0))
    length = math.sqrt(sum(component**2 for component in direction))
    if not length > 0:
        fields.error("axis" if around else "tangent", "must have a direction (its length is zero)")
        length = 1.0
    return tuple(component / length for component in direction), around


def _normal_map(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    map_ = textures.value(fields, "map", REQUIRED, 0.0, math.inf)
    strength = fields.number("strength", 1.0)
    made = _composite_of("normal_map", parts, textures={"map": map_}, numbers={"strength": strength})
    if fields.take("tangent") == "mesh":
        if fields.has("axis"):
            fields.error("axis", "cannot be given together with `tangent`")
            fields.take("axis")
        return replace(made, normal_mapped=True, mesh_tangent=True)
    direction, around = tangent_of(fields)
    return replace(made, normal_mapped=True, direction=direction, around=around)


def _bump_vectors(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    vectors = textures.value(fields, "vector_map", REQUIRED, 0.0, math.inf)
    scale = fields.number("scale", 1.0)
    made = _composite_of("bump", parts, textures={"vectors": vectors}, numbers={"scale": scale})
    if fields.choice("space", "world", ("world", "tangent")) == "world":
        return replace(made, normal_mapped=True)
    if fields.take("tangent") == "mesh":
        textures.unsupported.append(f'{fields.where}.tangent: no twin for `tangent = "mesh"` of bump')
        return replace(made, normal_mapped=True)
    direction, around = tangent_of(fields)
    return replace(made, normal_mapped=True, direction=direction, around=around, tangent=True)


def _bump(fields: Fields, textures: Textures, parts: List[Material]) -> Material:
    if fields.has("vector_map"):
        return _bump_vectors(fields, textures, parts)
    height = textures.value(fields, "height", REQUIRED, 0.0, math.inf)
    if any(leaf.mapping.uv_set == 1 for leaf in leaves(height) if hasattr(leaf, "mapping")):
        fields.error("height", "must not be mapped by the second texture coordinates")
    scale = fields.number("scale", 1.0)
    step = fields.number("step", 1e-3, lambda value: value > 0, "a number > 0")
    made = _composite_of("bump", parts, textures={"height": height}, numbers={"scale": scale, "step": step})
    return replace(made, normal_mapped=True)


# Composite materials: reader, the keys of their parts, and whether these are optional.
COMPOSITES: Dict[str, Tuple[Any, Tuple[str, ...], bool]] = {
    "emissive": (_emissive, ("material",), True),
    "reflection_map": (_reflection_map, ("material",), False),
    "mask": (_mask, ("material",), False),
    "rough": (_rough, ("material",), False),
    "mix": (_mix, ("a", "b"), False),
    "two_sided": (_two_sided, ("front", "back"), False),
    "normal_map": (_normal_map, ("material",), False),
    "bump": (_bump, ("material",), False),
}

READERS = {
    "conductor": _conductor,
    "thin_dielectric": _thin_dielectric,
    "matte": _matte,
    "phong": lambda fields, textures: _phong(fields, textures, "phong"),
    "blinn_phong": lambda fields, textures: _phong(fields, textures, "blinn_phong"),
    "whitted": _whitted,
    "mirror": _mirror,
    "glossy": _glossy,
    "plastic": _plastic,
    "dielectric": _dielectric,
    "tabulated": _tabulated,
}


class Materials:
    """Reads materials. Equal ones are merged, so that the driver shades them together."""

    def __init__(self, shared: Dict[str, Any], textures: Textures, errors: List[str], unsupported: List[str]) -> None:
        self._textures = textures
        self._errors = errors
        self._unsupported = unsupported
        self._numbers: Dict[str, int] = {}
        self.all: List[Material] = []
        self._tables = shared
        # Names of shared materials that are being read; a repeated name is a cycle.
        self._open: List[str] = []
        self._read: Set[str] = set()

    def check_unused(self) -> None:
        """Checks the type of each shared material that nothing has read (§2)."""
        for name, table in self._tables.items():
            if name not in self._read:
                Fields(table, f"material.{name}", self._errors).kind()

    def number(self, value: Any, where: str) -> int:
        """The index of the material that `value` (a name, a table or None) describes."""
        if value is None:
            return self._table({"type": "matte"}, where)
        if not isinstance(value, str):
            return self._table(value, where)
        if value not in self._tables:
            self._errors.append(f"{where}: no material is called {value!r}; {nearest(value, list(self._tables))}")
            return 0
        if value in self._open:
            self._errors.append(f"{where}: the material {value!r} contains itself")
            return 0
        self._read.add(value)
        self._open.append(value)
        number = self._table(self._tables[value], f"material.{value}")
        self._open.pop()
        return number

    def _table(self, table: Any, where: str) -> int:
        key = json.dumps(table, sort_keys=True, default=str)
        if key in self._numbers:
            return self._numbers[key]
        fields = Fields(table, where, self._errors)
        kind = fields.kind()
        reader = READERS.get(kind or "")
        if kind in COMPOSITES:
            material = self._composite(fields, kind)
        elif reader is None:
            if kind is not None:
                known = [*READERS, *COMPOSITES]
                self._unsupported.append(f"{where}: no twin for a material of type {kind!r}; {there_are(known)}")
            return 0
        else:
            material = reader(fields, self._textures)
        fields.close()
        self.all.append(material)
        self._numbers[key] = len(self.all) - 1
        return self._numbers[key]

    def _composite(self, fields: Fields, kind: str) -> Material:
        reader, keys, optional = COMPOSITES[kind]
        numbers = []
        for key in keys:
            value = fields.take(key, None if optional else REQUIRED)
            if value is not None or not optional:
                numbers.append(self.number(value, f"{fields.where}.{key}"))
        known = [self.all[number] if number < len(self.all) else Material("matte") for number in numbers]
        if any(part.priority is not None for part in known):
            fields.error(None, "a material with a `priority` must belong to a shape directly, not be part of another material")
        return replace(reader(fields, self._textures, known), parts=tuple(numbers))
