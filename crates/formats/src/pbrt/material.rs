//! Materials.

use super::params::{Args, Values};
use super::scene::{Area, Importer, MAX_NESTING};
use super::texture::Pattern;
use super::token::At;
use crate::coat;
use crate::combine::{self, Nearest};
use crate::document::{color, typed};
use crate::mitsuba::material::{normal_reflectance, product};
use crate::spectrum;
use std::f64::consts::PI;
use toml::{Table, Value};

/// Roughness below which a surface is smooth, as alpha of the microfacet distribution.
const SMOOTH: f64 = 1e-3;

const MATERIALS: [&str; 9] = [
    "diffuse",
    "dielectric",
    "thindielectric",
    "conductor",
    "coateddiffuse",
    "coatedconductor",
    "diffusetransmission",
    "mix",
    "interface",
];

/// A material as shapes use it.
#[derive(Clone, Debug)]
pub(super) struct Look {
    /// The id of a shared material; none of an interface, which is not visible.
    pub(super) value: Option<Value>,
    /// Whether it depends on (u, v).
    pub(super) uv: bool,
    /// Depth of its nesting.
    depth: usize,
}

impl Look {
    /// A material of the scene that imports the file.
    pub(super) fn of(value: Value) -> Self {
        Self {
            value: Some(value),
            uv: true,
            depth: 0,
        }
    }

    pub(super) fn interface() -> Self {
        Self {
            value: None,
            uv: false,
            depth: 0,
        }
    }
}

/// The metal of a conductor.
enum Metal {
    Reflectance(Value),
    Named(&'static str),
    Index([f64; 3], [f64; 3]),
}

impl Importer<'_> {
    pub(super) fn material(&mut self, plugin: &str, name: Option<&str>, mut args: Args) -> Look {
        let at = args.at;
        if args.has("normalmap") {
            args.ignore(&["normalmap"]);
            self.note("normalmap of a material", at);
        }
        let height = self.named_texture(&mut args, "displacement", true);
        // A number displaces all points alike.
        args.ignore(&["displacement"]);
        let mut look = Look {
            value: None,
            uv: false,
            depth: 0,
        };
        let mut see = |(value, uv, _): Pattern| {
            look.uv |= uv;
            value
        };
        let table = match plugin {
            "diffuse" => {
                let reflectance = see(self.texture_or_color(&mut args, "reflectance", 0.5));
                typed("matte", [("reflectance", reflectance)])
            }
            "dielectric" => {
                let ior = self.ior(&mut args, "eta");
                if self.alpha(&mut args, ["roughness", "uroughness", "vroughness"]) >= SMOOTH {
                    self.note("roughness of dielectric", at);
                }
                typed("dielectric", [("interior_ior", Value::Float(ior))])
            }
            "thindielectric" => {
                let ior = self.ior(&mut args, "eta");
                typed("thin_dielectric", [("interior_ior", Value::Float(ior))])
            }
            "conductor" => {
                let metal = self.metal(&mut args, ["eta", "k"], &mut see);
                let alpha = self.alpha(&mut args, ["roughness", "uroughness", "vroughness"]);
                self.conductor(metal, alpha, at)
            }
            "coatedconductor" => {
                self.note("Material coatedconductor", at);
                args.ignore(&[
                    "interface.roughness",
                    "interface.uroughness",
                    "interface.vroughness",
                    "interface.eta",
                    "thickness",
                    "maxdepth",
                    "nsamples",
                    "g",
                    "albedo",
                ]);
                let metal = self.metal(&mut args, ["conductor.eta", "conductor.k"], &mut see);
                let names = [
                    "conductor.roughness",
                    "conductor.uroughness",
                    "conductor.vroughness",
                ];
                let alpha = self.alpha(&mut args, names);
                self.conductor(metal, alpha, at)
            }
            "coateddiffuse" => {
                self.note("Material coateddiffuse", at);
                args.ignore(&["thickness", "maxdepth", "nsamples", "g", "albedo"]);
                let reflectance = see(self.texture_or_color(&mut args, "reflectance", 0.5));
                let ior = self.ior(&mut args, "eta");
                let alpha = self.alpha(&mut args, ["roughness", "uroughness", "vroughness"]);
                coated_diffuse(reflectance, ior, alpha)
            }
            "diffusetransmission" => {
                self.note("Material diffusetransmission", at);
                args.ignore(&["transmittance"]);
                let reflectance = see(self.texture_or_color(&mut args, "reflectance", 0.25));
                let scale = self.number(&mut args, "scale", 1.0);
                typed("matte", [("reflectance", product([scale; 3], reflectance))])
            }
            "mix" => {
                let weight = see(self.texture_or_number(&mut args, "amount", 0.5));
                let parts = self.parts(&mut args);
                self.done(args);
                let Some([a, b]) = parts else {
                    return look;
                };
                look.uv |= a.uv || b.uv;
                look.depth = a.depth.max(b.depth) + 1;
                if look.depth > MAX_NESTING {
                    self.error(at, format!("materials are nested more than {MAX_NESTING} deep"));
                    return look;
                }
                // A surface that is not there is a hole.
                let nearest = match (a.value, b.value) {
                    (Some(a), Some(b)) => combine::mix(a, b, weight, &self.rays),
                    (None, Some(b)) => combine::mask(b, weight, &self.rays),
                    (Some(a), None) => {
                        let weight = match weight {
                            Value::Float(weight) => Value::Float(1.0 - weight),
                            texture => {
                                let (one, zero) = (Value::Float(1.0), Value::Float(0.0));
                                Value::Table(typed("mix", [("a", one), ("b", zero), ("weight", texture)]))
                            }
                        };
                        combine::mask(a, weight, &self.rays)
                    }
                    (None, None) => return look,
                };
                let name = name.unwrap_or("mix");
                look.value = Some(self.combined(nearest, name, "Material mix of two directions", at));
                return look;
            }
            "interface" | "none" | "" => {
                self.done(args);
                return look;
            }
            _ => {
                self.unknown_plugin("material", plugin, &MATERIALS, at);
                return look;
            }
        };
        self.done(args);
        let table = match height {
            None => table,
            Some((height, uv, _)) => {
                self.note("displacement of a material", at);
                look.uv |= uv;
                let inner = Value::Table(table);
                typed("bump", [("height", height), ("material", inner)])
            }
        };
        look.value = Some(self.share_material(name.unwrap_or(plugin), table));
        look
    }

