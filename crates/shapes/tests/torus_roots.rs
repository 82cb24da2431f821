//! Compares the torus with roots in double-double precision, for the thinnest rings and the most
//! distant origins. Ferrari's formula on the coefficients at the ray origin fails the same test.

use std::ops::{Add, Mul, Sub};
use whitstone_core::{
    DVec3, InstanceId, Interval, LoweredShape, Ray, Shape, Shapes, SurfaceAttributes, SurfaceInteraction,
    Transform,
};
use whitstone_shapes::torus::Torus;
use whitstone_testkit::{Random, build};

/// The unevaluated sum of two numbers: some 32 digits (Dekker 1971).
#[derive(Clone, Copy, Debug)]
struct Double(f64, f64);

impl Double {
    fn of(value: f64) -> Self {
        Self(value, 0.0)
    }

    fn get(self) -> f64 {
        self.0 + self.1
    }

    fn normal(high: f64, low: f64) -> Self {
        let sum = high + low;
        Self(sum, low - (sum - high))
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let sum = self.0 + other.0;
        let seen = sum - self.0;
        let lost = (self.0 - (sum - seen)) + (other.0 - seen);
        Self::normal(sum, lost + self.1 + other.1)
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + Self(-other.0, -other.1)
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = self.0 * other.0;
        let lost = self.0.mul_add(other.0, -product);
        Self::normal(product, lost + self.0 * other.1 + self.1 * other.0)
    }
}

fn dot(a: &[Double], b: &[Double]) -> Double {
    let products = a.iter().zip(b).map(|(a, b)| *a * *b);
    products.fold(Double::of(0.0), Add::add)
}

/// Evaluates by Horner's rule; the coefficient of the highest power comes last.
fn polynomial(coefficients: &[Double], s: Double) -> Double {
    let highest_first = coefficients.iter().rev();
    highest_first.fold(Double::of(0.0), |sum, c| sum * s + *c)
}

/// All roots between two places, in ascending order, bracketed by the roots of the derivative.
fn roots(coefficients: &[Double], low: Double, high: Double) -> Vec<Double> {
    if coefficients.len() < 2 {
        return Vec::new();
    }
    let powers = (1..).map(f64::from);
    let derivative: Vec<Double> = coefficients[1..]
        .iter()
        .zip(powers)
        .map(|(c, k)| *c * Double::of(k))
        .collect();
    let mut ends = vec![low];
    ends.extend(roots(&derivative, low, high));
    ends.push(high);
    let negative = |s: Double| polynomial(coefficients, s).get() < 0.0;
    let mut found = Vec::new();
    for ends in ends.windows(2) {
        let (mut from, mut to) = (ends[0], ends[1]);
        if negative(from) == negative(to) {
            continue;
        }
        for _ in 0..110 {
            let middle = (from + to) * Double::of(0.5);
            if negative(middle) == negative(to) {
                to = middle;
            } else {
                from = middle;
            }
        }
        found.push(from);
    }
    found
}

/// Intersects a ray with the torus around the z axis: the points, and the smallest distance between
/// an extremum and the surface, in minor radii. Accurate to some 25 digits.
fn exact(ray: &Ray, major: f64, minor: f64) -> (Vec<DVec3>, f64) {
    let o = ray.origin.to_array().map(Double::of);
    let d = ray.direction.to_array().map(Double::of);
    let start = Double::of(-ray.origin.dot(ray.direction) / ray.direction.length_squared());
    let q = [0, 1, 2].map(|i| o[i] + start * d[i]);
    let (a, b, w) = (dot(&d, &d), dot(&q, &d), dot(&q, &q));
    let (big, small) = (Double::of(major), Double::of(minor));
    let four = Double::of(4.0) * big * big;
    let k = w + big * big - small * small;
    let times = |factor: f64, x: Double| Double::of(factor) * x;
    let coefficients = [
        k * k - four * dot(&q[..2], &q[..2]),
        times(4.0, b * k) - times(2.0, four * dot(&q[..2], &d[..2])),
        times(2.0, a * k) + times(4.0, b * b) - four * dot(&d[..2], &d[..2]),
        times(4.0, a * b),
        a * a,
    ];
    let end = Double::of(2.0 * (major + minor) / ray.direction.length());
    let low = Double(-end.0, 0.0);
    let derivative: Vec<Double> = (1..5).map(|k| coefficients[k] * Double::of(k as f64)).collect();
    let extrema = roots(&derivative, low, end);
    let margin = extrema
        .iter()
        .map(|s| polynomial(&coefficients, *s).get().abs() / (8.0 * major * major * minor * minor));
    let margin = margin.fold(f64::INFINITY, f64::min);
    let points = roots(&coefficients, low, end)
        .into_iter()
        .filter(|s| (start + *s).get() > 0.0)
        .map(|s| DVec3::from_array([0, 1, 2].map(|i| (q[i] + s * d[i]).get())))
        .collect();
    (points, margin)
}

