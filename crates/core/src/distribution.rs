//! Reflection in several directions at once.
//!
//! Cook, Porter and Carpenter, *Distributed ray tracing*, SIGGRAPH 1984, section 4.1: gloss is what
//! mirrors show in many directions about that of the mirror. Here the directions are fixed, the
//! same at every point and in every program, so that there is no noise. They turn with the mirror
//! direction by the least rotation: where both change little, so does every direction, but for one
//! pole.
//!
//! Only scenes with such materials pay for it: their rays are followed one by one.

use crate::{Branch, BranchKind, Branches, DVec3, PathLetter, SurfacePoint, World};

/// The reflected branch of a surface, spread over directions in equal shares.
#[derive(Clone, Copy, Debug)]
pub struct Distribution<'a> {
    /// Unit normal on the viewer's side.
    pub n: DVec3,
    /// Unit vectors about +z, which stands for the mirror direction.
    pub lobe: &'a [DVec3],
}

/// What is taken to the normal: the pole, its opposite, is no axis, and lies where cameras seldom
/// see a surface face.
const AXIS: DVec3 = DVec3::new(0.48, 0.64, 0.6);

/// A unit vector across it.
const ACROSS: DVec3 = DVec3::new(0.8, -0.6, 0.0);

/// Takes a vector across `a` to one across `b` by the least rotation that takes `a` to `b`, which
/// are unit vectors: since `q` is across `a`, by a mirror. Where `b` is `-a` there is no least one,
/// and `q` stays.
fn carried(q: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let m = a + b;
    let length = m.length_squared();
    if length > 0.0 {
        q - (2.0 * q.dot(m) / length) * m
    } else {
        q
    }
}

impl Distribution<'_> {
    /// The directions about a mirror direction, in order.
    pub fn directions(&self, mirrored: DVec3) -> impl DoubleEndedIterator<Item = DVec3> + ExactSizeIterator {
        let x = carried(carried(ACROSS, AXIS, self.n), self.n, mirrored);
        // Across already, but for what rounding does next to the pole.
        let x = (x - x.dot(mirrored) * mirrored).normalize();
        let y = mirrored.cross(x);
        self.lobe.iter().map(move |q| q.x * x + q.y * y + q.z * mirrored)
    }
}

impl World {
    /// Calls `visit` with the branches of a surface from the last to the first: with all that stand
    /// for a reflected one where the material spreads it.
    pub fn backwards(
        &self,
        shape: u32,
        point: &SurfacePoint,
        view: DVec3,
        branches: &Branches,
        mut visit: impl FnMut(&Branch, PathLetter),
    ) {
        for branch in branches.iter().rev() {
            let letter = PathLetter::from(branch.kind);
            if !self.spreads_reflections || branch.kind != BranchKind::Reflection {
                visit(branch, letter);
                continue;
            }
            let material = &self.materials[shape as usize];
            let Some(distribution) = material.distribution(point, view) else {
                // Called as if it were spread where the other side of the surface is.
                visit(branch, PathLetter::among(material.reflections(), 0));
                continue;
            };
            let all = distribution.directions(branch.direction);
            let weight = branch.weight * (1.0 / all.len() as f64);
            for (number, direction) in all.enumerate().rev() {
                let branch = Branch {
                    direction,
                    weight,
                    ..*branch
                };
                visit(&branch, PathLetter::among(material.reflections(), number as u8));
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
    fn the_least_rotation_keeps_lengths_and_angles() {
        let a = DVec3::new(2.0, -1.0, 0.5).normalize();
        let q = a.cross(DVec3::X).normalize();
        for b in [a, DVec3::Y, DVec3::NEG_Z, -a] {
            let found = carried(q, a, b);
            assert!((found.length() - 1.0).abs() < 1e-14, "{b}");
            assert!(found.dot(b).abs() < 1e-14, "{b}");
        }
        // In the plane of the rotation as the axis itself, across it not at all.
        let b = (a + q).normalize();
        assert!((carried(q, a, b) - (q - a).normalize()).length() < 1e-15);
        let still = a.cross(q);
        assert!((carried(still, a, b) - still).length() < 1e-15);
    }

    #[test]
    fn directions_are_unit_vectors_next_to_the_pole_too() {
        let lobe = [DVec3::new(0.6, 0.0, 0.8)];
        for step in [0.0, 1e-16, 1e-12, 1e-9, 1e-6, 1e-3] {
            let n = -(AXIS + step * DVec3::new(1.0, -2.0, 3.0)).normalize();
            let mirrored = (n + 0.4 * n.any_orthonormal_vector()).normalize();
            for d in (Distribution { n, lobe: &lobe }).directions(mirrored) {
                assert!((d.length() - 1.0).abs() < 1e-15, "{step}");
                assert!((d.dot(mirrored) - 0.8).abs() < 1e-15, "{step}");
            }
        }
    }

    /// Beside one another, but for the pole: a step moves a direction by no more than a few of its
    /// length.
    #[test]
    fn directions_follow_the_normal() {
        let lobe = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.0, 0.6, 0.8)];
        let about = |n: DVec3| {
            let lobe = Distribution { n, lobe: &lobe };
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
                let beside = (n + 1e-6 * step).normalize();
                for (a, b) in about(n).iter().zip(about(beside)) {
                    worst = worst.max((*a - b).length() / 1e-6);
                }
            }
        }
        assert!(worst < 8.0, "{worst}");
    }
}
