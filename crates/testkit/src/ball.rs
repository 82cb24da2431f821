//! A sphere for the tests of the kit itself, independent of the plugin crates.

use whitstone_core::{
    Aabb, DVec3, Interval, PreliminaryIntersection, Ray, Shape, ShapeHit, Spans, SurfaceAttributes,
    SurfaceInteraction, solid,
};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    pub(crate) center: DVec3,
    pub(crate) radius: f64,
}

impl Ball {
    fn roots(&self, ray: &Ray) -> [f64; 2] {
        let (l, d) = (ray.origin - self.center, ray.direction);
        let a = d.length_squared();
        let b = l.dot(d);
        let perpendicular = (l - (b / a) * d).length();
        let root = (a * (self.radius - perpendicular) * (self.radius + perpendicular)).sqrt();
        let q = -(b + root.copysign(b));
        let c = (l.length() - self.radius) * (l.length() + self.radius);
        [c / q, q / a]
    }
}

impl Shape for Ball {
    fn bounds(&self) -> Aabb {
        let aabb = Aabb {
            min: self.center - self.radius,
            max: self.center + self.radius,
        };
        aabb.padded(4.0 * f64::EPSILON * (self.center.abs().max_element() + self.radius))
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let mut roots = self.roots(ray);
        if origin_primitive.is_some() {
            let start = usize::from(roots[1].abs() < roots[0].abs());
            roots[start] = f64::NAN;
        }
        let inside = roots.into_iter().filter(|t| interval.contains(*t));
        inside.reduce(f64::min).map(ShapeHit::plain)
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let [one, other] = self.roots(ray).map(ShapeHit::plain);
        let (enter, exit) = if one.t < other.t {
            (one, other)
        } else {
            (other, one)
        };
        solid::push(spans, enter, exit);
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        let n = (ray.at(hit.t) - self.center).normalize();
        let error = 2.0 * f64::EPSILON * (self.center.abs().max_element() + self.radius);
        SurfaceInteraction::new(self.center + self.radius * n, error, n)
    }
}
