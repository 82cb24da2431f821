//! Two materials that must respond equally.

use super::{local_illumination, specular_rays, surface};
use crate::spread::{COSINES, at_cosine, directions};
use whitstone_core::{DVec2, DVec3, GlossyLobe, IncidentLight, Material, Rgb, SpecularRay};

/// Checks that a material responds, bit for bit, as another one does: for a material around others
/// whose parameters make it have no effect.
///
/// Flags and needed attributes are not compared, nor specular rays of weight 0.
///
/// # Panics
///
/// If a response differs; the message says which and where.
pub fn materials_agree(found: &dyn Material, expected: &dyn Material) {
    let counts = |material: &dyn Material| (material.reflections(), material.transmissions());
    assert_eq!(counts(found), counts(expected), "the numbers of specular rays");
    for n in directions(6) {
        for (index, cosine) in COSINES.into_iter().enumerate() {
            let view = at_cosine(n, cosine, index as f64).normalize();
            for n_g in [n, -n] {
                let point = surface(n_g, n_g, DVec2::new(0.3, 0.8), view);
                let lights = [0.9, 0.4].map(|cosine| IncidentLight {
                    direction: at_cosine(n, cosine, 2.0).normalize(),
                    irradiance: Rgb::new(3.0, 2.0, 1.0),
                });
                let local =
                    |material: &dyn Material| local_illumination(material, &point, view, 0.5, &lights);
                let emission = |material: &dyn Material| material.emission(&point, view);
                let shadow = |material: &dyn Material| {
                    [false, true].map(|filtered| material.shadow_transmittance(&point, -view, filtered))
                };
                let rays = |material: &dyn Material| -> Vec<SpecularRay> {
                    let mut all = specular_rays(material, &point, view);
                    all.retain(|ray| !ray.weight.is_black());
                    all
                };
                let lobes = |material: &dyn Material| -> Vec<Option<(DVec3, Vec<DVec3>)>> {
                    let part = |lobe: GlossyLobe<'_>| (lobe.n, lobe.lobe.to_vec());
                    let of = |ray: &SpecularRay| material.glossy_lobe(&point, view, ray.kind).map(part);
                    rays(material).iter().map(of).collect()
                };
                let place = format!("at a cosine of {cosine}, with normal {n_g} and view {view}");
                assert_eq!(local(found), local(expected), "local illumination {place}");
                assert_eq!(emission(found), emission(expected), "emission {place}");
                assert_eq!(shadow(found), shadow(expected), "transmittance {place}");
                assert_eq!(rays(found), rays(expected), "specular rays {place}");
                assert_eq!(lobes(found), lobes(expected), "lobes {place}");
            }
        }
    }
}