/// The common method: coefficients at the origin, resolvent cubic, two quadratics.
fn ferrari(ray: &Ray, major: f64, minor: f64) -> Vec<DVec3> {
    let (o, d) = (ray.origin, ray.direction.normalize());
    let (b, k) = (o.dot(d), o.length_squared() + major * major - minor * minor);
    let four = 4.0 * major * major;
    let (o2, d2) = (o.truncate(), d.truncate());
    let c3 = 4.0 * b;
    let c2 = 2.0 * k + 4.0 * b * b - four * d2.length_squared();
    let c1 = 4.0 * b * k - 2.0 * four * o2.dot(d2);
    let c0 = k * k - four * o2.length_squared();
    let p = c2 - 0.375 * c3 * c3;
    let q = c3 * c3 * c3 / 8.0 - 0.5 * c3 * c2 + c1;
    let r = -3.0 / 256.0 * c3.powi(4) + c3 * c3 * c2 / 16.0 - 0.25 * c3 * c1 + c0;
    // One real root of z³ - p/2 z² - r z + (r p/2 - q²/8).
    let (a2, a1, a0) = (-0.5 * p, -r, 0.5 * r * p - 0.125 * q * q);
    let (third, half) = (
        (a1 - a2 * a2 / 3.0) / 3.0,
        0.5 * (2.0 * a2.powi(3) / 27.0 - a2 * a1 / 3.0 + a0),
    );
    let discriminant = half * half + third.powi(3);
    let z = if discriminant >= 0.0 {
        let root = discriminant.sqrt();
        (-half + root).cbrt() + (-half - root).cbrt()
    } else {
        2.0 * (-third).sqrt() * ((-half / (-third).powi(3).sqrt()).acos() / 3.0).cos()
    } - a2 / 3.0;
    let (u, v) = ((z * z - r).max(0.0).sqrt(), (2.0 * z - p).max(0.0).sqrt());
    let u = u.copysign(q);
    let mut found = Vec::new();
    for (linear, constant) in [(v, z - u), (-v, z + u)] {
        let square = linear * linear - 4.0 * constant;
        if square >= 0.0 {
            found.extend([-square.sqrt(), square.sqrt()].map(|root| 0.5 * (-linear + root) - 0.25 * c3));
        }
    }
    found.retain(|t| *t > 0.0);
    found.sort_by(f64::total_cmp);
    found.into_iter().map(|t| o + t * d).collect()
}

fn tested(torus: &dyn Shape, ray: &Ray) -> Vec<SurfaceInteraction> {
    let mut interval = Interval::FORWARD;
    let mut found = Vec::new();
    while let Some(hit) = torus.intersect(ray, interval, None) {
        interval.min = hit.t;
        let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
        found.push(torus.surface(ray, &hit, SurfaceAttributes::NOTHING));
    }
    found
}

/// Whether a ray gets another number of hits or one that is off by more than 1e-6 minor radii,
/// measured along the normal; and the largest error, in minor radii.
fn compare(found: &[DVec3], exact: &[DVec3], ray: &Ray, major: f64, minor: f64) -> (bool, f64) {
    if found.len() != exact.len() {
        return (true, 0.0);
    }
    let error = |(found, exact): (&DVec3, &DVec3)| {
        let circle = major * exact.with_z(0.0).normalize();
        let normal = (*exact - circle).normalize();
        let cosine = normal.dot(ray.direction.normalize()).abs();
        found.distance(*exact) * cosine / minor
    };
    let error = found.iter().zip(exact).map(error).fold(0.0, f64::max);
    (error > 1e-6, error)
}

/// A ray towards the tube or just past it.
fn aim(random: &mut Random, distance: f64, minor: f64) -> Ray {
    let phi = std::f64::consts::PI * random.signed();
    let circle = DVec3::new(phi.cos(), phi.sin(), 0.0);
    let target = circle + 1.2 * minor * random.cube();
    let mut from = random.direction();
    // Some rays pass low over the ring, some run along it.
    match random.below(4) {
        0 => from.z *= 1e-3,
        1 => from = (circle.cross(DVec3::Z) + 0.01 * from).normalize(),
        _ => {}
    }
    let origin = target + distance * from;
    Ray::new(origin, (target - origin) * [1.0, 1.0 / distance][random.below(2)])
}

#[test]
fn roots_are_right_to_a_millionth_of_the_tube() {
    for minor in [1e-5, 1e-4, 1e-3, 0.03, 0.5, 0.99] {
        for distance in [0.3, 3.0, 1e3, 1e6] {
            let text = format!("minor_radius = {minor}");
            let Ok(LoweredShape::Custom(torus)) = build::<Shapes, Torus>(&text, Transform::IDENTITY) else {
                panic!("a torus is a custom shape")
            };
            let mut random = Random::new(26);
            let (mut wrong, mut naive_wrong, mut largest, mut hits, mut told) = (0, 0, 0f64, 0, 0);
            for _ in 0..1000 {
                let ray = aim(&mut random, distance, minor);
                let (exact, margin) = exact(&ray, 1.0, minor);
                // If the ray is tangent to within a millionth of the tube, either answer is right.
                if margin < 1e-6 {
                    continue;
                }
                told += 1;
                hits += usize::from(!exact.is_empty());
                let found: Vec<DVec3> = tested(&*torus, &ray).iter().map(|p| p.position).collect();
                let (bad, error) = compare(&found, &exact, &ray, 1.0, minor);
                wrong += usize::from(bad);
                largest = largest.max(error);
                let naive = ferrari(&ray, 1.0, minor);
                naive_wrong += usize::from(compare(&naive, &exact, &ray, 1.0, minor).0);
            }
            println!(
                "r/R {minor:e} from {distance:e}: {wrong} of {told} wrong ({hits} hit), largest error {largest:.1e} r; \
                 Ferrari {naive_wrong}"
            );
            assert_eq!(wrong, 0, "r/R {minor}, distance {distance}");
            assert!(told > 900 && hits > 300, "{told} told, {hits} hit");
            if distance >= 1e3 && minor <= 1e-3 {
                assert!(
                    naive_wrong > told / 10,
                    "the naive way must fail: {naive_wrong} of {told}"
                );
            }
        }
    }
}
