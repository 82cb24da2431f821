//! Optical properties of media, and the state of a ray inside them: section 8 of the model.

use whitstone_core::Rgb;

/// Optical properties of a dielectric or of the surroundings.
#[derive(Clone, Copy)]
pub(super) struct Medium {
    pub(super) ior: f64,
    pub(super) absorption: Rgb,
}

/// The medium that a ray travels in.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct MediumState {
    absorption: Rgb,
    /// The prioritised dielectrics that the ray is in: one bit per rank.
    pub(super) inside: u64,
}

impl Default for MediumState {
    fn default() -> Self {
        Self::of(Rgb::splat(0.0))
    }
}

impl MediumState {
    pub(super) fn of(absorption: Rgb) -> Self {
        Self {
            absorption,
            inside: 0,
        }
    }

    pub(super) fn within(self, inside: u64) -> Self {
        Self { inside, ..self }
    }

    pub(in super::super) fn transmittance(self, length: f64) -> Rgb {
        self.absorption.map(|a| (-a * length).exp())
    }

    pub(in super::super) fn transmittance_to_infinity(self) -> Rgb {
        self.absorption.map(|a| if a == 0.0 { 1.0 } else { 0.0 })
    }
}
