//! Which medium a ray is in where transparent bodies overlap.
//!
//! Schmidt and Budge, *Simple nested dielectrics in ray traced images*, JGT 7(2), 2002: every body
//! has a priority, a ray knows which bodies it is in, and the one of the highest priority counts.
//! Faces behind which the same body counts as in front of them are not there. So water may reach a
//! little into the glass that holds it, and neither needs a face that names both.
//!
//! Only scenes with priorities pay for it: all others have no [`Bodies`], and a ray that is in
//! nothing carries one number that nobody reads.

use crate::{Branch, BranchKind, Branches, DVec3, Filter, Material, Rgb, SurfacePoint};
use std::cmp::Reverse;
use std::sync::Arc;

/// What fills a body, or surrounds all of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Substance {
    /// Index of refraction.
    pub ior: f64,
    /// Absorption coefficient, per metre.
    pub absorption: Rgb,
}

impl Substance {
    /// Empty space.
    pub const NONE: Self = Self {
        ior: 1.0,
        absorption: Rgb::BLACK,
    };
}

/// A material of bodies that may overlap.
pub trait Overlapping: Send + Sync {
    /// Where bodies overlap, that of the highest priority counts.
    fn priority(&self) -> u32;

    /// What fills the body.
    fn substance(&self) -> Substance;

    /// The branches at a face between two substances, seen from the first of them, in place of
    /// [`Material::branches`].
    fn branches_between(
        &self,
        point: &SurfacePoint,
        view: DVec3,
        from: Substance,
        to: Substance,
        out: &mut Branches,
    );

    /// What a shadow ray keeps of its light at such a face, where shadows are filtered.
    fn filter_between(&self, point: &SurfacePoint, direction: DVec3, from: Substance, to: Substance) -> Rgb;
}

/// The bodies that a ray is in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inside(u64);

impl Inside {
    /// Outside of all.
    pub const NOTHING: Self = Self(0);

    /// The rank of the body that counts; 64 where there is none.
    fn top(self) -> u32 {
        self.0.trailing_zeros()
    }
}

/// The bodies of a scene. There is none of this in scenes without priorities.
pub struct Bodies {
    /// By rank: the highest priority first, of equal ones the first in the scene.
    substances: Vec<Substance>,
    /// By shape: the bit of its body, or 0.
    bits: Vec<u64>,
}

/// A face of a body as a ray comes to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// The bodies in front of it.
    pub before: Inside,
    /// The bodies behind it.
    pub behind: Inside,
    /// What counts in front of it.
    pub from: Substance,
    /// What counts behind it.
    pub to: Substance,
    /// Whether the same body counts on both sides: rays go on as if there were no face.
    pub passed: bool,
}

impl Bodies {
    /// Most bodies of a scene.
    pub const MOST: usize = 64;

    /// Of the materials of all shapes; `None` where none has a priority. Bodies beyond
    /// [`Self::MOST`] are left out: the pipeline refuses such scenes.
    pub fn of(materials: &[Arc<dyn Material>]) -> Option<Self> {
        let all = materials.iter().enumerate();
        let mut bodies: Vec<_> = all
            .filter_map(|(shape, material)| Some((shape, material.overlapping()?)))
            .collect();
        if bodies.is_empty() {
            return None;
        }
        bodies.truncate(Self::MOST);
        // Stable: of equal priorities the first in the scene comes first.
        bodies.sort_by_key(|(_, body)| Reverse(body.priority()));
        let mut bits = vec![0; materials.len()];
        for (rank, (shape, _)) in bodies.iter().enumerate() {
            bits[*shape] = 1 << rank;
        }
        Some(Self {
            substances: bodies.iter().map(|(_, body)| body.substance()).collect(),
            bits,
        })
    }

    /// The face of a shape as a ray in these bodies comes to it, from outside of this body or from
    /// inside; `None` where the shape is no such body. On which side of its own face a ray is
    /// counts more than what it was in before, so that a camera may stand in a body.
    pub fn face(&self, shape: u32, inside: Inside, from_outside: bool) -> Option<Face> {
        let bit = self.bits[shape as usize];
        if bit == 0 {
            return None;
        }
        let (without, with) = (Inside(inside.0 & !bit), Inside(inside.0 | bit));
        let (before, behind) = if from_outside {
            (without, with)
        } else {
            (with, without)
        };
        let substance = |inside: Inside| {
            let found = self.substances.get(inside.top() as usize);
            found.copied().unwrap_or(Substance::NONE)
        };
        Some(Face {
            before,
            behind,
            from: substance(before),
            to: substance(behind),
            passed: before.top() == behind.top(),
        })
    }
}

