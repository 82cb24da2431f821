//! Nested dielectrics: the medium that a ray is in where transparent bodies overlap.
//!
//! Schmidt and Budge, *Simple nested dielectrics in ray traced images*, JGT 7(2), 2002: every body
//! has a priority, a ray stores the set of bodies that it is inside, and the body with the highest
//! priority fills the space. An interface with the same dominant medium on both sides is ignored. A
//! liquid may therefore overlap its container slightly; no shared boundary surface is needed.
//!
//! Scenes without priorities pay almost nothing: they have no [`NestedDielectrics`], and each ray
//! carries one unused integer.

use crate::{
    DVec3, Material, Rgb, SpecularRay, SpecularRayKind, SpecularRays, SurfaceInteraction, Transmittance,
};
use std::cmp::Reverse;
use std::sync::Arc;

/// The medium that fills a body, or the space around all bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Index of refraction.
    pub ior: f64,
    /// Absorption coefficient, per metre.
    pub absorption: Rgb,
}

impl Medium {
    /// Empty space.
    pub const NONE: Self = Self {
        ior: 1.0,
        absorption: Rgb::BLACK,
    };
}

/// A material of nested dielectrics, which may overlap.
pub trait PrioritizedDielectric: Send + Sync {
    /// Where bodies overlap, the one with the highest priority fills the space.
    fn priority(&self) -> u32;

    /// What fills the body.
    fn medium(&self) -> Medium;

    /// The specular rays at an interface from `from`, the viewer's side, to `to`; replaces
    /// [`Material::specular_rays`].
    fn specular_rays_between(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        from: Medium,
        to: Medium,
        out: &mut SpecularRays,
    );

    /// Transmittance of a shadow ray at such an interface, if shadows are filtered.
    fn transmittance_between(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        from: Medium,
        to: Medium,
    ) -> Rgb;
}

/// The set of nested dielectrics that a ray is inside, one bit per body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MediumStack(u64);

impl MediumStack {
    /// Outside all bodies.
    pub const NOTHING: Self = Self(0);

    /// Rank of the dominant body; 64 if there is none.
    fn top(self) -> u32 {
        self.0.trailing_zeros()
    }
}

/// The nested dielectrics of a scene; absent in scenes without priorities.
pub struct NestedDielectrics {
    /// By rank: descending priority, ties in scene order.
    media: Vec<Medium>,
    /// By shape: the bit of its body, or 0.
    bits: Vec<u64>,
}

/// An interface of a body as a ray reaches it (medium interface).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MediumInterface {
    /// The bodies that contain the space in front of it.
    pub before: MediumStack,
    /// The bodies that contain the space behind it.
    pub behind: MediumStack,
    /// The dominant medium in front of it.
    pub from: Medium,
    /// The dominant medium behind it.
    pub to: Medium,
    /// Whether the same body dominates on both sides: rays then ignore the interface.
    pub passed: bool,
}

impl NestedDielectrics {
    /// Maximum number of bodies in a scene.
    pub const MAX: usize = 64;

    /// Collects the bodies from the materials of all shapes; `None` if no material has a priority.
    /// Bodies beyond [`Self::MAX`] are dropped: the pipeline rejects such scenes.
    pub fn of(materials: &[Arc<dyn Material>]) -> Option<Self> {
        let all = materials.iter().enumerate();
        let mut bodies: Vec<_> = all
            .filter_map(|(shape, material)| Some((shape, material.prioritized()?)))
            .collect();
        if bodies.is_empty() {
            return None;
        }
        bodies.truncate(Self::MAX);
        // Stable: bodies with equal priorities keep their scene order.
        bodies.sort_by_key(|(_, body)| Reverse(body.priority()));
        let mut bits = vec![0; materials.len()];
        for (rank, (shape, _)) in bodies.iter().enumerate() {
            bits[*shape] = 1 << rank;
        }
        Some(Self {
            media: bodies.iter().map(|(_, body)| body.medium()).collect(),
            bits,
        })
    }

    /// The interface of a shape, for a ray in the bodies `inside` that reaches it from outside or
    /// inside of its own body; `None` if the shape is no nested dielectric. `from_outside`
    /// overrides `inside` for this body, so that a camera may be placed inside it.
    pub fn face(&self, shape: u32, inside: MediumStack, from_outside: bool) -> Option<MediumInterface> {
        let bit = self.bits[shape as usize];
        if bit == 0 {
            return None;
        }
        let (without, with) = (MediumStack(inside.0 & !bit), MediumStack(inside.0 | bit));
        let (before, behind) = if from_outside {
            (without, with)
        } else {
            (with, without)
        };
        let medium = |inside: MediumStack| {
            let found = self.media.get(inside.top() as usize);
            found.copied().unwrap_or(Medium::NONE)
        };
        Some(MediumInterface {
            before,
            behind,
            from: medium(before),
            to: medium(behind),
            passed: before.top() == behind.top(),
        })
    }
}

