//! Bodies that may overlap, of section 8.

use super::read;
use std::cmp::Reverse;
use std::sync::Arc;
use whitstone_core::{Rgb, SceneErrors};
use whitstone_scene::Description;

/// What a body is made of, or what is around all bodies.
#[derive(Clone, Copy)]
pub(super) struct Substance {
    pub(super) ior: f64,
    pub(super) absorption: Rgb,
}

/// Of the bodies of a scene, those that count before others first.
type Substances = Arc<[Substance]>;

/// A body's surface.
pub(in super::super) struct Face {
    rank: u32,
    all: Substances,
}

/// The faces of the shapes of a scene that are bodies.
pub(in super::super) fn faces(description: &Description<'_>) -> Result<Vec<Option<Face>>, SceneErrors> {
    let mut ranked = Vec::new();
    for (number, shape) in description.shapes.iter().enumerate() {
        if let Some((priority, substance)) = read::body(description, shape)? {
            ranked.push((Reverse(priority), number, substance));
        }
    }
    ranked.sort_by_key(|(priority, number, _)| (*priority, *number));
    let all: Substances = ranked.iter().map(|(.., substance)| *substance).collect();
    let mut faces: Vec<_> = description.shapes.iter().map(|_| None).collect();
    for (rank, (_, number, _)) in (0..).zip(ranked) {
        faces[number] = Some(Face {
            rank,
            all: all.clone(),
        });
    }
    Ok(faces)
}

impl Face {
    /// The bodies on the viewer's side and those on the other one, for a ray that is in some.
    pub(super) fn sets(&self, outside: bool, inside: u64) -> [u64; 2] {
        let bit = 1 << self.rank;
        if outside {
            [inside & !bit, inside | bit]
        } else {
            [inside | bit, inside & !bit]
        }
    }

    /// What is on each side; `None` if that is the same.
    pub(super) fn between(&self, own: u64, other: u64) -> Option<[Substance; 2]> {
        let none = Substance {
            ior: 1.0,
            absorption: Rgb::splat(0.0),
        };
        let tops = [own, other].map(u64::trailing_zeros);
        let differ = tops[0] != tops[1];
        differ.then(|| tops.map(|top| self.all.get(top as usize).copied().unwrap_or(none)))
    }
}
