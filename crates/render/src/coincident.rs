//! Coincident surfaces: faces of different shapes that lie in one plane where they overlap, equal
//! spheres, equal cylinders.
//!
//! Section 9 of the model puts them in a fixed order, with infinitesimal gaps between them. Here
//! the gaps have a finite width, far below the visible size and far above all rounding errors. The
//! *shapes* are changed once, before the accelerator is built, by an affine map that differs from
//! the identity in the twelfth digit. Rays, shadow rays, streams, accelerators and the rasterizer
//! need no special rule, and scenes without coincident surfaces are unchanged.
//!
//! `parts` collects candidates, `contact` finds the surfaces that coincide, `order` determines how
//! far each surface moves along the common normal, and `fit` finds a map for each shape that moves
//! all its surfaces accordingly.

mod contact;
mod fit;
mod order;
mod parts;

use contact::Contact;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use whitstone_core::{
    Camera, DAffine3, DVec2, DVec3, Element, FilmSize, Geometry, Interval, Light, LightFlags, LoweredShape,
    Ray, SelfHitFilter, SurfaceAttributes, Transform, triangle::ShearedRay,
};

use fit::Change;

/// Width of a gap, relative to the largest coordinate of the surfaces and the distance from which
/// they are seen: 4096 units in the last place.
const GAP: f64 = 1.0 / (1u64 << 40) as f64;

/// Minimum width of a gap, relative to the offset of ray origins from both surfaces.
const ABOVE_ERRORS: f64 = 32.0;

/// The shapes of a group can be seen from up to this many times their largest coordinate without
/// loss of accuracy.
const VIEW_OF_GROUP: f64 = 64.0;

/// Maximum length, in gaps, of the path of a shadow ray through coincident surfaces at a light,
/// because it may cross the gap obliquely.
const SLANT: f64 = 64.0;

/// Two shapes with a common part of their surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Coincidence {
    /// Numbers of the shapes, the lower one first.
    pub shapes: [u32; 2],
    /// The form of the common surface.
    pub form: &'static str,
    /// A point of it, in the space of the shapes.
    pub place: DVec3,
    /// The width of the gap in metres; `None` if the shapes could not be separated, so that
    /// rounding decides which one is hit first.
    pub gap: Option<f64>,
}

impl fmt::Display for Coincidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            shapes: [one, two],
            form,
            place,
            gap,
        } = self;
        let [x, y, z] = place.to_array();
        write!(
            f,
            "shapes {one} and {two} coincide in a {form} at ({x:.6}, {y:.6}, {z:.6}): "
        )?;
        match gap {
            Some(gap) => write!(f, "separated by a gap of {gap:.1e} m"),
            None => f.write_str("not separated, so rounding decides which one is hit first"),
        }
    }
}

/// The coincident surfaces of a scene or of a group.
#[derive(Default)]
pub(crate) struct Found {
    pub(crate) pairs: Vec<Coincidence>,
    /// Changes by the number of the shape.
    changes: BTreeMap<usize, Change>,
    /// Why the shapes were not examined.
    pub(crate) not_examined: Option<String>,
    /// The distance by which shadow rays are shortened before lights, in metres.
    pub(crate) light_margin: f64,
}

/// The points from which the shapes are seen and lit.
pub(crate) struct Seen<'a> {
    /// Origins of camera rays; none in a group.
    pub(crate) from: Vec<DVec3>,
    pub(crate) lights: &'a [std::sync::Arc<dyn Light>],
}

/// Origins of the rays of the camera.
pub(crate) fn eyes(camera: &dyn Camera, film: FilmSize) -> Vec<DVec3> {
    let (width, height) = (f64::from(film.width), f64::from(film.height));
    let places = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let eyes = places.map(|[x, y]| camera.ray(DVec2::new(x * width, y * height)).origin);
    eyes.into_iter().filter(|eye| eye.is_finite()).collect()
}

/// Separates coincident surfaces by gaps. `rebuild` rebuilds a shape, given its number, with
/// another transform.
pub(crate) fn separate(
    geometry: Geometry,
    seen: &Seen<'_>,
    rebuild: impl FnMut(usize, &dyn Fn(&Transform) -> Option<Transform>) -> Option<LoweredShape>,
) -> (Geometry, Found) {
    let mut found = find(&geometry, seen);
    if found.changes.is_empty() {
        return (geometry, found);
    }
    let mut shapes = geometry.into_shapes();
    found.apply(&mut shapes, rebuild);
    (Geometry::new(shapes), found)
}

