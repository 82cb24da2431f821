//! Laws of materials.

mod agree;

pub use agree::materials_agree;

use crate::spread::{COSINES, at_cosine, directions};
use crate::streams::material_streams;
use crate::textures::is_colour;
use whitstone_core::{
    BsdfFlags, DVec2, DVec3, IncidentLight, LightSamples, Material, Rgb, SpecularRay, SpecularRayKind,
    SpecularRays, SurfaceAttributes, SurfaceInteraction,
};

fn specular_rays(material: &dyn Material, point: &SurfaceInteraction, view: DVec3) -> Vec<SpecularRay> {
    let mut out = SpecularRays::default();
    material.specular_rays(point, view, &mut out);
    out.iter().copied().collect()
}

fn local_illumination(
    material: &dyn Material,
    point: &SurfaceInteraction,
    view: DVec3,
    ambient: f64,
    lights: &[IncidentLight],
) -> Rgb {
    material.local_illumination(
        point,
        view,
        &LightSamples {
            ambient: Rgb::splat(ambient),
            lights,
        },
    )
}

/// A point with a geometric and a shading normal after rule S, as integrators pass it.
fn surface(n_g: DVec3, n_s: DVec3, uv: DVec2, view: DVec3) -> SurfaceInteraction {
    let mut point = SurfaceInteraction::new(DVec3::new(0.1, -2.0, 0.7), 0.0, n_g);
    point.n_s = n_s;
    point.uv = uv;
    point.seen_from(view)
}

/// Checks the laws of materials:
///
/// - There is no response that the flags do not declare.
/// - They are finite and not negative, from normal to grazing incidence, on both sides, with and
///   without shading normals, and proportional to the light.
/// - The material reads only the attributes that it declares.
/// - Specular rays have unit directions on their side of the surface.
/// - Streams give the same bits.
///
/// # Panics
///
/// If the material breaks one of these laws; the message says which and where.
pub fn material_laws(material: &dyn Material) {
    sided_material_laws(material);
    for n in directions(24) {
        for (index, cosine) in COSINES.into_iter().enumerate() {
            both_sides(material, n, at_cosine(n, cosine, index as f64).normalize());
        }
    }
}

/// [`material_laws`], except that the two sides of the surface may respond differently.
///
/// # Panics
///
/// If the material breaks one of these laws; the message says which and where.
pub fn sided_material_laws(material: &dyn Material) {
    let uvs = [
        DVec2::ZERO,
        DVec2::new(0.3, 0.8),
        DVec2::new(-7.2, 1e9),
        DVec2::splat(f64::NAN),
    ];
    let mut points = Vec::new();
    for n in directions(24) {
        for (index, cosine) in COSINES.into_iter().enumerate() {
            let view = at_cosine(n, cosine, index as f64).normalize();
            let tilted = at_cosine(n, 0.9, 2.0);
            for (n_g, n_s) in [(n, n), (-n, -n), (n, tilted), (-n, tilted)] {
                for uv in uvs {
                    let point = surface(n_g, n_s, uv, view);
                    points.push((point, view));
                    // Rounding may put a viewer at a cosine of 1e-17 on either side.
                    let plain = n_g == n_s && cosine > 1e-15;
                    specular_ray_laws(material, &point, view, plain);
                    local_laws(material, &point, view);
                }
                need_laws(material, n_g, n_s, view);
            }
        }
    }
    let broken = material_streams(material, &points).err();
    assert_eq!(
        broken, None,
        "streams must give the same response as single calls"
    );
}

