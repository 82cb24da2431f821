//! Bicubic Bezier patches, intersected directly, without tessellation.
//!
//! The ray is represented by two planes that contain it (Kajiya, *Ray Tracing Parametric Patches*,
//! SIGGRAPH 1982). Where the ray meets the bounding boxes of parts of the patches, all common roots
//! of the two plane distances are found (see `roots`). For the tree of boxes and Newton's method
//! see Martin, Cohen, Fish, Shirley, *Practical Ray Tracing of Trimmed NURBS Surfaces*, 2000.
//!
//! - Twin: Mitsuba mesh (native), a tessellation that the driver makes of the control points, with
//!   normals of the surface.
//! - Example: `scenes/shapes/patch.toml`.

mod net;
mod roots;
mod tree;

use net::{Jet, Net};
use roots::Piece;
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use tree::{Slabs, Tree};
use whitstone_core::config::{IntegerIn, Vector3};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LimitReached, LoweredShape, Plugin, PreliminaryIntersection, Ray,
    SceneError, SceneErrors, SearchLimit, Shape, ShapeHit, Shapes, SourceSpan, SurfaceAttributes,
    SurfaceInteraction, Transform,
};

/// Bicubic Bezier patches, given by 16 `points` or by `vertices` and `patches`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The 16 control points of one patch in object space, in metres: four rows in order of v;
    /// each row runs along u. The normal is dP/du x dP/dv.
    #[serde(default)]
    #[schemars(with = "Vec<Vector3>", extend("x-default" = "none: this, or `vertices` and `patches`, is required", "minItems" = 16, "maxItems" = 16))]
    points: Option<Spanned<Vec<Vector3>>>,
    /// Control points shared by several patches, in object space, in metres.
    #[serde(default)]
    #[schemars(with = "Vec<Vector3>", extend("x-default" = "none", "minItems" = 1, "maxItems" = 65536))]
    vertices: Option<Spanned<Vec<Vector3>>>,
    /// For each patch the indices of its 16 control points, starting at 0.
    #[serde(default)]
    #[schemars(with = "Vec<[IntegerIn<0, 65535>; 16]>", extend("x-default" = "none", "minItems" = 1, "maxItems" = 4096))]
    patches: Option<Spanned<Vec<Spanned<Vec<IntegerIn<0, 65535>>>>>>,
}

const MAX_PATCHES: usize = 4096;
const MAX_VERTICES: usize = 65536;

/// A point of a patch is a hit if the search finds it this close to the ray, relative to the size
/// of all patches. A root that was polished after that may be twice as far.
const NEAR: f64 = 1e-12;
/// Below this length P_u x P_v has no reliable direction; relative to the squared size of the
/// patch.
const NO_NORMAL: f64 = 1e-13;
/// A ray spawned on a patch ignores hits on it within this distance, relative to the size, plus
/// 1024 error bounds of a point.
const LEAVES: f64 = 1e-9;

/// The patches in world space, relative to the origin of object space.
pub struct Patch {
    patches: Vec<Net<DVec3>>,
    tree: Tree,
    origin: DVec3,
    /// Center of the bounds, relative to `origin`.
    center: DVec3,
    /// Diagonal of the bounds.
    size: f64,
    /// -1 if the transform mirrors, otherwise 1.
    orientation: f64,
    limit: SearchLimit,
}

