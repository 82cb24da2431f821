//! Blends and holes of imported materials.
//!
//! A material of Whitstone continues at most one reflected and one transmitted ray, so that some
//! materials cannot be blended and some cannot have holes; `mix` and `mask` refuse them. An import
//! takes what is nearest to them instead.

use crate::document::typed;
use crate::table::as_color;
use std::collections::HashMap;
use toml::{Table, Value};

/// Which rays a material continues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Rays {
    reflects: bool,
    /// Its reflections are spread.
    glossy: bool,
    /// Its normals are those of a map.
    normal_mapped: bool,
    /// Rays pass, straight or refracted.
    transmits: bool,
    refracts: bool,
}

impl Rays {
    /// Those of a material: a table, or the id of one of `known`.
    fn of(material: &Value, known: &HashMap<String, Rays>) -> Self {
        match material {
            Value::String(id) => known.get(id).copied().unwrap_or_default(),
            Value::Table(table) => Self::of_table(table, known),
            _ => Self::default(),
        }
    }

    /// Those of a material's table.
    pub(crate) fn of_table(table: &Table, known: &HashMap<String, Rays>) -> Self {
        let kind = table.get("type").and_then(Value::as_str).unwrap_or_default();
        let parts = ["a", "b", "front", "back", "material"];
        let inner = parts.iter().filter_map(|key| table.get(*key));
        let inner = inner.fold(Self::default(), |rays, part| rays.or(Self::of(part, known)));
        inner.or(Self {
            reflects: [
                "mirror",
                "conductor",
                "plastic",
                "glossy",
                "dielectric",
                "thin_dielectric",
            ]
            .contains(&kind),
            glossy: kind == "glossy",
            normal_mapped: ["bump", "normal_map"].contains(&kind),
            transmits: ["dielectric", "thin_dielectric", "mask"].contains(&kind),
            refracts: kind == "dielectric",
        })
    }

    fn or(self, other: Self) -> Self {
        Self {
            reflects: self.reflects || other.reflects,
            glossy: self.glossy || other.glossy,
            normal_mapped: self.normal_mapped || other.normal_mapped,
            transmits: self.transmits || other.transmits,
            refracts: self.refracts || other.refracts,
        }
    }

    /// Whether the two can be blended.
    fn blends_with(self, other: Self) -> bool {
        let either = self.or(other);
        let two_pass = self.transmits && other.transmits && either.refracts;
        let two_reflect = self.reflects && other.reflects && (either.glossy || either.normal_mapped);
        !two_pass && !two_reflect
    }
}

/// The material that replaces a requested one.
pub(crate) enum Nearest {
    /// That material.
    Exact(Table),
    /// A part of it.
    Part(Value),
}

/// A blend with the share `weight` of `b`, or the larger part where the two cannot be blended.
pub(crate) fn mix(a: Value, b: Value, weight: Value, known: &HashMap<String, Rays>) -> Nearest {
    if Rays::of(&a, known).blends_with(Rays::of(&b, known)) {
        return Nearest::Exact(typed("mix", [("a", a), ("b", b), ("weight", weight)]));
    }
    Nearest::Part(if share(&weight) > 0.5 { b } else { a })
}

/// A material with holes. One that refracts has none, unless most of it is a hole.
pub(crate) fn mask(material: Value, opacity: Value, known: &HashMap<String, Rays>) -> Nearest {
    let refracts = Rays::of(&material, known).refracts;
    if refracts && share(&opacity) >= 0.5 {
        return Nearest::Part(material);
    }
    if refracts {
        return Nearest::Part(Value::Table(open()));
    }
    Nearest::Exact(typed("mask", [("material", material), ("opacity", opacity)]))
}

/// The material of a surface that is not there.
pub(crate) fn open() -> Table {
    let black = Value::Table(typed("matte", [("reflectance", Value::Float(0.0))]));
    typed("mask", [("material", black), ("opacity", Value::Float(0.0))])
}

/// A weight: the mean of a colour, half of a texture.
fn share(weight: &Value) -> f64 {
    as_color(weight).map_or(0.5, |rgb| rgb.iter().sum::<f64>() / 3.0)
}