fn specular_ray_laws(material: &dyn Material, point: &SurfaceInteraction, view: DVec3, plain: bool) {
    let flags = material.flags();
    let found = specular_rays(material, point, view);
    let place = format!("n_g {} n_s {} view {view}: {found:?}", point.n_g, point.n_s);
    for SpecularRay {
        direction,
        weight,
        kind,
    } in &found
    {
        assert!(
            is_colour(*weight),
            "weights must be finite and not negative: {place}"
        );
        let length = direction.length();
        assert!(
            (length - 1.0).abs() < 1e-14,
            "specular rays must have unit directions, found length {length}: {place}"
        );
        let flag = match kind {
            SpecularRayKind::Reflection => BsdfFlags::REFLECTION,
            SpecularRayKind::Transmission { absorption } => {
                assert!(
                    is_colour(*absorption),
                    "absorption must be finite and not negative: {place}"
                );
                BsdfFlags::TRANSMISSION
            }
            SpecularRayKind::Null => {
                assert_eq!(
                    *direction, -view,
                    "a null transmission must not change direction: {place}"
                );
                BsdfFlags::NULL
            }
        };
        assert!(
            weight.is_black() || flags.contains(flag),
            "the flags must declare every kind of specular ray: {place}"
        );
        // A reflection by the material's own normal may go into the surface; rule G handles that.
        let straight_on = *kind == SpecularRayKind::Null;
        if plain && (straight_on || !flags.contains(BsdfFlags::NORMAL_MAPPED)) {
            let right = match kind {
                SpecularRayKind::Reflection => point.same_side(view, *direction),
                _ => point.opposite_sides(view, *direction),
            };
            assert!(
                right,
                "reflection must stay on the viewer's side and transmission must leave it: {place}"
            );
        }
    }
    assert_eq!(
        specular_rays(material, point, view),
        found,
        "specular rays must be deterministic"
    );
    for branch in &found {
        let Some(lobe) = material.glossy_lobe(point, view, branch.kind) else {
            continue;
        };
        let all: Vec<DVec3> = lobe.directions(branch.direction).collect();
        let (what, most) = match branch.kind {
            SpecularRayKind::Reflection => ("reflection", material.reflections() as usize),
            _ => ("transmission", material.transmissions() as usize),
        };
        assert!(
            most > 1 && !all.is_empty() && all.len() <= most,
            "a material with a lobe must declare its number of {what} rays, found {most}: {place}"
        );
        let reflects = branch.kind == SpecularRayKind::Reflection;
        assert!(
            !plain || (lobe.n.dot(view) >= 0.0) == reflects,
            "the normal of a lobe must be on the side that the ray goes to, found {}: {place}",
            lobe.n
        );
        for direction in all {
            let length = direction.length();
            assert!(
                (length - 1.0).abs() < 1e-14,
                "specular rays must have unit directions, found length {length}: {place}"
            );
        }
    }
}

fn local_laws(material: &dyn Material, point: &SurfaceInteraction, view: DVec3) {
    let n = point.n_towards(view);
    let incoming = |cosine, angle, irradiance| IncidentLight {
        direction: at_cosine(n, cosine, angle).normalize(),
        irradiance: Rgb::splat(irradiance),
    };
    let lights: Vec<IncidentLight> = COSINES
        .into_iter()
        .enumerate()
        .map(|(i, cosine)| incoming(cosine, 0.7 * i as f64, 1.0 + i as f64))
        .collect();
    let found = local_illumination(material, point, view, 0.5, &lights);
    let place = format!("n_g {} n_s {} view {view}: {found:?}", point.n_g, point.n_s);
    assert!(
        is_colour(found),
        "local radiance must be finite and not negative: {place}"
    );
    let answers = material.flags().contains(BsdfFlags::LOCAL);
    assert!(
        answers || found.is_black(),
        "the flags must declare local illumination: {place}"
    );
    assert_eq!(
        local_illumination(material, point, view, 0.5, &lights),
        found,
        "local radiance must be deterministic"
    );
    let emission = material.emission(point, view);
    assert!(
        is_colour(emission),
        "emission must be finite and not negative: {place}"
    );
    let glows = material.flags().contains(BsdfFlags::EMISSION);
    assert!(
        glows || emission.is_black(),
        "the flags must declare emission: {place}"
    );
    let dark = local_illumination(material, point, view, 0.0, &[]);
    assert!(
        dark.is_black(),
        "local radiance without light must be black, found {dark:?}: {place}"
    );
    // Exact, since 4 is a power of two.
    let brighter: Vec<IncidentLight> = lights
        .iter()
        .map(|light| IncidentLight {
            irradiance: light.irradiance * 4.0,
            ..*light
        })
        .collect();
    assert_eq!(
        local_illumination(material, point, view, 2.0, &brighter),
        found * 4.0,
        "local radiance must be proportional to the light"
    );
    for filtered in [false, true] {
        let filter = material.shadow_transmittance(point, -view, filtered);
        let (weight, medium) = (filter.weight, filter.medium.unwrap_or(Rgb::BLACK));
        assert!(
            is_colour(weight) && is_colour(medium),
            "transmittance must be finite and not negative, found {filter:?}: {place}"
        );
        let passing = if filtered {
            BsdfFlags::CUT_OUTS | BsdfFlags::TRANSPARENT_SHADOWS
        } else {
            BsdfFlags::CUT_OUTS
        };
        assert!(
            weight.is_black() || material.flags().intersects(passing),
            "the flags must declare the transmittance of shadow rays: {place}"
        );
    }
    if material.flags().contains(BsdfFlags::NORMAL_MAPPED) {
        return;
    }
    let behind = incoming(-0.5, 1.0, 1.0);
    let lit = local_illumination(material, point, view, 0.0, &[behind]);
    assert!(
        lit.is_black(),
        "light from behind the shading normal must contribute nothing, found {lit:?}: {place}"
    );
}