impl Config {
    /// The patches in object space, each with its source span.
    fn read(self) -> Result<Vec<([DVec3; 16], SourceSpan)>, SceneErrors> {
        let ways = "give 16 `points`, or `vertices` and `patches`";
        let fail = |error: SceneError| Err(SceneErrors::from(error.with_help(ways)));
        match (self.points, self.vertices, self.patches) {
            (Some(points), None, None) => {
                let (place, found) = (points.span(), points.get_ref().len());
                let corners: Vec<DVec3> = points.into_inner().into_iter().map(Vector3::get).collect();
                match corners.try_into() {
                    Ok(corners) => Ok(vec![(corners, place)]),
                    Err(_) => fail(SceneError::at(
                        place,
                        format!("expected 16 points, found {found}"),
                    )),
                }
            }
            (None, Some(vertices), Some(patches)) => gather(vertices, patches),
            (None, None, None) => fail(SceneError::anywhere("this patch has no control points")),
            (None, Some(vertices), None) => {
                fail(SceneError::at(vertices.span(), "`vertices` need `patches`"))
            }
            (None, None, Some(patches)) => fail(SceneError::at(patches.span(), "`patches` need `vertices`")),
            (Some(points), ..) => fail(SceneError::at(
                points.span(),
                "`points` cannot go with `vertices` or `patches`",
            )),
        }
    }
}

fn gather(
    vertices: Spanned<Vec<Vector3>>,
    patches: Spanned<Vec<Spanned<Vec<IntegerIn<0, 65535>>>>>,
) -> Result<Vec<([DVec3; 16], SourceSpan)>, SceneErrors> {
    let mut errors = SceneErrors::default();
    let mut count = |place: SourceSpan, what: &str, most: usize, found: usize| {
        if !(1..=most).contains(&found) {
            let message = format!("expected 1 to {most} {what}, found {found}");
            errors.0.push(SceneError::at(place, message));
        }
    };
    count(
        vertices.span(),
        "vertices",
        MAX_VERTICES,
        vertices.get_ref().len(),
    );
    count(patches.span(), "patches", MAX_PATCHES, patches.get_ref().len());
    let vertices = vertices.into_inner();
    let mut found = Vec::new();
    for patch in patches.into_inner().into_iter().take(MAX_PATCHES) {
        let (place, numbers) = (patch.span(), patch.into_inner());
        let Ok(numbers) = <[IntegerIn<0, 65535>; 16]>::try_from(numbers.as_slice()) else {
            let message = format!("expected the numbers of 16 vertices, found {}", numbers.len());
            errors.0.push(SceneError::at(place, message));
            continue;
        };
        let beyond = numbers
            .iter()
            .find(|number| number.get() as usize >= vertices.len());
        if let Some(beyond) = beyond {
            let message = format!(
                "there is no vertex {}: there are {}",
                beyond.get(),
                vertices.len()
            );
            let error = SceneError::at(place, message);
            errors.0.push(error.with_help("vertices are counted from 0"));
            continue;
        }
        found.push((numbers.map(|number| vertices[number.get() as usize].get()), place));
    }
    errors.into_result(found)
}

impl Plugin<Shapes> for Patch {
    const TYPE: &'static str = "patch";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let read = config.read()?;
        let linear = transform.world_from_object().matrix3;
        let mut errors = SceneErrors::default();
        let (mut patches, mut origin_primitive) = (Vec::new(), Vec::new());
        for (points, place) in read {
            let net = Net(points).map(|p| linear * p);
            let extent = Aabb::around(net.0).extent();
            if !extent.length_squared().powi(2).is_finite() {
                let message = "the points of this patch are too far apart for double precision";
                errors.0.push(SceneError::at(place, message));
            } else if has_no_area(&net) {
                errors.0.push(SceneError::at(place, "this patch has no area"));
            } else {
                let parts = tree::parts(&net, patches.len() as u32);
                context.reserve((parts.len() * (size_of::<tree::Leaf>() + 160)) as u64)?;
                origin_primitive.extend(parts);
                patches.push(net);
            }
        }
        errors.into_result(())?;
        let hull = Aabb::around(patches.iter().flat_map(|net| net.0));
        let size = hull.extent().length();
        let reach = hull.min.abs().max(hull.max.abs()).max_element();
        let tree = Tree::new(origin_primitive, 4.0 * NEAR * size + 32.0 * f64::EPSILON * reach);
        Ok(LoweredShape::Custom(Box::new(Self {
            patches,
            origin: transform.world_from_object().translation,
            center: tree.bounds().center(),
            tree,
            size: size.max(4096.0 * f64::EPSILON * reach),
            orientation: linear.determinant().signum(),
            limit: SearchLimit::default(),
        })))
    }
}

