//! Prioritised (nested) dielectrics: section 8 of the model.

use super::medium::Medium;
use super::read;
use std::cmp::Reverse;
use std::sync::Arc;
use whitstone_core::{Rgb, SceneErrors};
use whitstone_scene::Description;

/// The prioritised dielectrics of a scene, the highest priority first.
type Media = Arc<[Medium]>;

/// The surface of a prioritised dielectric.
pub(in super::super) struct Face {
    rank: u32,
    all: Media,
}

/// For each shape of the scene, its face if it is a prioritised dielectric.
pub(in super::super) fn faces(description: &Description<'_>) -> Result<Vec<Option<Face>>, SceneErrors> {
    let mut ranked = Vec::new();
    for (number, shape) in description.shapes.iter().enumerate() {
        if let Some((priority, medium)) = read::body(description, shape)? {
            ranked.push((Reverse(priority), number, medium));
        }
    }
    ranked.sort_by_key(|(priority, number, _)| (*priority, *number));
    let all: Media = ranked.iter().map(|(.., medium)| *medium).collect();
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
    /// The sets of dielectrics on the viewer's side and on the far side, for a ray that is inside
    /// the set `inside`.
    pub(super) fn sets(&self, outside: bool, inside: u64) -> [u64; 2] {
        let bit = 1 << self.rank;
        if outside {
            [inside & !bit, inside | bit]
        } else {
            [inside | bit, inside & !bit]
        }
    }

    /// The dominant media on both sides; `None` if they are the same.
    pub(super) fn between(&self, own: u64, other: u64) -> Option<[Medium; 2]> {
        let none = Medium {
            ior: 1.0,
            absorption: Rgb::splat(0.0),
        };
        let tops = [own, other].map(u64::trailing_zeros);
        let differ = tops[0] != tops[1];
        differ.then(|| tops.map(|top| self.all.get(top as usize).copied().unwrap_or(none)))
    }
}
