//! Transparent bodies: shared code of the materials that refract.

use crate::support::optics::{Crossing, Interface, reflect};
use whitstone_core::{DVec3, Rgb, SurfaceInteraction, Transmittance};

/// The two orientations of a body's interface and its media. Interfaces are named by the viewer's
/// side.
pub(crate) struct Body {
    outside: Interface,
    inside: Interface,
    interior_absorption: Rgb,
    exterior_absorption: Rgb,
}

/// Reflection and refraction of a ray at the surface of a body.
pub(crate) struct Passage {
    /// The interface as seen from the viewer's side.
    pub(crate) interface: Interface,
    /// The mirror direction.
    pub(crate) reflected: DVec3,
    pub(crate) crossing: Crossing,
    /// Absorption coefficient of the medium on the other side, per metre.
    pub(crate) absorption: Rgb,
}

impl Body {
    /// Creates a body from (index of refraction, absorption coefficient) inside and outside.
    pub(crate) fn new(interior: (f64, Rgb), exterior: (f64, Rgb)) -> Self {
        Self {
            outside: Interface::new(exterior.0, interior.0),
            inside: Interface::new(interior.0, exterior.0),
            interior_absorption: interior.1,
            exterior_absorption: exterior.1,
        }
    }

    /// Whether neither side absorbs.
    pub(crate) fn is_clear(&self) -> bool {
        self.interior_absorption.is_black() && self.exterior_absorption.is_black()
    }

    /// Whether the indices are equal, so that rays are neither reflected nor bent.
    pub(crate) fn is_open(&self) -> bool {
        self.outside.is_open()
    }

    /// Shadow ray transmittance with this weight, and the medium that the shadow ray enters.
    pub(crate) fn filter(&self, point: &SurfaceInteraction, direction: DVec3, weight: Rgb) -> Transmittance {
        let inside = point.n_g.dot(direction) < 0.0;
        let medium = if inside {
            self.interior_absorption
        } else {
            self.exterior_absorption
        };
        Transmittance {
            weight,
            medium: Some(medium),
        }
    }

    /// Fresnel transmittance of an undeviated shadow ray. It is evaluated from the side with the
    /// lower index, where there is no total internal reflection, so that both faces of a plate
    /// attenuate equally.
    pub(crate) fn unbent(&self, point: &SurfaceInteraction, direction: DVec3) -> f64 {
        let upward = if self.outside.eta() <= 1.0 {
            &self.outside
        } else {
            &self.inside
        };
        let crossing = upward.cross(point.n_towards(-direction), -direction);
        upward.fresnel(&crossing).transmitted
    }

    /// Reflection and refraction of a view ray. Branchless, so that streams can vectorise it.
    #[inline(always)]
    pub(crate) fn passage(&self, point: &SurfaceInteraction, view: DVec3) -> Passage {
        let n = point.n_towards(view);
        let from_outside = point.n_g.dot(view) > 0.0;
        let interface = Interface::choose(from_outside, &self.outside, &self.inside);
        Passage {
            reflected: reflect(n, view),
            crossing: interface.cross(n, view),
            absorption: Rgb::choose(from_outside, self.interior_absorption, self.exterior_absorption),
            interface,
        }
    }
}
