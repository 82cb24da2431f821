//! A transparent body: what the materials that refract have in common.

use crate::optics::{Crossing, Interface, reflect};
use whitstone_core::{DVec3, Filter, Rgb, SurfacePoint};

/// Interfaces are named by the side that the viewer is on.
pub(crate) struct Body {
    outside: Interface,
    inside: Interface,
    interior_absorption: Rgb,
    exterior_absorption: Rgb,
}

/// What becomes of a ray at the surface of a body.
pub(crate) struct Passage {
    /// As seen from the viewer's side.
    pub(crate) interface: Interface,
    /// The mirror direction.
    pub(crate) reflected: DVec3,
    pub(crate) crossing: Crossing,
    /// Absorption coefficient of the medium on the other side, per metre.
    pub(crate) absorption: Rgb,
}

impl Body {
    /// From the indices of refraction and absorption coefficients inside and outside.
    pub(crate) fn new(interior: (f64, Rgb), exterior: (f64, Rgb)) -> Self {
        Self {
            outside: Interface::new(exterior.0, interior.0),
            inside: Interface::new(interior.0, exterior.0),
            interior_absorption: interior.1,
            exterior_absorption: exterior.1,
        }
    }

    /// Whether the indices are equal: nothing is reflected or bent.
    pub(crate) fn is_open(&self) -> bool {
        self.outside.is_open()
    }

    /// What a shadow ray keeps of its light by this weight; it enters the medium that lies behind.
    pub(crate) fn filter(&self, point: &SurfacePoint, direction: DVec3, weight: Rgb) -> Filter {
        let inside = point.n_g.dot(direction) < 0.0;
        let medium = if inside {
            self.interior_absorption
        } else {
            self.exterior_absorption
        };
        Filter {
            weight,
            medium: Some(medium),
        }
    }

    /// The share of light that goes through without being bent: as seen from the side of the lower
    /// index, where there is no total reflection, so that both faces of a plate take as much.
    pub(crate) fn unbent(&self, point: &SurfacePoint, direction: DVec3) -> f64 {
        let upward = if self.outside.eta() <= 1.0 {
            &self.outside
        } else {
            &self.inside
        };
        let crossing = upward.cross(point.n_towards(-direction), -direction);
        upward.fresnel(&crossing).transmitted
    }

    /// Straight-line code: streams run it in vector registers.
    #[inline(always)]
    pub(crate) fn passage(&self, point: &SurfacePoint, view: DVec3) -> Passage {
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
