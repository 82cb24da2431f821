"""Materials: matte, phong, blinn_phong, whitted, mirror, dielectric (model §8).

Matte, mirror and dielectric are Mitsuba's own BSDFs. The phong family and the constant k_refl / k_refr of the lectures are one
Python BSDF, `PhongFamily`: hosted by Mitsuba's geometry and frames, but its formulas are ours. Ambient terms have no twin in
Mitsuba at all and are computed by the driver from the reflectance texture.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Tuple

from .fields import Fields, Vector, nearest
from .runtime import dr, mi
from .textures import Constant, Textures

REFLECT, TRANSMIT = "R", "T"
BLACK: Vector = (0.0, 0.0, 0.0)


class PhongFamily(mi.BSDF):
    """k_d [n.l]+ + k_s lobe^exponent, and delta branches of constant weight; `eval` includes the cosine where the model has it.

    Works in the local frame of the shading normal; Mitsuba's `wi` is the model's v, `wo` its l. Both sides show.
    """

    def __init__(self, props: "mi.Properties") -> None:
        mi.BSDF.__init__(self, props)
        self.k_d, self.k_s = props["k_d"], props["k_s"]
        self.k_refl, self.k_refr = props["k_refl"], props["k_refr"]
        self.blinn = props["blinn"]
        # Opaque: the values must not become constants of the kernel, or every scene would compile its own.
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
        highlight = dr.select(lobe > 0, dr.power(dr.maximum(lobe, 0), self.exponent), 0)
        value = self.k_d.eval(si, active) * dr.maximum(cosine, 0) + self.k_s.eval(si, active) * highlight
        return dr.select(active & (cosine > 0), value, 0)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return mi.Float(0)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval(ctx, si, wo, active), mi.Float(0)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        """One delta branch, the one that `ctx.type_mask` asks for, with its whole weight (probability 1)."""
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
    """A material as read: its twin is made by `build`."""

    type: str
    # The texture that is multiplied with the ambient light; None where there is no ambient term.
    ambient: Optional[Any] = None
    # Which delta branches it can have, in the model's order.
    branches: Tuple[str, ...] = ()
    smooth: bool = False
    # Absorption coefficients, per metre: of the medium inside and of the one outside.
    interior: Vector = BLACK
    exterior: Vector = BLACK
    textures: Dict[str, Any] = field(default_factory=dict)
    numbers: Dict[str, float] = field(default_factory=dict)

    def hosted(self) -> Optional[Tuple[str, str]]:
        """(plugin type, reason) where the twin is not Mitsuba's own."""
        if self.type in ("phong", "blinn_phong", "whitted"):
            return self.type, "its reflection formula is a Python BSDF; Mitsuba has none like it"
        return None

    def build(self) -> "mi.BSDF":
        built = {name: texture.build() for name, texture in self.textures.items()}
        if self.type == "matte":
            return mi.load_dict({"type": "twosided", "inner": {"type": "diffuse", "reflectance": built["reflectance"]}})
        if self.type == "mirror":
            inner = {"type": "conductor", "material": "none", "specular_reflectance": built["reflectance"]}
            return mi.load_dict({"type": "twosided", "inner": inner})
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


def _lit(texture: Any) -> bool:
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


def _media(fields: Fields) -> Tuple[Dict[str, float], Vector, Vector]:
    ior = {
        key: fields.number(key, default, lambda value: value > 0, "an index of refraction > 0")
        for key, default in (("interior_ior", 1.5), ("exterior_ior", 1.0))
    }
    return ior, fields.color("absorption", 0.0), fields.color("exterior_absorption", 0.0)


def _whitted(fields: Fields, textures: Textures) -> Material:
    lobes = _phong(fields, textures, "whitted", 0.0)
    k_refl = textures.value(fields, "k_refl", 0.0, 0.0, math.inf)
    k_refr = textures.value(fields, "k_refr", 0.0, 0.0, math.inf)
    ior, interior, exterior = _media(fields)
    branches = (REFLECT,) * (_lit(k_refl) or _lit(k_refr)) + (TRANSMIT,) * _lit(k_refr)
    return Material(
        "whitted",
        lobes.ambient,
        branches,
        True,
        interior,
        exterior,
        {**lobes.textures, "k_refl": k_refl, "k_refr": k_refr},
        {**lobes.numbers, **ior},
    )


def _mirror(fields: Fields, textures: Textures) -> Material:
    return Material("mirror", None, (REFLECT,), textures={"reflectance": textures.value(fields, "reflectance", 1.0, 0.0, 1.0)})


def _dielectric(fields: Fields, textures: Textures) -> Material:
    ior, interior, exterior = _media(fields)
    return Material("dielectric", None, (REFLECT, TRANSMIT), False, interior, exterior, {}, ior)


READERS = {
    "matte": _matte,
    "phong": lambda fields, textures: _phong(fields, textures, "phong"),
    "blinn_phong": lambda fields, textures: _phong(fields, textures, "blinn_phong"),
    "whitted": _whitted,
    "mirror": _mirror,
    "dielectric": _dielectric,
}


class Materials:
    """Reads materials; equal ones become one, so that the driver shades them together."""

    def __init__(self, shared: Dict[str, Any], textures: Textures, errors: List[str], unsupported: List[str]) -> None:
        self._textures = textures
        self._errors = errors
        self._unsupported = unsupported
        self._numbers: Dict[str, int] = {}
        self.all: List[Material] = []
        self._shared = {name: self._table(table, f"material.{name}") for name, table in shared.items()}

    def number(self, value: Any, where: str) -> int:
        """The index of the material that `value` (a name, a table or None) describes."""
        if value is None:
            return self._table({"type": "matte"}, where)
        if isinstance(value, str):
            if value not in self._shared:
                self._errors.append(f"{where}: no material is called {value!r}; {nearest(value, list(self._shared))}")
                return 0
            return self._shared[value]
        return self._table(value, where)

    def _table(self, table: Any, where: str) -> int:
        key = json.dumps(table, sort_keys=True, default=str)
        if key in self._numbers:
            return self._numbers[key]
        fields = Fields(table, where, self._errors)
        kind = fields.kind()
        reader = READERS.get(kind or "")
        if reader is None:
            if kind is not None:
                self._unsupported.append(f"{where}: no twin for a material of type {kind!r}; {nearest(kind, list(READERS))}")
            return 0
        material = reader(fields, self._textures)
        fields.close()
        self.all.append(material)
        self._numbers[key] = len(self.all) - 1
        return self._numbers[key]
