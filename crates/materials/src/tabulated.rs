//! Any isotropic BRDF, as a table over the angles of the half vector.
//!
//! The angles are those of Rusinkiewicz, *A new change of variables for efficient BRDF
//! representation*, 1998: θ_h between the normal and the half vector, θ_d between the half vector
//! and the light. The table ignores the third one, φ_d, like the bivariate BRDFs of Romeiro,
//! Vasilyev and Zickler, *Passive reflectometry*, 2008. Both angles stay the same if light and
//! viewer are exchanged, so every table is reciprocal. The spacing "square_root" of θ_h is that of
//! Matusik, Pfister, Brand and McMillan, *A data-driven reflectance model*, 2003.
//!
//! - Twin: hosted by the Mitsuba driver as a Python BSDF (Mitsuba's own `measured` has other
//!   angles).
//! - Example: `scenes/materials/tabulated.toml`.

use crate::support::reflectance::share;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, TextureRef};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, LightSamples, Material, Materials, Plugin, Rgb, SceneError,
    SceneErrors, SurfaceAttributes, SurfaceInteraction,
};

/// Any isotropic BRDF, as a table over the angle between the normal and the half vector and the
/// angle between the half vector and the light.
///
/// Between the entries, the BRDF is interpolated bilinearly. It answers lights only; ambient light
/// is multiplied by the albedo at normal incidence. A table that reflects more light than arrives,
/// from one of the directions 0, 10 ... 80 degrees off the normal, is an error.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The BRDF in 1/sr, each entry a colour: 2 to 1024 rows of equal length for θ_h, the angle
    /// between the normal and the half vector, from 0 to 90 degrees. Each row has 2 to 1024 entries
    /// for θ_d, the angle between the half vector and the light, from 0 to 90 degrees in equal
    /// steps.
    #[schemars(with = "Vec<Vec<Color>>")]
    values: Rows,
    /// Angles of the rows: "even" has equal steps of θ_h; "square_root" has equal steps of its
    /// square root, so that rows are denser near 0, where highlights are.
    #[serde(default)]
    spacing: Spacing,
    /// Factor on the BRDF, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    tint: TextureRef,
}

/// The rows, each with its position.
type Rows = Spanned<Vec<Spanned<Vec<Color>>>>;

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// Angles of the rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Spacing {
    /// Equal steps of θ_h.
    #[default]
    Even,
    /// Equal steps of the square root of θ_h.
    SquareRoot,
}

impl Spacing {
    /// θ_h at a share of the table, from 0 in the first row to 1 in the last one.
    fn angle(self, share: f64) -> f64 {
        FRAC_PI_2
            * match self {
                Self::Even => share,
                Self::SquareRoot => share * share,
            }
    }

    /// Derivative of [`Self::angle`].
    fn slope(self, share: f64) -> f64 {
        match self {
            Self::Even => FRAC_PI_2,
            Self::SquareRoot => PI * share,
        }
    }

    /// Inverse of [`Self::angle`].
    fn share(self, angle: f64) -> f64 {
        let even = angle / FRAC_PI_2;
        match self {
            Self::Even => even,
            Self::SquareRoot => even.sqrt(),
        }
    }
}

/// Maximum number of rows, and of entries of a row.
const LONGEST: usize = 1024;