impl MediumInterface {
    /// The specular rays of a ray at the interface.
    pub fn specular_rays(
        &self,
        body: &dyn PrioritizedDielectric,
        point: &SurfaceInteraction,
        view: DVec3,
        out: &mut SpecularRays,
    ) {
        if self.passed {
            out.push(SpecularRay {
                direction: -view,
                weight: Rgb::WHITE,
                kind: SpecularRayKind::Null,
            });
        } else {
            body.specular_rays_between(point, view, self.from, self.to, out);
        }
    }

    /// Transmittance of a shadow ray, if shadows are filtered.
    pub fn filter(
        &self,
        body: &dyn PrioritizedDielectric,
        point: &SurfaceInteraction,
        direction: DVec3,
    ) -> Transmittance {
        if self.passed {
            return Transmittance::straight(Rgb::WHITE);
        }
        Transmittance {
            weight: body.transmittance_between(point, direction, self.from, self.to),
            medium: Some(self.to.absorption),
        }
    }

    /// The bodies that a specular ray of this kind travels in.
    pub fn inside(&self, kind: SpecularRayKind) -> MediumStack {
        match kind {
            SpecularRayKind::Reflection => self.before,
            SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => self.behind,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BsdfFlags, SurfaceAttributes};

    struct Jelly(Option<u32>, f64);

    impl Material for Jelly {
        fn flags(&self) -> BsdfFlags {
            BsdfFlags::TRANSMISSION
        }
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }
        fn prioritized(&self) -> Option<&dyn PrioritizedDielectric> {
            self.0.is_some().then_some(self)
        }
    }

    impl PrioritizedDielectric for Jelly {
        fn priority(&self) -> u32 {
            self.0.unwrap_or_default()
        }
        fn medium(&self) -> Medium {
            Medium {
                ior: self.1,
                absorption: Rgb::splat(self.1),
            }
        }
        fn specular_rays_between(
            &self,
            _: &SurfaceInteraction,
            _: DVec3,
            _: Medium,
            _: Medium,
            _: &mut SpecularRays,
        ) {
        }
        fn transmittance_between(&self, _: &SurfaceInteraction, _: DVec3, _: Medium, _: Medium) -> Rgb {
            Rgb::splat(0.5)
        }
    }

    fn bodies(priorities: &[Option<u32>]) -> Option<NestedDielectrics> {
        let material = |(place, priority): (usize, &Option<u32>)| -> Arc<dyn Material> {
            Arc::new(Jelly(*priority, place as f64 + 2.0))
        };
        NestedDielectrics::of(&priorities.iter().enumerate().map(material).collect::<Vec<_>>())
    }

    #[test]
    fn scenes_without_priorities_have_none() {
        assert!(bodies(&[None, None]).is_none());
        assert!(bodies(&[]).is_none());
    }

    /// Into, in and out of three bodies, of which the middle one has the highest priority.
    #[test]
    fn the_highest_priority_counts() {
        let bodies = bodies(&[Some(1), None, Some(7), Some(1)]).unwrap();
        assert!(bodies.face(1, MediumStack::NOTHING, true).is_none());
        let mut inside = MediumStack::NOTHING;
        // Shape, from outside, expected index of refraction in front and behind.
        for (shape, enters, from, to) in [
            (0, true, 1.0, 2.0),
            (2, true, 2.0, 4.0),
            // Lower priority than the current body: ignored.
            (3, true, 4.0, 4.0),
            (0, false, 4.0, 4.0),
            (2, false, 4.0, 5.0),
            // Same priority as the current body, but earlier in the scene.
            (0, true, 5.0, 2.0),
            (3, false, 2.0, 2.0),
            (0, false, 2.0, 1.0),
        ] {
            let face = bodies.face(shape, inside, enters).unwrap();
            assert_eq!((face.from.ior, face.to.ior, face.passed), (from, to, from == to));
            assert_eq!(face.inside(SpecularRayKind::Reflection), inside);
            inside = face.inside(SpecularRayKind::Null);
        }
        assert_eq!(inside, MediumStack::NOTHING);
    }

    #[test]
    fn the_side_of_an_interface_overrides_the_medium_stack() {
        let bodies = bodies(&[Some(3)]).unwrap();
        // A camera inside the body: its ray starts with an empty set.
        let face = bodies.face(0, MediumStack::NOTHING, false).unwrap();
        assert_eq!((face.from.ior, face.to, face.passed), (2.0, Medium::NONE, false));
        assert_eq!(face.behind, MediumStack::NOTHING);
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let filter = face.filter(&Jelly(Some(3), 2.0), &point, DVec3::Z);
        assert_eq!(filter.medium, Some(Rgb::BLACK));
    }

    #[test]
    fn there_may_be_64_bodies() {
        let bodies = bodies(&[Some(0); 70]).unwrap();
        let mut inside = MediumStack::NOTHING;
        for shape in (0..64).rev() {
            let face = bodies.face(shape, inside, true).unwrap();
            assert_eq!(face.to.ior, f64::from(shape) + 2.0);
            inside = face.behind;
        }
        assert!(bodies.face(64, inside, true).is_none());
    }
}