/// Whether the sampled normals of a patch are all zero.
fn has_no_area(net: &Net<DVec3>) -> bool {
    let steps = || (1..6).map(|k| f64::from(k) / 6.0);
    let size = Aabb::around(net.0).extent().length();
    let normal = |u: f64, v: f64| {
        let Jet { u, v, .. } = net.at(u, v);
        u.cross(v).length()
    };
    let largest = steps()
        .flat_map(|u| steps().map(move |v| (u, v)))
        .map(|(u, v)| normal(u, v));
    largest.fold(0.0, f64::max) <= 1e-9 * size * size
}

/// A ray reparameterised from its point nearest to the center of the patches.
struct Line {
    /// Relative to the origin of object space.
    origin: DVec3,
    direction: DVec3,
    /// The ray parameter of `origin`.
    start: f64,
    sheared: ShearedRay,
}

impl Line {
    fn new(patch: &Patch, ray: &Ray) -> Self {
        let d = ray.direction;
        // The difference and its rounding error (Knuth's TwoSum).
        let l = ray.origin - patch.origin;
        let seen = ray.origin - l;
        let lost = (ray.origin - (l + seen)) + (seen - patch.origin);
        let start = (patch.center - l).dot(d) / d.length_squared();
        let origin = DVec3::new(
            start.mul_add(d.x, l.x),
            start.mul_add(d.y, l.y),
            start.mul_add(d.z, l.z),
        ) + lost;
        Self {
            origin,
            direction: d,
            start,
            sheared: ShearedRay::new(&Ray::new(origin, d)),
        }
    }

    fn seen(&self, net: &Net<DVec3>) -> Net<DVec2> {
        net.map(|p| self.sheared.shear(p).truncate())
    }

    /// The ray parameter of a point, relative to `start`.
    fn along(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.direction) / self.direction.length_squared()
    }
}

impl Shape for Patch {
    fn bounds(&self) -> Aabb {
        let Aabb { min, max } = self.tree.bounds();
        Aabb {
            min: self.origin + min,
            max: self.origin + max,
        }
        .padded(self.error())
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let line = Line::new(self, ray);
        let length = ray.direction.length();
        let slabs = Slabs {
            origin: line.origin,
            inverse: ray.direction.recip(),
        };
        // Box intervals are widened by a small slack.
        let slack = (1e-9 * self.size + 64.0 * self.error()) / length;
        let slack = slack + 4.0 * f64::EPSILON * line.start.abs();
        let start_is = (LEAVES * self.size + 1024.0 * self.error()) / length;
        let near = NEAR * self.size;
        let mut best: Option<ShapeHit> = None;
        let far = interval.max - line.start + slack;
        self.tree
            .walk(&slabs, interval.min - line.start - slack, far, |leaf| {
                let piece = Piece {
                    net: line.seen(&leaf.net),
                    low: leaf.low,
                    size: leaf.size,
                };
                let patch = &self.patches[leaf.patch as usize];
                let is_complete = roots::roots(piece, near, roots::MAX_PIECES, |root| {
                    let Some(root) = roots::polished(&line.seen(patch), root, 2.0 * near) else {
                        return;
                    };
                    let t = line.start + line.along(patch.at(root.x, root.y).p);
                    let is_start = origin_primitive == Some(leaf.patch) && t <= start_is;
                    let hit = ShapeHit {
                        t,
                        primitive: leaf.patch,
                        prim_uv: root,
                    };
                    if !is_start
                        && interval.contains(t)
                        && best.as_ref().is_none_or(|best| is_before(&hit, best))
                    {
                        best = Some(hit);
                    }
                });
                if !is_complete {
                    let middle = leaf.low + 0.5 * leaf.size;
                    self.limit.count(|| self.origin + patch.at(middle.x, middle.y).p);
                }
                best.as_ref().map_or(far, |best| best.t - line.start + slack)
            });
        best
    }