/// Nodes and weights of Gauss's quadrature with two and with three points on [0, 1].
const GAUSS_2: [(f64, f64); 2] = [(0.211_324_865_405_187_1, 0.5), (0.788_675_134_594_812_9, 0.5)];
const GAUSS_3: [(f64, f64); 3] = [
    (0.112_701_665_379_258_31, 5.0 / 18.0),
    (0.5, 4.0 / 9.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

/// Azimuths of half vectors in the check of the albedo.
const AZIMUTHS: u32 = 32;
/// Least number of steps of θ_h in this check, in all and from row to row.
const LEAST_STEPS: usize = 32;
const LEAST_STEPS_OF_ROW: usize = 2;
/// Largest albedo that passes this check: the quadrature is accurate to about 6e-4.
const LARGEST_ALBEDO: f64 = 1.001;

/// A table of an isotropic BRDF.
struct Brdf {
    /// Number of entries over θ_h and over θ_d.
    size: [usize; 2],
    spacing: Spacing,
    /// Row by row.
    values: Vec<Rgb>,
}

impl Brdf {
    fn new(rows: &Rows, spacing: Spacing) -> Result<Self, SceneErrors> {
        let size = [
            rows.get_ref().len(),
            rows.get_ref().first().map_or(0, |row| row.get_ref().len()),
        ];
        let allowed = 2..=LONGEST;
        if !allowed.contains(&size[0]) {
            let message = format!("expected 2 to {LONGEST} rows, found {}", size[0]);
            return Err(SceneError::at(rows.span(), message).into());
        }
        let mut errors = SceneErrors::default();
        for (index, row) in rows.get_ref().iter().enumerate() {
            let found = row.get_ref().len();
            let message = if index == 0 && !allowed.contains(&found) {
                format!("expected 2 to {LONGEST} entries, found {found}")
            } else if found != size[1] {
                format!("expected {} entries as in the first row, found {found}", size[1])
            } else {
                continue;
            };
            errors.0.push(SceneError::at(row.span(), message));
        }
        let values = rows.get_ref().iter().flat_map(|row| row.get_ref());
        let values = values.map(|value| value.get()).collect();
        errors.into_result(Self {
            size,
            spacing,
            values,
        })
    }

    /// The BRDF at these angles in radians.
    fn at(&self, theta_h: f64, theta_d: f64) -> Rgb {
        let [rows, columns] = self.size;
        // Index of an interval, and the place in it.
        let place = |share: f64, count: usize| {
            let x = share.min(1.0) * (count - 1) as f64;
            let index = (x as usize).min(count - 2);
            (index, x - index as f64)
        };
        let (i, s) = place(self.spacing.share(theta_h), rows);
        let (j, t) = place(theta_d / FRAC_PI_2, columns);
        let along = |i: usize| {
            let entry = i * columns + j;
            self.values[entry] * (1.0 - t) + self.values[entry + 1] * t
        };
        along(i) * (1.0 - s) + along(i + 1) * s
    }

    /// The BRDF for light from `l`, seen from `v`.
    fn between(&self, n: DVec3, l: DVec3, v: DVec3) -> Rgb {
        let m = l + v;
        // Without a half vector, where both arguments are 0, the angle is 0.
        let theta_h = libm::atan2(n.cross(m).length(), n.dot(m));
        let theta_d = libm::atan2((l - v).length(), m.length());
        self.at(theta_h, theta_d)
    }

    /// Albedo at normal incidence. The table has no kink within the intervals of the quadrature, so
    /// its result is accurate to about 12 digits.
    fn normal_albedo(&self) -> Rgb {
        let end = self.spacing.share(FRAC_PI_4);
        let ticks = |count: usize| (1..count).map(move |i| i as f64 / (count - 1) as f64);
        let columns = ticks(self.size[1]).map(|share| self.spacing.share(share * FRAC_PI_2));
        let mut kinks: Vec<f64> = ticks(self.size[0]).chain(columns).collect();
        kinks.extend([0.0, end]);
        kinks.retain(|share| *share <= end);
        kinks.sort_by(f64::total_cmp);
        let mut sum = Rgb::BLACK;
        for ends in kinks.windows(2) {
            const PARTS: u32 = 32;
            let width = (ends[1] - ends[0]) / f64::from(PARTS);
            for part in 0..PARTS {
                for (at, weight) in GAUSS_3 {
                    let share = ends[0] + (f64::from(part) + at) * width;
                    let theta = self.spacing.angle(share);
                    let factor = TAU * libm::sin(4.0 * theta) * self.spacing.slope(share) * width * weight;
                    sum += self.at(theta, theta) * factor;
                }
            }
        }
        sum
    }

    /// Albedo for light at the angle `theta_v` to the normal, by the quadrature of the model.
    fn albedo(&self, theta_v: f64) -> Rgb {
        let intervals = self.size[0] - 1;
        let steps = intervals * LEAST_STEPS_OF_ROW.max(LEAST_STEPS.div_ceil(intervals));
        let (sin_v, cos_v) = libm::sincos(theta_v);
        let cosines: Vec<f64> = (0..AZIMUTHS)
            .map(|k| libm::cos((f64::from(k) + 0.5) * (PI / f64::from(AZIMUTHS))))
            .collect();
        let mut sum = Rgb::BLACK;
        for step in 0..steps {
            for (at, weight) in GAUSS_2 {
                let share = (step as f64 + at) / steps as f64;
                let theta_h = self.spacing.angle(share);
                let (sin_h, cos_h) = libm::sincos(theta_h);
                let area = sin_h * self.spacing.slope(share) * (weight / steps as f64);
                for cosine in &cosines {
                    let across = (sin_v * sin_h * cosine + cos_v * cos_h).clamp(0.0, 1.0);
                    let facing = (2.0 * across * cos_h - cos_v).max(0.0);
                    let factor = area * facing * 4.0 * across * (TAU / f64::from(AZIMUTHS));
                    if factor > 0.0 {
                        sum += self.at(theta_h, libm::acos(across)) * factor;
                    }
                }
            }
        }
        sum
    }

    /// The largest albedo, and the angle in degrees that it belongs to.
    fn largest_albedo(&self) -> (f64, u32) {
        let all = (0..=80).step_by(10).map(|degrees| {
            let albedo = self.albedo(f64::from(degrees).to_radians());
            (albedo.max_component(), degrees)
        });
        all.fold((0.0, 0), |most, one| if one.0 > most.0 { one } else { most })
    }
}

/// The `tabulated` material; see the module documentation.
pub struct Tabulated {
    brdf: Brdf,
    albedo: Rgb,
    tint: ColorSource,
}

impl Plugin<Materials> for Tabulated {
    const TYPE: &'static str = "tabulated";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let tint = errors.take(share(&config.tint, "a tint", context));
        let brdf = errors.take(Brdf::new(&config.values, config.spacing));
        let (Some(tint), Some(brdf)) = (tint, brdf) else {
            return Err(errors);
        };
        let (albedo, degrees) = brdf.largest_albedo();
        if albedo > LARGEST_ALBEDO {
            let message = format!(
                "expected a BRDF that reflects at most all light, found an albedo of {albedo:.3} at {degrees} degrees"
            );
            let mut error = SceneError::at(config.values.span(), message);
            error.help = Some(format!("multiply all values by {:.4}", 0.9999 / albedo));
            errors.0.push(error);
        }
        let albedo = brdf.normal_albedo();
        errors.into_result(Arc::new(Self { brdf, albedo, tint }))
    }
}

impl Material for Tabulated {
    fn flags(&self) -> BsdfFlags {
        if self.tint.is_black() || self.brdf.values.iter().all(|value| value.is_black()) {
            BsdfFlags::NOTHING
        } else {
            BsdfFlags::LOCAL
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.tint.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let n = point.n_towards(view);
        let mut sum = self.albedo * light.ambient;
        for incoming in light.lights {
            let cosine = n.dot(incoming.direction);
            if cosine > 0.0 {
                sum += self.brdf.between(n, incoming.direction, view) * cosine * incoming.irradiance;
            }
        }
        self.tint.value(point) * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_1_PI;
    use toml::de::DeTable;
    use whitstone_core::IncidentLight;
    use whitstone_core::config::decode;
    use whitstone_testkit::build;

    whitstone_testkit::material_laws!(
        Tabulated: material_laws + energy_laws + reciprocity_laws,
        "values = [[0.0..0.3, [0.3, 0.0..0.2, 0.1], 0], [0.0..0.3, 0.1, 0.0..0.3]]\ntint = [0.0..1, 1, 0.0..1]",
        "spacing = \"square_root\"\nvalues = [[1, 1, 1.5, 3], [0.25, 0.2, 0.3, 0.5], [0.05, 0.0..0.1, 0.1, 0.1], [0, 0, 0, 0]]",
    );

    #[test]
    fn black_tables_and_tints_obey_the_laws_too() {
        for text in [
            "values = [[0.3, 0.2], [0.1, 0.25]]\ntint = 0",
            "values = [[0, 0], [0, 0]]",
        ] {
            whitstone_testkit::material_laws(&*material(text));
        }
    }

    fn material(text: &str) -> Arc<dyn Material> {
        build::<Materials, Tabulated>(text, ()).unwrap()
    }

    fn brdf(text: &str) -> Brdf {
        let config: Config = decode(&DeTable::parse(text).unwrap()).unwrap();
        Brdf::new(&config.values, config.spacing).unwrap()
    }

    /// Unit vectors to the light and the viewer with these angles, in the plane of the normal z or
    /// across it.
    fn vectors(theta_h: f64, theta_d: f64, flat: bool) -> (DVec3, DVec3) {
        let h = DVec3::new(theta_h.sin(), 0.0, theta_h.cos());
        let across = if flat {
            DVec3::new(theta_h.cos(), 0.0, -theta_h.sin())
        } else {
            DVec3::Y
        };
        let (sin, cos) = theta_d.sin_cos();
        (cos * h + sin * across, cos * h - sin * across)
    }

    const TABLE: &str = "values = [[[0.1, 0.2, 0.3], 0.2, 0.05], [0.02, 0.08, [0.01, 0.2, 0.1]],\n\
                         [0.2, 0.15, 0.1], [0.05, 0.1, 0.03]]\n";

    #[test]
    fn entries_are_at_the_angles_of_the_model() {
        for (spacing, angles) in [
            ("even", [0.0, 30.0, 60.0, 90.0]),
            ("square_root", [0.0, 10.0, 40.0, 90.0]),
        ] {
            let found = brdf(&format!("{TABLE}spacing = \"{spacing}\""));
            for (i, degrees) in angles.into_iter().enumerate() {
                for j in 0..3 {
                    let at = found.at(f64::to_radians(degrees), f64::from(j) * FRAC_PI_4);
                    let expected = found.values[3 * i + j as usize];
                    for (a, b) in at.to_array().into_iter().zip(expected.to_array()) {
                        assert!((a - b).abs() < 1e-15, "{spacing} {i} {j}: {a} {b}");
                    }
                }
            }
            // Angles beyond the table, by rounding, count as its border.
            assert_eq!(found.at(2.0, 1.6), found.values[11]);
        }
    }

    #[test]
    fn the_closed_form() {
        let material = material(&format!("{TABLE}tint = [1, 0.5, 0.25]"));
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        for flat in [true, false] {
            // A third of the way from row 0 to row 1, and half of that from column 0 to column 1.
            let (l, v) = vectors(10_f64.to_radians(), 22.5_f64.to_radians(), flat);
            let lights = [IncidentLight {
                direction: l,
                irradiance: Rgb::splat(2.0),
            }];
            let light = LightSamples {
                ambient: Rgb::BLACK,
                lights: &lights,
            };
            let found = material.local_illumination(&point, v, &light);
            let f = |a: f64| (2.0 * (a + 0.2) + (0.02 + 0.08)) / 6.0;
            let expected = [f(0.1), 0.5 * f(0.2), 0.25 * f(0.3)].map(|f| f * 2.0 * l.z);
            for (a, b) in found.to_array().into_iter().zip(expected) {
                assert!((a - b).abs() < 1e-15, "{a} {b}");
            }
        }
    }

    /// Where the angles are small, they keep their digits: arc cosines would lose half of them.
    #[test]
    fn small_angles_are_accurate() {
        let found = brdf("values = [[0, 0.1], [0.1, 0.2]]");
        for angle in [1e-3, 1e-6, 1e-9] {
            for (theta_h, theta_d) in [(angle, 0.0), (0.0, angle), (angle, 2.0 * angle)] {
                let (l, v) = vectors(theta_h, theta_d, true);
                let expected = 0.1 * (theta_h + theta_d) / FRAC_PI_2;
                let value = found.between(DVec3::Z, l, v).g;
                assert!(
                    (value / expected - 1.0).abs() < 1e-6,
                    "{theta_h} {theta_d}: {value} {expected}"
                );
            }
        }
    }

    #[test]
    fn light_from_straight_across_has_a_value() {
        let found = brdf("values = [[0.1, 0.2], [0.05, 0]]");
        assert_eq!(found.between(DVec3::Z, DVec3::X, -DVec3::X).g, 0.2);
        let grazing = DVec3::new(1.0, 0.0, 1e-300);
        let across = DVec3::new(-1.0, 0.0, 1e-300);
        assert_eq!(found.between(DVec3::Z, grazing, across).g, 0.2);
    }

    /// A constant BRDF of c has the albedo pi c. One that falls linearly in θ_h and θ_d has that of
    /// an integral that can be solved.
    #[test]
    fn the_ambient_term_is_the_albedo_at_normal_incidence() {
        for spacing in ["even", "square_root"] {
            let found = brdf(&format!(
                "values = [[0.2, 0.2], [0.2, 0.2], [0.2, 0.2]]\nspacing = \"{spacing}\""
            ));
            let expected = 0.2 * PI;
            assert!((found.normal_albedo().g - expected).abs() < 1e-12, "{spacing}");
        }
        // f = θ_h 2/pi: 2 pi times the integral of 2/pi θ sin(4 θ) to pi/4, which is pi/16.
        for columns in 2..5 {
            let found = brdf(&format!(
                "values = [{:?}, {:?}]",
                vec![0; columns],
                vec![1; columns]
            ));
            assert!((found.normal_albedo().g - FRAC_PI_4).abs() < 1e-12);
        }
        // In the other spacing, the same function of θ_d.
        let found = brdf("values = [[0, 1], [0, 1], [0, 1]]\nspacing = \"square_root\"");
        assert!((found.normal_albedo().g - FRAC_PI_4).abs() < 1e-12);
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let light = LightSamples {
            ambient: Rgb::new(1.0, 2.0, 3.0),
            lights: &[],
        };
        let material = material("values = [[0.2, 0.2], [0.2, 0.2]]\ntint = 0.5");
        let shown = material.local_illumination(&point, DVec3::Z, &light);
        for (a, b) in shown.to_array().into_iter().zip([1.0, 2.0, 3.0]) {
            assert!((a - b * 0.1 * PI).abs() < 1e-12);
        }
    }

    /// The quadrature of the check agrees with the albedo, also of a narrow highlight, and with a
    /// sum over directions of light.
    #[test]
    fn the_check_measures_the_albedo() {
        for (rows, spacing) in [(2, "even"), (2, "square_root"), (10, "square_root"), (91, "even")] {
            let row = format!("[{FRAC_1_PI:?}, {FRAC_1_PI:?}]");
            let found = brdf(&format!(
                "values = [{}]\nspacing = \"{spacing}\"",
                vec![row; rows].join(", ")
            ));
            for degrees in (0..=80).step_by(10) {
                let albedo = found.albedo(f64::from(degrees).to_radians()).g;
                assert!(
                    (albedo - 1.0).abs() < 6e-4,
                    "{rows} {spacing} {degrees}: {albedo}"
                );
            }
        }
        let peak = brdf(&format!("values = [[9, 9], {}]", vec!["[0, 0]"; 90].join(", ")));
        let exact = peak.normal_albedo().g;
        assert!((peak.albedo(0.0).g / exact - 1.0).abs() < 1e-3);
        let found = brdf(TABLE);
        for theta_v in [0.2_f64, 0.9, 1.3] {
            let v = DVec3::new(theta_v.sin(), 0.0, theta_v.cos());
            // Equal parts of the disk below the hemisphere.
            const PARTS: u32 = 400;
            let mut sum = Rgb::BLACK;
            for i in 0..PARTS {
                for k in 0..PARTS {
                    let radius = ((f64::from(i) + 0.5) / f64::from(PARTS)).sqrt();
                    let (sin, cos) = (TAU * (f64::from(k) + 0.5) / f64::from(PARTS)).sin_cos();
                    let l = DVec3::new(radius * cos, radius * sin, (1.0 - radius * radius).sqrt());
                    sum += found.between(DVec3::Z, l, v);
                }
            }
            let expected = sum * (PI / f64::from(PARTS * PARTS));
            for (a, b) in found
                .albedo(theta_v)
                .to_array()
                .into_iter()
                .zip(expected.to_array())
            {
                assert!((a / b - 1.0).abs() < 1e-3, "{theta_v}: {a} {b}");
            }
        }
    }

    /// f is 1 at 30 degrees and falls linearly to 0 at 0 and 60: 2 pi times the integral of
    /// f sin(4 θ) to 45 degrees is pi/4 + sqrt(27)/4. The quadrature must not step over the kink.
    #[test]
    fn entries_are_ends_of_intervals() {
        let over_h = "values = [[0, 0], [1, 1], [0, 0], [0, 0]]";
        let over_d = "values = [[0, 1, 0, 0], [0, 1, 0, 0]]";
        for text in [over_h, over_d, &format!("{over_d}\nspacing = \"square_root\"")] {
            let expected = FRAC_PI_4 + 27_f64.sqrt() / 4.0;
            let albedo = brdf(text).normal_albedo().g;
            assert!((albedo - expected).abs() < 1e-10, "{text}: {albedo}");
        }
    }

    /// The quadrature of the model, in vectors.
    #[test]
    fn the_check_is_that_of_the_model() {
        // Rows, and the steps from row to row: two, or as many as make 32 in all.
        for (rows, parts) in [(2, 32), (4, 11), (20, 2)] {
            let table: Vec<String> = (0..rows).map(|i| format!("[0.{i}, 0.05, 0.1]")).collect();
            let found = brdf(&format!("values = [{}]", table.join(", ")));
            let theta_v = 0.9_f64;
            let v = DVec3::new(theta_v.sin(), 0.0, theta_v.cos());
            let width = FRAC_PI_2 / f64::from((rows - 1) * parts);
            let mut expected = 0.0;
            for step in 0..(rows - 1) * parts {
                for offset in [-0.5, 0.5].map(|x| x / 3.0_f64.sqrt()) {
                    let (sin, cos) = ((f64::from(step) + 0.5 + offset) * width).sin_cos();
                    for k in 0..32 {
                        let phi = (f64::from(k) + 0.5) * PI / 32.0;
                        let h = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
                        let l = 2.0 * h.dot(v) * h - v;
                        if h.dot(v) > 0.0 && l.z > 0.0 {
                            let area = 0.5 * width * sin * TAU / 32.0;
                            expected += found.between(DVec3::Z, l, v).g * l.z * 4.0 * h.dot(v) * area;
                        }
                    }
                }
            }
            let albedo = found.albedo(theta_v).g;
            assert!(
                (albedo / expected - 1.0).abs() < 1e-12,
                "{rows}: {albedo} {expected}"
            );
        }
        assert_eq!(brdf("values = [[0, 0], [0, 0]]").largest_albedo(), (0.0, 0));
    }

    fn faults(text: &str) -> Vec<(String, String)> {
        let errors = build::<Materials, Tabulated>(text, ()).err().unwrap().0;
        let found = errors.into_iter();
        found
            .map(|error| (text[error.span.unwrap()].to_owned(), error.message))
            .collect()
    }

    #[test]
    fn bad_tables_are_refused_at_their_places() {
        for (text, place, why) in [
            (
                "values = [[0, 0]]",
                "[[0, 0]]",
                "expected 2 to 1024 rows, found 1",
            ),
            ("values = []", "[]", "expected 2 to 1024 rows, found 0"),
            (
                "values = [[1], [2]]",
                "[1]",
                "expected 2 to 1024 entries, found 1",
            ),
            (
                "values = [[0, 0], [0, 0], [1, 2, 3]]",
                "[1, 2, 3]",
                "expected 2 entries as in the first row, found 3",
            ),
            ("values = [[0, 0], [0, -0.5]]", "-0.5", "at least 0, found -0.5"),
            (
                "values = [[0, 0], [[1, 1, inf], 0]]",
                "inf",
                "expected a finite number of at least 0",
            ),
            (
                "values = [[0, 0], [[1, 1], 0]]",
                "[1, 1]",
                "an array of 3 numbers, found 2",
            ),
            ("values = [[0, 0], [\"x\", 0]]", "\"x\"", "expected a colour"),
            ("values = [[0, 0], 7]", "7", "expected an array"),
            (
                "values = [[0, 0], [0, 0]]\nspacing = \"odd\"",
                "\"odd\"",
                "unknown value",
            ),
            (
                "values = [[0, 0], [0, 0]]\ntint = 2",
                "2",
                "expected a tint from 0 to 1, found 2",
            ),
        ] {
            let found = faults(text);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
            assert_eq!(found[0].0, place, "{text}: {}", found[0].1);
            assert!(found[0].1.contains(why), "{text}: {}", found[0].1);
        }
        // All rows of another length are reported.
        assert_eq!(faults("values = [[0, 0], [0], [0, 0, 0]]\ntint = 2").len(), 3);
    }

    #[test]
    fn tables_that_create_energy_are_refused() {
        let limit = LARGEST_ALBEDO * FRAC_1_PI;
        let constant = |value: f64| format!("values = [[{value:?}, {value:?}], [{value:?}, {value:?}]]");
        material(&constant(limit - 2e-4));
        let found = faults(&constant(limit + 2e-4));
        assert!(
            found[0].0.starts_with("[[") && found[0].1.contains("an albedo of 1.0"),
            "{found:?}"
        );
        // Only at grazing incidence, and only in one channel.
        let grazing = "values = [[0, 0, [0, 4, 0]], [0, 0, [0, 4, 0]]]";
        let found = faults(grazing);
        assert!(found[0].1.contains("at 80 degrees"), "{found:?}");
    }

    #[test]
    fn flags_are_exact() {
        assert_eq!(material("values = [[0, 0], [0, 0]]").flags(), BsdfFlags::NOTHING);
        assert_eq!(
            material("values = [[0, 0], [0, [0, 0, 0.1]]]").flags(),
            BsdfFlags::LOCAL
        );
    }
}
