//! The spot light of a probe, as the model states it or as a subject may take it.

/// A spot light, by what a subject may do in another way.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Spot {
    /// Half angle of the cone, in degrees.
    pub(super) cutoff: f64,
    /// Half angle of the beam, in degrees.
    pub(super) beam: f64,
    pub(super) edge: Edge,
    /// Whether its light falls off with the squared distance.
    pub(super) has_falloff: bool,
}

/// How the light falls off from the edge of the beam, where it is 1, to that of the cone, where it
/// is 0.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Edge {
    /// Linearly with the angle, as in the model.
    Angle,
    Cosine,
    SquaredCosine,
    /// By a smooth step, `3 x^2 - 2 x^3`.
    SmoothCosine,
    SmoothAngle,
}

impl Spot {
    /// What the probe states.
    pub(super) const STATED: Self = Self {
        cutoff: 32.0,
        beam: 14.0,
        edge: Edge::Angle,
        has_falloff: true,
    };
    const INTENSITY: f64 = 20.0;
    /// Spots whose sum has another edge.
    const PARTS: usize = 32;

    fn keys(&self, intensity: f64, cutoff: f64, beam: f64) -> [String; 7] {
        let falloff = if self.has_falloff {
            "inverse_square"
        } else {
            "none"
        };
        [
            "type = \"spot\"".to_owned(),
            "position = [-1, 1.2, 2]".to_owned(),
            "target = [0.1, 0, -1]".to_owned(),
            format!("intensity = {intensity:?}"),
            format!("cutoff_angle = {cutoff:?}"),
            format!("beam_width = {beam:?}"),
            format!("falloff = \"{falloff}\""),
        ]
    }

    /// The table of the light.
    pub(super) fn light(&self) -> String {
        let keys = self.keys(Self::INTENSITY, self.cutoff, self.beam);
        format!("[[light]]\n{}\n", keys.join("\n"))
    }

    /// The change of the scene, as for `--set`, that puts this spot in the place of the stated one.
    pub(super) fn change(&self) -> String {
        let lights: Vec<String> = match self.edge {
            Edge::Angle => vec![self.keys(Self::INTENSITY, self.cutoff, self.beam).join(", ")],
            _ => self.parts(),
        };
        format!("light=[{{{}}}]", lights.join("}, {"))
    }

    /// Spots that are each linear between two angles, and whose sum has the edge.
    fn parts(&self) -> Vec<String> {
        let angle = |k: usize| self.beam + (self.cutoff - self.beam) * k as f64 / Self::PARTS as f64;
        let part = |k: usize| {
            let intensity = Self::INTENSITY * (self.at(angle(k)) - self.at(angle(k + 1)));
            self.keys(intensity, angle(k + 1), angle(k)).join(", ")
        };
        (0..Self::PARTS).map(part).collect()
    }

    /// The part of the light that is left at an angle from the axis, in degrees, within the edge.
    fn at(&self, angle: f64) -> f64 {
        let of_angle = (self.cutoff - angle) / (self.cutoff - self.beam);
        let [angle, cutoff, beam] = [angle, self.cutoff, self.beam].map(|angle| angle.to_radians().cos());
        let of_cosine = (angle - cutoff) / (beam - cutoff);
        let smooth = |x: f64| x * x * (3.0 - 2.0 * x);
        match self.edge {
            Edge::Angle => of_angle,
            Edge::Cosine => of_cosine,
            Edge::SquaredCosine => of_cosine.powi(2),
            Edge::SmoothCosine => smooth(of_cosine),
            Edge::SmoothAngle => smooth(of_angle),
        }
    }
}