fn need_laws(material: &dyn Material, n_g: DVec3, n_s: DVec3, view: DVec3) {
    let needs = material.needs();
    let lights = [IncidentLight {
        direction: at_cosine(n_g, 0.8, 1.0),
        irradiance: Rgb::WHITE,
    }];
    let answer = |n_s: DVec3, uv: DVec2| {
        let point = surface(n_g, n_s, uv, view);
        (
            local_illumination(material, &point, view, 1.0, &lights),
            specular_rays(material, &point, view),
        )
    };
    let first = answer(n_s, DVec2::ZERO);
    if !needs.contains(SurfaceAttributes::UV) {
        let same = answer(n_s, DVec2::new(0.7, 0.2)) == first;
        assert!(
            same,
            "a material that reads (u, v) must declare that it needs them"
        );
    }
    if !needs.contains(SurfaceAttributes::SHADING_NORMAL) {
        let same = answer(n_g, DVec2::ZERO) == first;
        assert!(
            same,
            "a material that reads the shading normal must declare that it needs it"
        );
    }
}

/// Checks that local radiance does not depend on which side is outside.
fn both_sides(material: &dyn Material, n: DVec3, view: DVec3) {
    if n.dot(view) == 0.0 {
        return;
    }
    let lights = [IncidentLight {
        direction: at_cosine(n, 0.8, 1.0),
        irradiance: Rgb::WHITE,
    }];
    let from = |n_g| {
        local_illumination(
            material,
            &surface(n_g, n_g, DVec2::splat(0.3), view),
            view,
            0.3,
            &lights,
        )
    };
    assert_eq!(from(n), from(-n), "both sides must respond equally");
}

/// White furnace test: with incident radiance 1 from all directions, at most 1 leaves. For
/// materials whose parameters guarantee it (weights sum to at most 1, and transmitted radiance is
/// not scaled).
///
/// # Panics
///
/// If more leaves than arrives.
pub fn furnace_laws(material: &dyn Material) {
    for n in directions(24) {
        for (index, cosine) in COSINES.into_iter().enumerate() {
            let view = at_cosine(n, cosine, index as f64).normalize();
            for n_g in [n, -n] {
                let point = surface(n_g, n_g, DVec2::splat(0.3), view);
                let delta: Rgb = specular_rays(material, &point, view)
                    .iter()
                    .map(|branch| branch.weight)
                    .sum();
                let leaving = (local_illumination(material, &point, view, 1.0, &[]) + delta).max_component();
                assert!(
                    leaving <= 1.0 + 1e-12,
                    "at most the arriving radiance may leave, found {leaving} at a cosine of {cosine}"
                );
            }
        }
    }
}

/// Under radiance 1 from every direction above the surface, approximated by directional lights, at
/// most 1 leaves. For materials in radiometric units, with the factor 1/pi. Branches are not
/// included: see [`furnace_laws`].
///
/// # Panics
///
/// If more leaves than arrives.
pub fn energy_laws(material: &dyn Material) {
    // Each light represents an equal part of the solid angle.
    let part = std::f64::consts::TAU / f64::from(LIGHTS);
    let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    for n in directions(6) {
        let incoming = |i: u32| IncidentLight {
            direction: at_cosine(n, (f64::from(i) + 0.5) / f64::from(LIGHTS), turn * f64::from(i))
                .normalize(),
            irradiance: Rgb::splat(part),
        };
        let lights: Vec<IncidentLight> = (0..LIGHTS).map(incoming).collect();
        for (index, cosine) in COSINES.into_iter().enumerate() {
            let view = at_cosine(n, cosine, index as f64).normalize();
            let point = surface(n, n, DVec2::splat(0.3), view);
            let leaving = local_illumination(material, &point, view, 0.0, &lights).max_component();
            assert!(
                leaving <= 1.0 + 1e-3,
                "at most the arriving light may leave, found {leaving} at a cosine of {cosine}"
            );
        }
    }
}