    /// The shared material of a combination; `approximated` is noted where it is not exact.
    fn combined(&mut self, nearest: Nearest, name: &str, approximated: &'static str, at: At) -> Value {
        let table = match nearest {
            Nearest::Exact(table) => table,
            Nearest::Part(part) => {
                self.note(approximated, at);
                match part {
                    Value::Table(table) => table,
                    shared => return shared,
                }
            }
        };
        self.share_material(name, table)
    }

    /// The two materials of a mix.
    fn parts(&mut self, args: &mut Args) -> Option<[Look; 2]> {
        let param = args.take("materials");
        let names = match param.as_ref().map(|param| &param.values) {
            Some(Values::Texts(names)) if names.len() == 2 => names.clone(),
            _ => {
                self.error(args.at, "a mix needs \"string materials\" with two names");
                return None;
            }
        };
        let mut find = |name: &str| match self.named_material(name, args.at) {
            Ok(look) => Some(look),
            Err(fault) => {
                self.report(fault);
                None
            }
        };
        Some([find(&names[0])?, find(&names[1])?])
    }

    /// Roughness as alpha of the microfacet distribution: the geometric mean of both directions.
    fn alpha(&mut self, args: &mut Args, names: [&'static str; 3]) -> f64 {
        let remap = self.boolean(args, "remaproughness", true);
        let mut read = |name: &'static str, default: f64| match self.texture_or_number(args, name, default).0
        {
            Value::Float(value) => value.max(0.0),
            _ => {
                self.note("texture of roughness", args.at);
                0.1
            }
        };
        let both = read(names[0], 0.0);
        let (u, v) = (read(names[1], both), read(names[2], both));
        let alpha = |roughness: f64| if remap { roughness.sqrt() } else { roughness };
        (alpha(u) * alpha(v)).sqrt()
    }

    fn metal(
        &mut self,
        args: &mut Args,
        names: [&'static str; 2],
        see: &mut impl FnMut(Pattern) -> Value,
    ) -> Metal {
        if args.has("reflectance") {
            if names.iter().any(|name| args.has(name)) {
                self.error(
                    args.at,
                    "expected either \"reflectance\" or \"eta\" and \"k\", found both",
                );
            }
            args.ignore(&names);
            return Metal::Reflectance(see(self.texture_or_color(args, "reflectance", 1.0)));
        }
        let named = |args: &Args, name: &str| {
            let param = args.peek(name)?;
            let Values::Texts(texts) = &param.values else {
                return None;
            };
            spectrum::metal(texts.first()?)
        };
        let (eta, k) = (named(args, names[0]), named(args, names[1]));
        match (args.has(names[0]), args.has(names[1]), eta, k) {
            (false, false, _, _) => return Metal::Named("Cu"),
            (true, true, Some((a, false)), Some((b, true))) if a == b => {
                args.ignore(&names);
                return Metal::Named(a);
            }
            _ => {}
        }
        let mut read = |name: &'static str, is_k: bool| {
            if args.kind(name) == Some(super::params::Kind::Texture) {
                self.error(args.at, format!("\"{name}\" must not be a texture"));
                args.ignore(&[name]);
            }
            self.color(args, name, false)
                .unwrap_or_else(|| spectrum::metal_color("Cu", is_k))
        };
        let (eta, k) = (read(names[0], false), read(names[1], true));
        // The range of the model.
        if eta.iter().any(|eta| !(*eta > 0.0 && *eta <= 1000.0)) || k.iter().any(|k| *k > 1000.0) {
            self.error(
                args.at,
                "expected \"eta\" above 0 and at most 1000, and \"k\" at most 1000",
            );
            return Metal::Named("Cu");
        }
        Metal::Index(eta, k)
    }

    fn conductor(&mut self, metal: Metal, alpha: f64, at: At) -> Table {
        let metal = match metal {
            // pbrt takes a metal that has this reflectance at normal incidence.
            Metal::Reflectance(value) => match constant(&value) {
                Some(value) => {
                    let k = value.map(|value| {
                        let value = value.clamp(0.0, 0.9999);
                        2.0 * value.sqrt() / (1.0 - value).sqrt()
                    });
                    Metal::Index([1.0; 3], k)
                }
                None => Metal::Reflectance(value),
            },
            metal => metal,
        };
        if alpha < SMOOTH {
            return match metal {
                Metal::Reflectance(value) => {
                    self.note("texture of the reflectance of a conductor", at);
                    typed("mirror", [("reflectance", value)])
                }
                Metal::Named(name) => typed("conductor", [("metal", Value::String(name.into()))]),
                Metal::Index(eta, k) => typed("conductor", [("eta", color(eta)), ("k", color(k))]),
            };
        }
        self.note("roughness of conductor", at);
        let reflectance = match metal {
            Metal::Reflectance(value) => value,
            Metal::Named(name) => color(normal_reflectance(
                spectrum::metal_color(name, false),
                spectrum::metal_color(name, true),
            )),
            Metal::Index(eta, k) => color(normal_reflectance(eta, k)),
        };
        // The lobe is about the reflected direction, not about the normal.
        let exponent = (lobe(alpha) / 4.0).max(1.0);
        typed(
            "glossy",
            [("reflectance", reflectance), ("exponent", Value::Float(exponent))],
        )
    }

    /// The material of a shape that emits on the outside, or on both sides.
    pub(super) fn emissive(&mut self, area: &Area, radiance: [f64; 3], material: Option<Value>) -> Value {
        let material = material.unwrap_or_else(|| {
            let matte = typed("matte", [("reflectance", Value::Float(0.5))]);
            self.share_material("diffuse", matte)
        });
        let table = typed(
            "emissive",
            [("radiance", color(radiance)), ("material", material.clone())],
        );
        let table = if area.two_sided {
            table
        } else {
            typed("two_sided", [("front", Value::Table(table)), ("back", material)])
        };
        self.share_material("light", table)
    }

    /// A material with holes.
    pub(super) fn masked(&mut self, material: Option<Value>, alpha: Value, at: At) -> Value {
        let material = material.unwrap_or_else(|| {
            let matte = typed("matte", [("reflectance", Value::Float(0.5))]);
            self.share_material("diffuse", matte)
        });
        let nearest = combine::mask(material, alpha, &self.rays);
        self.combined(nearest, "mask", "alpha of a dielectric", at)
    }

    /// A material on a surface whose normal is reversed: dielectrics have their inside outside.
    pub(super) fn reversed(&mut self, value: Value) -> Value {
        let Value::String(id) = &value else {
            return value;
        };
        if let Some(known) = self.turned.get(id) {
            return known.clone();
        }
        let Some(mut table) = self.tables.get(id).cloned() else {
            return value;
        };
        let id = id.clone();
        let kind = table.get("type").and_then(Value::as_str).unwrap_or_default();
        if kind == "dielectric" {
            let inside = table.insert("interior_ior".to_owned(), Value::Float(1.0));
            table.insert("exterior_ior".to_owned(), inside.unwrap_or(Value::Float(1.5)));
        } else {
            for key in ["a", "b", "material"] {
                if let Some(part) = table.get(key).cloned() {
                    let part = self.reversed(part);
                    table.insert(key.to_owned(), part);
                }
            }
        }
        let result = if self.tables.get(&id) == Some(&table) {
            value
        } else {
            self.share_material(&format!("{id}-reversed"), table)
        };
        self.turned.insert(id, result.clone());
        result
    }
}

/// The exponent of a Blinn-Phong lobe about the normal that is as wide as the distribution.
fn lobe(alpha: f64) -> f64 {
    (2.0 / (alpha * alpha).max(1e-8) - 2.0).max(1.0)
}

/// A diffuse surface under a clear coat; the reflection of a rough one is that at normal incidence.
fn coated_diffuse(reflectance: Value, ior: f64, alpha: f64) -> Table {
    if alpha < SMOOTH {
        return coat::of_albedo(reflectance, ior, 1.0);
    }
    let reflected = ((ior - 1.0) / (ior + 1.0)).powi(2);
    let passed = 1.0 - reflected;
    let exponent = lobe(alpha);
    let peak = reflected * (exponent + 2.0) / (8.0 * PI);
    typed(
        "blinn_phong",
        [
            ("k_d", product([passed / PI; 3], reflectance.clone())),
            ("k_a", product([passed; 3], reflectance)),
            ("k_s", Value::Float(peak)),
            ("exponent", Value::Float(exponent)),
        ],
    )
}

/// The colour of a value that is the same everywhere.
fn constant(value: &Value) -> Option<[f64; 3]> {
    crate::table::as_color(value)
}