impl Face {
    /// How rays go on.
    pub fn branches(&self, body: &dyn Overlapping, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        if self.passed {
            out.push(Branch {
                direction: -view,
                weight: Rgb::WHITE,
                kind: BranchKind::Straight,
            });
        } else {
            body.branches_between(point, view, self.from, self.to, out);
        }
    }

    /// What a shadow ray keeps, where shadows are filtered.
    pub fn filter(&self, body: &dyn Overlapping, point: &SurfacePoint, direction: DVec3) -> Filter {
        if self.passed {
            return Filter::straight(Rgb::WHITE);
        }
        Filter {
            weight: body.filter_between(point, direction, self.from, self.to),
            medium: Some(self.to.absorption),
        }
    }

    /// The bodies that a branch is in.
    pub fn inside(&self, kind: BranchKind) -> Inside {
        match kind {
            BranchKind::Reflection => self.before,
            BranchKind::Transmission { .. } | BranchKind::Straight => self.behind,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Lobes, Needs};

    struct Jelly(Option<u32>, f64);

    impl Material for Jelly {
        fn lobes(&self) -> Lobes {
            Lobes::TRANSMISSION
        }
        fn needs(&self) -> Needs {
            Needs::NOTHING
        }
        fn overlapping(&self) -> Option<&dyn Overlapping> {
            self.0.is_some().then_some(self)
        }
    }

    impl Overlapping for Jelly {
        fn priority(&self) -> u32 {
            self.0.unwrap_or_default()
        }
        fn substance(&self) -> Substance {
            Substance {
                ior: self.1,
                absorption: Rgb::splat(self.1),
            }
        }
        fn branches_between(&self, _: &SurfacePoint, _: DVec3, _: Substance, _: Substance, _: &mut Branches) {
        }
        fn filter_between(&self, _: &SurfacePoint, _: DVec3, _: Substance, _: Substance) -> Rgb {
            Rgb::splat(0.5)
        }
    }

    fn bodies(priorities: &[Option<u32>]) -> Option<Bodies> {
        let material = |(place, priority): (usize, &Option<u32>)| -> Arc<dyn Material> {
            Arc::new(Jelly(*priority, place as f64 + 2.0))
        };
        Bodies::of(&priorities.iter().enumerate().map(material).collect::<Vec<_>>())
    }

    #[test]
    fn scenes_without_priorities_have_none() {
        assert!(bodies(&[None, None]).is_none());
        assert!(bodies(&[]).is_none());
    }

    /// In, on and out of three bodies, of which the middle one counts most.
    #[test]
    fn the_highest_priority_counts() {
        let bodies = bodies(&[Some(1), None, Some(7), Some(1)]).unwrap();
        assert!(bodies.face(1, Inside::NOTHING, true).is_none());
        let mut inside = Inside::NOTHING;
        // Shape, from outside, index in front and behind.
        for (shape, enters, from, to) in [
            (0, true, 1.0, 2.0),
            (2, true, 2.0, 4.0),
            // Less than what the ray is in: passed.
            (3, true, 4.0, 4.0),
            (0, false, 4.0, 4.0),
            (2, false, 4.0, 5.0),
            // Equal to what the ray is in, and earlier in the scene.
            (0, true, 5.0, 2.0),
            (3, false, 2.0, 2.0),
            (0, false, 2.0, 1.0),
        ] {
            let face = bodies.face(shape, inside, enters).unwrap();
            assert_eq!((face.from.ior, face.to.ior, face.passed), (from, to, from == to));
            assert_eq!(face.inside(BranchKind::Reflection), inside);
            inside = face.inside(BranchKind::Straight);
        }
        assert_eq!(inside, Inside::NOTHING);
    }

    #[test]
    fn the_side_of_a_face_counts_more_than_what_was_known() {
        let bodies = bodies(&[Some(3)]).unwrap();
        // A camera inside, which knows nothing of it.
        let face = bodies.face(0, Inside::NOTHING, false).unwrap();
        assert_eq!(
            (face.from.ior, face.to, face.passed),
            (2.0, Substance::NONE, false)
        );
        assert_eq!(face.behind, Inside::NOTHING);
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        let filter = face.filter(&Jelly(Some(3), 2.0), &point, DVec3::Z);
        assert_eq!(filter.medium, Some(Rgb::BLACK));
    }

    #[test]
    fn there_may_be_as_many_as_bits() {
        let bodies = bodies(&[Some(0); 70]).unwrap();
        let mut inside = Inside::NOTHING;
        for shape in (0..64).rev() {
            let face = bodies.face(shape, inside, true).unwrap();
            assert_eq!(face.to.ior, f64::from(shape) + 2.0);
            inside = face.behind;
        }
        assert!(bodies.face(64, inside, true).is_none());
    }
}
