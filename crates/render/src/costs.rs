//! The costs of the parts of a pipeline: memory and expected work.

use crate::Pipeline;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::mem::size_of_val;
use std::sync::Arc;
use whitstone_core::{Accelerator, BsdfFlags, DVec3, Geometry, Light, LoweredShape, TextureBytes};

/// The cost of a part in use.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cost {
    /// The part.
    pub part: String,
    /// Memory while it renders, in bytes; absent if plugins do not report it.
    pub bytes: Option<u64>,
    /// How often it is queried, as far as that is known in advance.
    pub work: String,
}

impl Pipeline {
    /// The costs of all parts that the scene uses.
    pub fn costs(&self) -> Vec<Cost> {
        let mut costs = vec![self.film_cost()];
        let meshes = self.mesh_bytes();
        if meshes > 0 {
            costs.push(cost(
                "meshes",
                Some(meshes),
                "read by the accelerator and at hits".to_owned(),
            ));
        }
        let own = (&*self.scene.geometry, &*self.scene.accelerator);
        costs.push(structure("accelerator", &self.accelerator.0, own));
        for built in &self.groups {
            let own = (&**built.group.geometry(), built.group.accelerator());
            costs.push(structure(
                &format!("group \"{}\"", built.id),
                &built.accelerator.0,
                own,
            ));
        }
        if !self.later.is_empty() {
            let once: Option<u64> = costs[1..].iter().map(|part| part.bytes).sum();
            costs.push(cost(
                "other times of the film",
                once.map(|bytes| bytes * self.later.len() as u64),
                format!("the same structures at {} more times", self.later.len()),
            ));
        }
        let shapes = self.scene.materials.len();
        let having = |flags: BsdfFlags| {
            let materials = self.scene.materials.iter();
            materials
                .filter(|material| material.flags().intersects(flags))
                .count()
        };
        let lit = having(BsdfFlags::LOCAL);
        if lit > 0 && !self.scene.lights.is_empty() {
            let rays = self.light_samples();
            let work = format!(
                "about {rays} at each hit of {lit} of {shapes} shapes, where the surface faces the light"
            );
            costs.push(cost("shadow rays", Some(0), work));
        }
        let branching = having(BsdfFlags::SPECULAR);
        if branching > 0 && self.integrator.follows_branches() {
            let both = having(BsdfFlags::REFLECTION).min(having(BsdfFlags::TRANSMISSION | BsdfFlags::NULL));
            let most = if both > 0 { 2 } else { 1 };
            let work = format!(
                "up to {most} at each hit of {branching} of {shapes} shapes, down to the depth limit"
            );
            costs.push(cost("reflected and refracted rays", Some(0), work));
        }
        if !self.textures.is_empty() {
            let kinds: BTreeSet<&str> = self.textures.iter().map(|(kind, _)| kind.as_str()).collect();
            let kinds: Vec<&str> = kinds.into_iter().collect();
            let work = format!(
                "{}: looked up at hits, and by lights that use them",
                kinds.join(", ")
            );
            let reported = self.textures.iter().map(|(_, texture)| texture.bytes());
            let reported: Option<Vec<TextureBytes>> = reported.collect();
            let sum = |of: fn(&TextureBytes) -> u64| reported.as_ref().map(|reported| total(reported, of));
            costs.push(cost("textures", sum(|bytes| bytes.texels), work));
            let levels: Option<u64> = sum(|bytes| bytes.levels);
            if self.scene.reads_footprints() {
                let work = "coarser levels of textures, read by filters".to_owned();
                costs.push(cost("texture levels", levels, work));
                let work =
                    "ray differentials, computed at each hit of a filtered texture and for each specular ray";
                costs.push(cost("footprints of rays", Some(0), work.to_owned()));
            }
        }
        costs
    }

    fn film_cost(&self) -> Cost {
        let size = self.film.size;
        let pixels = u64::from(size.width) * u64::from(size.height);
        let samples = u64::from(self.samples());
        let work = format!("{} camera rays, {samples} per pixel", pixels * samples);
        cost("film", Some(self.film.bytes()), work)
    }

    /// The memory of all triangle meshes; meshes of groups count once.
    fn mesh_bytes(&self) -> u64 {
        let groups = self.groups.iter().map(|built| &**built.group.geometry());
        let all = std::iter::once(&*self.scene.geometry).chain(groups);
        let bytes = |shape: &LoweredShape| match shape {
            LoweredShape::Triangles(mesh) => {
                size_of_val(&*mesh.positions)
                    + size_of_val(&*mesh.normals)
                    + size_of_val(&*mesh.uvs)
                    + size_of_val(&*mesh.triangles)
            }
            _ => 0,
        };
        all.flat_map(|geometry| geometry.shapes().iter().map(bytes))
            .sum::<usize>() as u64
    }

    /// The number of light samples of all lights, at the middle of the scene.
    fn light_samples(&self) -> usize {
        let geometry = &self.scene.geometry;
        let bounds = geometry.elements().map(|element| geometry.bounds(element));
        let bounds = bounds.filter(|bounds| bounds.is_finite());
        let whole = bounds.reduce(|a, b| a.union(b));
        let middle = whole.map_or(DVec3::ZERO, |whole| whole.center());
        let mut samples = Vec::new();
        let lights: &[Arc<dyn Light>] = &self.scene.lights;
        lights
            .iter()
            .for_each(|light| light.samples(middle, &mut samples));
        samples.len()
    }
}

/// The sum of a part of the memory of textures. Data that several of them share counts once.
fn total(reported: &[TextureBytes], of: fn(&TextureBytes) -> u64) -> u64 {
    let mut shared: BTreeMap<usize, u64> = BTreeMap::new();
    let mut own = 0;
    for bytes in reported {
        match bytes.shared {
            None => own += of(bytes),
            Some(data) => {
                let most = shared.entry(data).or_default();
                *most = of(bytes).max(*most);
            }
        }
    }
    own + shared.into_values().sum::<u64>()
}

fn cost(part: &str, bytes: Option<u64>, work: String) -> Cost {
    Cost {
        part: part.to_owned(),
        bytes,
        work,
    }
}

/// The cost of an accelerator over some geometry.
fn structure(part: &str, kind: &str, (geometry, accelerator): (&Geometry, &dyn Accelerator)) -> Cost {
    let statistics = accelerator.statistics();
    let elements = geometry.elements().count();
    let work = match statistics.get("sah_cost") {
        Some(tests) => {
            format!(
                "{kind}: about {tests:.1} tests for a ray through the whole structure, of {elements} elements"
            )
        }
        None if kind == "brute_force" => format!("{kind}: {elements} tests per ray"),
        None => format!("{kind}: over {elements} elements"),
    };
    let bytes = statistics.get("bytes").map_or(0, |bytes| *bytes as u64);
    cost(part, Some(bytes), work)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_data_of_textures_counts_once() {
        let bytes = |texels, levels, shared| TextureBytes {
            texels,
            levels,
            shared,
        };
        let reported = [
            bytes(10, 0, Some(1)),
            bytes(5, 1, None),
            bytes(10, 4, Some(1)),
            bytes(5, 1, None),
            bytes(7, 0, Some(2)),
        ];
        assert_eq!(total(&reported, |bytes| bytes.texels), 27);
        assert_eq!(total(&reported, |bytes| bytes.levels), 6);
    }
}