    fn search_limit(&self) -> Option<LimitReached> {
        self.limit.reached()
    }

    fn surface(
        &self,
        _: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let patch = &self.patches[hit.primitive as usize];
        let position = self.origin + patch.at(hit.prim_uv.x, hit.prim_uv.y).p;
        let normal = self.orientation * normal(patch, hit.prim_uv);
        let mut point = SurfaceInteraction::new(position, self.error(), normal);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = hit.prim_uv;
        }
        point
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let patch = &self.patches[hit.primitive as usize];
        let Jet { u, v, .. } = patch.at(hit.prim_uv.x, hit.prim_uv.y);
        let step = q - point.position;
        // The least-squares step, by the normal equations.
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let change = DVec2::new(
            vv * u.dot(step) - uv * v.dot(step),
            uu * v.dot(step) - uv * u.dot(step),
        );
        let prim_uv = hit.prim_uv + change / (uu * vv - uv * uv);
        let there = PreliminaryIntersection { prim_uv, ..*hit };
        prim_uv
            .is_finite()
            .then(|| self.surface(&Ray::new(q, step), &there, needs))
    }
}

/// Orders hits by distance, then by patch and parameters: where parts of a patch join, a root may
/// be found twice.
fn is_before(hit: &ShapeHit, other: &ShapeHit) -> bool {
    let key = |hit: &ShapeHit| (hit.t, hit.primitive, hit.prim_uv.x, hit.prim_uv.y);
    key(hit) < key(other)
}

/// Unit normal at a point of a patch: from its derivatives or, where their cross product vanishes,
/// its limit from inside.
fn normal(net: &Net<DVec3>, at: DVec2) -> DVec3 {
    let size = Aabb::around(net.0).extent().length();
    let Jet { u, v, .. } = net.at(at.x, at.y);
    let direct = u.cross(v);
    let least = NO_NORMAL * size * size;
    if direct.length() > least {
        return direct.normalize();
    }
    // The derivatives of P_u x P_v in the directions from the nearest edges into the patch.
    let [twice_u, mixed, twice_v] = net.bends(at.x, at.y);
    let across_v = (mixed.cross(v) + u.cross(twice_v)) * 1f64.copysign(0.5 - at.y);
    let across_u = (twice_u.cross(v) + u.cross(mixed)) * 1f64.copysign(0.5 - at.x);
    let from_edge = 0.5 - (at - 0.5).abs();
    let nearest_first = if from_edge.y <= from_edge.x {
        [across_v, across_u]
    } else {
        [across_u, across_v]
    };
    // In a corner, one of the two directions may run along a collapsed edge and carry no
    // information.
    let says_something = |inwards: &&DVec3| inwards.length() > 1e-9 * size * size;
    if let Some(inwards) = nearest_first.iter().find(says_something) {
        return inwards.normalize();
    }
    // A higher-order limit: sample farther and farther inside, up to about the centre. A patch has
    // area somewhere.
    let steps = (0..11).map(|k| 1e-6 * 4f64.powi(k));
    let inside = steps.map(|step| {
        let Jet { u, v, .. } = net.at(at.x + step * (0.5 - at.x), at.y + step * (0.5 - at.y));
        u.cross(v)
    });
    let mut good = inside.filter(|n| n.length() > least);
    good.next().unwrap_or(DVec3::Z).normalize()
}

impl Patch {
    /// Error bound of a point: six nested interpolations, each with three roundings, of coordinates
    /// of at most `reach`, and the sum with the origin.
    fn error(&self) -> f64 {
        let reach = self.center.abs().max_element() + self.size;
        8.0 * f64::EPSILON * reach + f64::EPSILON * self.origin.abs().max_element()
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod laws {
    use super::{Patch, tests};
    use whitstone_testkit::shape_laws_everywhere;

    #[test]
    fn obeys_the_laws_of_shapes() {
        for patch in tests::examples() {
            shape_laws_everywhere::<Patch>(&patch, 2_000);
        }
    }
}
