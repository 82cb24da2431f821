//! Finds the parts of a scene that are not used during rendering.

use std::sync::Arc;
use whitstone_core::{BsdfFlags, Integrator, Light, LightFlags, Material, SurfaceAttributes, Texture};
use whitstone_scene::{Description, Omitted};

/// All built textures, including pictures without a table.
#[derive(Default)]
pub(crate) struct LookedUp(Vec<Built>);

struct Built {
    /// The id of a shared texture.
    id: Option<String>,
    /// Its type.
    kind: String,
    texture: Arc<dyn Texture>,
}

impl LookedUp {
    pub(crate) fn add(&mut self, id: Option<&str>, kind: &str, texture: &Arc<dyn Texture>) {
        self.0.push(Built {
            id: id.map(str::to_owned),
            kind: kind.to_owned(),
            texture: texture.clone(),
        });
    }

    /// The textures that other objects hold, with their types. The rest were only needed during the
    /// build, such as height maps, or belong to parts that are not built.
    pub(crate) fn kept(self, omitted: &mut Vec<Omitted>) -> Vec<(String, Arc<dyn Texture>)> {
        let mut kept = Vec::new();
        for Built { id, kind, texture } in self.0 {
            if Arc::strong_count(&texture) > 1 {
                kept.push((kind, texture));
            } else if texture.constant().is_none() {
                omitted.push(Omitted {
                    what: id.map_or_else(|| format!("a texture, {kind}"), |id| format!("texture \"{id}\"")),
                    why: "not used after the scene is built".to_owned(),
                });
            }
        }
        kept
    }
}

/// Parts of the pipeline that this scene does not run.
pub(crate) fn unused_parts(
    description: &Description<'_>,
    lights: &[Arc<dyn Light>],
    materials: &[Arc<dyn Material>],
    integrator: &dyn Integrator,
) -> Vec<Omitted> {
    let any = |flags| {
        materials
            .iter()
            .any(|material| material.flags().intersects(flags))
    };
    let mut parts = Vec::new();
    let mut omit = |what: &str, why: &str| {
        parts.push(Omitted {
            what: what.to_owned(),
            why: why.to_owned(),
        });
    };
    let sampled = lights
        .iter()
        .any(|light| light.flags().contains(LightFlags::SAMPLES));
    if !any(BsdfFlags::LOCAL) {
        omit("shadow rays", "no material in use has local illumination");
    } else if !sampled {
        omit("shadow rays", "no light has a position or a direction");
    }
    if !integrator.follows_branches() {
        omit(
            "reflected and refracted rays",
            "the integrator does not follow them",
        );
    } else {
        if !any(BsdfFlags::REFLECTION) {
            omit("reflected rays", "no material in use reflects specularly");
        }
        if !any(BsdfFlags::TRANSMISSION | BsdfFlags::NULL) {
            omit("refracted rays", "no material in use transmits light");
        }
    }
    let needs = materials
        .iter()
        .fold(SurfaceAttributes::NOTHING, |needs, material| {
            needs | material.needs()
        });
    if !needs.contains(SurfaceAttributes::UV) {
        omit("texture coordinates", "no texture in use reads them");
    }
    if !needs.contains(SurfaceAttributes::FOOTPRINT) {
        omit("footprints of rays", "no texture in use is filtered");
    }
    if description.film.channels().next().is_none() {
        omit("output layers", "`aovs` and `paths` of the film are empty");
    }
    parts
}