/// Finds the coincident surfaces of different shapes, and the changes that separate them.
fn find(geometry: &Geometry, seen: &Seen<'_>) -> Found {
    let parts = match parts::collect(geometry) {
        Ok(parts) => parts,
        Err(why) => {
            return Found {
                not_examined: Some(why),
                ..Found::default()
            };
        }
    };
    let contacts = contact::find(geometry, &parts);
    if contacts.is_empty() {
        return Found::default();
    }
    let classes = order::classes(&parts, &contacts);
    let mut found = Found::default();
    let mut targets: BTreeMap<usize, Vec<fit::Target>> = BTreeMap::new();
    let mut errors = Errors::default();
    for class in &classes {
        let of_class = class.contacts.iter().map(|contact| &contacts[*contact]);
        let widths = of_class
            .clone()
            .map(|contact| width(geometry, contact, seen, &mut errors));
        let gap = widths.fold(0.0, f64::max);
        for side in &class.sides {
            let points = side
                .contacts
                .iter()
                .flat_map(|contact| contacts[*contact].points.iter())
                .map(|(p, n)| {
                    (
                        *p,
                        if class.flat && class.across.dot(*n) < 0.0 {
                            -*n
                        } else {
                            *n
                        },
                    )
                });
            targets.entry(side.shape).or_default().push(fit::Target {
                points: points.collect(),
                along: side.level as f64 * gap,
                gap,
            });
        }
        if class.flat && holds_light(&contacts[class.contacts[0]], seen) {
            let levels = class.sides.len() as f64;
            found.light_margin = found.light_margin.max(SLANT * levels * gap);
        }
        let mut listed = BTreeSet::new();
        for contact in of_class {
            let shapes = contact.shapes();
            if listed.insert(shapes) {
                found.pairs.push(Coincidence {
                    shapes: shapes.map(|shape| shape as u32),
                    form: contact.form,
                    place: contact.points[0].0,
                    gap: Some(gap),
                });
            }
        }
    }
    let mut stuck = BTreeSet::new();
    for (shape, targets) in targets {
        if targets.iter().all(|target| target.along == 0.0) {
            continue;
        }
        match fit::fit(&targets) {
            Some(change) => {
                found.changes.insert(shape, change);
            }
            None => {
                stuck.insert(shape);
            }
        }
    }
    found.give_up(&stuck);
    found
}

impl Found {
    /// Marks the pairs of these shapes as not separated.
    fn give_up(&mut self, shapes: &BTreeSet<usize>) {
        for pair in &mut self.pairs {
            if pair
                .shapes
                .iter()
                .any(|shape| shapes.contains(&(*shape as usize)))
            {
                pair.gap = None;
            }
        }
    }

    /// Applies the changes to the shapes.
    fn apply(
        &mut self,
        shapes: &mut [LoweredShape],
        mut rebuild: impl FnMut(usize, &dyn Fn(&Transform) -> Option<Transform>) -> Option<LoweredShape>,
    ) {
        let mut stuck = BTreeSet::new();
        for (number, change) in &self.changes {
            if let LoweredShape::Triangles(mesh) = &mut shapes[*number] {
                for p in &mut mesh.positions {
                    *p += change.of(*p);
                }
                continue;
            }
            let moved = |placed: &Transform| {
                let DAffine3 { matrix3, translation } = *placed.world_from_object();
                Transform::new(DAffine3 {
                    matrix3: matrix3 + change.linear * matrix3,
                    translation: translation + change.of(translation),
                })
            };
            match rebuild(*number, &moved) {
                Some(shape) => shapes[*number] = shape,
                None => {
                    stuck.insert(*number);
                }
            }
        }
        self.give_up(&stuck);
    }
}

/// The minimum width of a gap that rounding cannot close.
fn width(geometry: &Geometry, contact: &Contact, seen: &Seen<'_>, errors: &mut Errors) -> f64 {
    let mut reach = contact.largest;
    if seen.from.is_empty() {
        reach *= VIEW_OF_GROUP;
    }
    for eye in &seen.from {
        for (p, _) in &contact.points {
            reach = reach.max(eye.abs().max_element()).max(eye.distance(*p));
        }
    }
    let (p, n) = contact.points[0];
    let [one, two] = contact
        .shapes()
        .map(|shape| errors.near(geometry, shape, p, n, reach));
    (GAP * reach).max(ABOVE_ERRORS * (one + two))
}

/// Cached largest coordinates of meshes.
#[derive(Default)]
struct Errors(BTreeMap<usize, f64>);

impl Errors {
    /// The offset from the surface of the rays that leave a shape near a point.
    fn near(&mut self, geometry: &Geometry, shape: usize, p: DVec3, n: DVec3, reach: f64) -> f64 {
        if let LoweredShape::Triangles(mesh) = &geometry.shapes()[shape] {
            let largest = || {
                mesh.positions
                    .iter()
                    .map(|p| p.abs().max_element())
                    .fold(0.0, f64::max)
            };
            return 8.0 * f64::EPSILON * *self.0.entry(shape).or_insert_with(largest);
        }
        let hit = meet(geometry, shape, p, n, 1e-3 * reach);
        hit.map_or(0.0, |(ray, hit)| {
            geometry.surface(&ray, &hit, SurfaceAttributes::NOTHING).error
        })
    }
}

/// The hit of a shape by a ray that starts at this height above a point and travels against n.
fn meet(
    geometry: &Geometry,
    shape: usize,
    p: DVec3,
    n: DVec3,
    far: f64,
) -> Option<(Ray, whitstone_core::PreliminaryIntersection)> {
    let ray = Ray::new(p + far * n, -n);
    let element = Element::Custom { shape: shape as u32 };
    let sheared = ShearedRay::new(&ray);
    let hit = geometry.intersect(element, &ray, &sheared, Interval::FORWARD, SelfHitFilter::NOTHING)?;
    Some((ray, hit))
}

/// Whether any point of a light lies in the plane of a contact.
fn holds_light(contact: &Contact, seen: &Seen<'_>) -> bool {
    let (p, n) = contact.points[0];
    let reach = contact.largest.max(1e-3);
    let mut samples = Vec::new();
    for light in seen
        .lights
        .iter()
        .filter(|light| light.flags().contains(LightFlags::SAMPLES))
    {
        for above in [p + 0.7 * reach * n, p - 0.7 * reach * n] {
            samples.clear();
            light.samples(above, &mut samples);
            let near = samples
                .iter()
                .filter(|sample| sample.distance.is_finite())
                .any(|sample| {
                    let place = above + sample.distance * sample.direction;
                    (place - p).dot(n).abs() <= 64.0 * f64::EPSILON * (reach + sample.distance)
                });
            if near {
                return true;
            }
        }
    }
    false
}
