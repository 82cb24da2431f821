//! Directions and angles at which laws are checked: evenly spread, and special cases.

use whitstone_core::DVec3;

/// Unit vectors spread over the sphere; the first are the axes and one diagonal, each with its
/// opposite.
pub(crate) fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    let axes = [
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0).normalize(),
    ];
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let spiral = (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sin, cos) = (golden * f64::from(i)).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z).normalize()
    });
    axes.into_iter().flat_map(|axis| [axis, -axis]).chain(spiral)
}

/// Cosines of angles of incidence, from normal to nearly grazing.
pub(crate) const COSINES: [f64; 12] = [
    1.0,
    1.0 - 1e-15,
    0.999,
    0.9,
    0.75,
    0.5,
    0.25,
    0.1,
    1e-3,
    1e-6,
    1e-12,
    1e-17,
];

/// The unit vector at this cosine to `n`, rotated by `angle` around it.
pub(crate) fn at_cosine(n: DVec3, cosine: f64, angle: f64) -> DVec3 {
    let (a, b) = n.any_orthonormal_pair();
    let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
    cosine * n + sine * (angle.cos() * a + angle.sin() * b)
}