/// Number of lights in [`energy_laws`].
const LIGHTS: u32 = 4096;

/// Helmholtz reciprocity: the fraction of a light's irradiance that leaves towards the viewer stays
/// the same if light and viewer are exchanged. For physically based materials; Phong's highlight is
/// not reciprocal.
///
/// # Panics
///
/// If the two differ.
pub fn reciprocity_laws(material: &dyn Material) {
    for n in directions(8) {
        // Cosines that are large enough to divide by.
        let cosines = COSINES.into_iter().filter(|cosine| *cosine >= 1e-3);
        let slopes: Vec<DVec3> = cosines
            .enumerate()
            .map(|(index, cosine)| at_cosine(n, cosine, 0.9 * index as f64).normalize())
            .collect();
        for a in &slopes {
            for b in &slopes {
                let share = |view: DVec3, light: DVec3| {
                    let lights = [IncidentLight {
                        direction: light,
                        irradiance: Rgb::WHITE,
                    }];
                    let point = surface(n, n, DVec2::splat(0.3), view);
                    local_illumination(material, &point, view, 0.0, &lights) * (1.0 / n.dot(light))
                };
                let (there, back) = (share(*a, *b), share(*b, *a));
                let off = there.to_array().into_iter().zip(back.to_array());
                assert!(
                    { off }.all(|(a, b)| (a - b).abs() <= 1e-9 * a.abs().max(b.abs())),
                    "the reflectance must be reciprocal, found {there:?} from {b} to {a} and {back:?} back, with normal {n}"
                );
            }
        }
    }
}

/// For a material that reflects and refracts like glass: energy is conserved (`R + T/eta² = 1`),
/// directions obey Snell's law and lie in the plane of incidence, and the reversed path has the
/// same weights.
///
/// # Panics
///
/// If the material breaks one of these laws; the message says which and where.
pub fn dielectric_laws(material: &dyn Material, interior_ior: f64, exterior_ior: f64) {
    let n = DVec3::new(2.0, -1.0, 0.5).normalize();
    for (side, n_i, n_t) in [
        (1.0, exterior_ior, interior_ior),
        (-1.0, interior_ior, exterior_ior),
    ] {
        let (point, eta) = (SurfaceInteraction::new(DVec3::ZERO, 0.0, side * n), n_i / n_t);
        for (index, cosine) in COSINES.into_iter().enumerate() {
            let view = at_cosine(n, cosine, index as f64).normalize();
            if n.dot(view) <= 0.0 {
                continue;
            }
            let found = specular_rays(material, &point, view);
            let place = format!("cosine {cosine}, indices {n_i} and {n_t}: {found:?}");
            let share = |branch: &SpecularRay| match branch.kind {
                SpecularRayKind::Reflection => branch.weight.g,
                _ => branch.weight.g / eta / eta,
            };
            let total: f64 = found.iter().map(share).sum();
            assert!(
                (total - 1.0).abs() < 1e-13,
                "energy must be conserved, found {total} at {place}"
            );
            let tangential = |d: DVec3| d - n.dot(d) * n;
            for branch in &found {
                let (along, bent) = (tangential(view), tangential(branch.direction));
                let (factor, reverse) = match branch.kind {
                    SpecularRayKind::Reflection => (1.0, None),
                    _ => (eta, Some(branch.direction)),
                };
                let off = (bent + factor * along).length() / factor.max(1.0);
                assert!(
                    off < 1e-14,
                    "directions must obey the law of refraction, off by {off} at {place}"
                );
                // At grazing incidence the direction is too imprecise to be retraced.
                let Some(reverse) = reverse.filter(|d| n.dot(*d).abs() > 1e-2 && cosine > 1e-2) else {
                    continue;
                };
                let retraced = specular_rays(material, &point, reverse);
                let back: f64 = retraced
                    .iter()
                    .filter(|branch| branch.kind != SpecularRayKind::Reflection)
                    .map(|branch| branch.weight.g * eta * eta)
                    .sum();
                let off = (back - share(branch)).abs();
                assert!(
                    off < 1e-11,
                    "the reversed path must have the same weights, off by {off} at {place}"
                );
            }
        }
    }
}

#[cfg(test)]
mod tests;
