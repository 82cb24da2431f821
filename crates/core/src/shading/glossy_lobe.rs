//! Glossy reflection and blurred transmission by several rays.
//!
//! Cook, Porter and Carpenter, *Distributed ray tracing*, SIGGRAPH 1984, section 4.1: a glossy
//! reflection is traced in several directions around the mirror direction, and light through rough
//! glass in several directions around the refracted one. Here the directions are fixed, the same at
//! every point and in every renderer, so that there is no noise. The minimal rotation carries them
//! to the direction that they surround, so that they vary continuously except at one pole.
//!
//! Only scenes with glossy materials pay for it: their rays are traced one at a time.

use crate::{DVec3, PathLetter, Scene, SpecularRay, SpecularRayKind, SpecularRays, SurfaceInteraction};

/// The glossy lobe of a surface: a specular ray, split into equally weighted directions.
#[derive(Clone, Copy, Debug)]
pub struct GlossyLobe<'a> {
    /// Unit normal on the side that the ray goes to: the viewer's for a reflection, else the other
    /// one.
    pub n: DVec3,
    /// Unit vectors around +z, which represents the direction of the specular ray.
    pub lobe: &'a [DVec3],
}

/// Fixed axis that is rotated onto the normal to build a tangent frame. The frame is singular only
/// for n = -AXIS, chosen so that few visible surfaces face that way.
const AXIS: DVec3 = DVec3::new(0.48, 0.64, 0.6);

/// A unit vector perpendicular to `AXIS`.
const ACROSS: DVec3 = DVec3::new(0.8, -0.6, 0.0);

/// Applies the minimal rotation from `a` to `b` (unit vectors) to `q`, which is perpendicular to
/// `a`; for such vectors it equals a reflection. If `b` is `-a` there is no minimal rotation, and
/// `q` is returned.
fn carried(q: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let m = a + b;
    let length = m.length_squared();
    if length > 0.0 {
        q - (2.0 * q.dot(m) / length) * m
    } else {
        q
    }
}

impl GlossyLobe<'_> {
    /// The directions around that of the specular ray, in order.
    pub fn directions(&self, middle: DVec3) -> impl DoubleEndedIterator<Item = DVec3> + ExactSizeIterator {
        let x = carried(carried(ACROSS, AXIS, self.n), self.n, middle);
        // Already perpendicular, except for rounding errors near the pole.
        let x = (x - x.dot(middle) * middle).normalize();
        let y = middle.cross(x);
        self.lobe.iter().map(move |q| q.x * x + q.y * y + q.z * middle)
    }
}

impl Scene {
    /// Calls `visit` for each specular ray of a surface in reverse order. One that is spread is
    /// visited as all its rays.
    pub fn for_each_branch_rev(
        &self,
        shape: u32,
        point: &SurfaceInteraction,
        view: DVec3,
        branches: &SpecularRays,
        mut visit: impl FnMut(&SpecularRay, PathLetter),
    ) {
        for branch in branches.iter().rev() {
            if !self.has_glossy_rays {
                visit(branch, PathLetter::from(branch.kind));
                continue;
            }
            let material = &self.materials[shape as usize];
            let most = match branch.kind {
                SpecularRayKind::Reflection => material.reflections(),
                SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => material.transmissions(),
            };
            let Some(glossy_lobe) = material.glossy_lobe(point, view, branch.kind) else {
                // Not spread here, for example on this side of the surface: labelled as ray 0 of
                // several.
                visit(branch, PathLetter::among(branch.kind, most, 0));
                continue;
            };
            let all = glossy_lobe.directions(branch.direction);
            let weight = branch.weight * (1.0 / all.len() as f64);
            for (number, direction) in all.enumerate().rev() {
                let branch = SpecularRay {
                    direction,
                    weight,
                    ..*branch
                };
                visit(&branch, PathLetter::among(branch.kind, most, number as u8));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_axes_are_of_unit_length_and_perpendicular() {
        assert!((AXIS.length() - 1.0).abs() < 1e-15);
        assert!((ACROSS.length() - 1.0).abs() < 1e-15);
        assert!(AXIS.dot(ACROSS).abs() < 1e-16);
    }

    #[test]
    fn the_minimal_rotation_preserves_lengths_and_angles() {
        let a = DVec3::new(2.0, -1.0, 0.5).normalize();
        let q = a.cross(DVec3::X).normalize();
        for b in [a, DVec3::Y, DVec3::NEG_Z, -a] {
            let found = carried(q, a, b);
            assert!((found.length() - 1.0).abs() < 1e-14, "{b}");
            assert!(found.dot(b).abs() < 1e-14, "{b}");
        }
        // A vector in the plane of rotation turns like the axis; the perpendicular one is
        // unchanged.
        let b = (a + q).normalize();
        assert!((carried(q, a, b) - (q - a).normalize()).length() < 1e-15);
        let still = a.cross(q);
        assert!((carried(still, a, b) - still).length() < 1e-15);
    }

    #[test]
    fn directions_near_the_pole_are_unit_vectors() {
        let lobe = [DVec3::new(0.6, 0.0, 0.8)];
        for step in [0.0, 1e-16, 1e-12, 1e-9, 1e-6, 1e-3] {
            let n = -(AXIS + step * DVec3::new(1.0, -2.0, 3.0)).normalize();
            let mirrored = (n + 0.4 * n.any_orthonormal_vector()).normalize();
            for d in (GlossyLobe { n, lobe: &lobe }).directions(mirrored) {
                assert!((d.length() - 1.0).abs() < 1e-15, "{step}");
                assert!((d.dot(mirrored) - 0.8).abs() < 1e-15, "{step}");
            }
        }
    }

    /// Continuity away from the pole: a step changes a direction by at most a few times its length.
    #[test]
    fn directions_vary_continuously_with_the_normal() {
        let lobe = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.0, 0.6, 0.8)];
        let about = |n: DVec3| {
            let lobe = GlossyLobe { n, lobe: &lobe };
            let mirrored = (n + 0.3 * (DVec3::X - n.x * n)).normalize();
            lobe.directions(mirrored).collect::<Vec<_>>()
        };
        let mut worst = 0.0_f64;
        for k in 0..4000 {
            let z = 1.0 - (f64::from(k) + 0.5) / 2000.0;
            let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
            let n = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            if n.dot(AXIS) < -0.9 {
                continue;
            }
            for step in [DVec3::X, DVec3::Y, DVec3::Z] {
                let neighbour = (n + 1e-6 * step).normalize();
                for (a, b) in about(n).iter().zip(about(neighbour)) {
                    worst = worst.max((*a - b).length() / 1e-6);
                }
            }
        }
        assert!(worst < 8.0, "{worst}");
    }
}
