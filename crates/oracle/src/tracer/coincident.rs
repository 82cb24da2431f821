//! Coincident surfaces of different shapes: the order in which a line meets them (section 9 of the
//! model).
//!
//! Nothing is displaced, and no pairs are searched for in advance. Where a line meets two surfaces
//! at one point, their forms, their normals and the gap between them decide whether they coincide.
//! The rule of the model then decides which one is first. Intersections are enclosed in intervals,
//! so that the gap is known to far less than an ulp. Cases that the model does not cover are
//! undecided.

use crate::interval::{Decided, Undecided};
use crate::root::Root;
use crate::shapes::lathe::Lathe;
use crate::shapes::prism::Prism;
use crate::shapes::{csg, mesh};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_core::config::decode;
use whitstone_core::{DAffine3, DVec3, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// Surfaces at a distance of at most this many ulp certainly coincide: the largest coordinate of a
/// face is known to a factor of two.
const TOGETHER: f64 = 8.0;

/// Surfaces at a larger distance, in ulp, certainly do not coincide.
const APART: f64 = 32.0;

/// Largest sine of the angle between normals that counts as parallel: the rounding error of a
/// normal.
const PARALLEL: f64 = 1e-13;

/// Surfaces whose normals have a larger sine of the angle intersect.
const CROSSING: f64 = 1e-9;

/// The data of one instance of a shape that the ordering rule needs.
pub(super) struct Standing {
    /// The index of the shape in the list of the scene, then for each nested instance the index in
    /// the list of its group.
    path: Vec<usize>,
    /// For each level of `path`, whether the shape is closed; `None` for an instance of a group
    /// that has both kinds.
    closed: Vec<Option<bool>>,
    faces: Faces,
}

/// The faces of a shape in world space.
enum Faces {
    /// Flat faces: the largest coordinate of each primitive.
    Flat(Vec<f64>),
    Plane,
    Ball(Ball),
    /// Segments of an outline; only flat ones have a largest coordinate.
    Segments(Vec<Option<f64>>),
    /// The side, if the shape is a cylinder, and the largest coordinates of both caps.
    Turned(Option<Side>, [f64; 2]),
    /// The faces of each CSG operand; curved ones are not covered.
    Operands(Vec<Faces>),
    Uncovered,
}

#[derive(Clone, Copy)]
struct Ball {
    center: DVec3,
    radius: f64,
}

#[derive(Clone, Copy)]
struct Side {
    ends: [DVec3; 2],
    radius: f64,
}

/// The form of a primitive.
enum Form {
    /// A flat face with its largest coordinate; 0 for an infinite plane.
    Flat(f64),
    Ball(Ball),
    Side(Side),
    Uncovered,
}

#[derive(Deserialize)]
struct Keys {
    #[serde(default)]
    center: [f64; 3],
    radius: Option<f64>,
    radii: Option<Vec<f64>>,
    slope: Option<f64>,
    z: Option<[f64; 2]>,
    caps: Option<bool>,
    vertices: Option<Vec<[f64; 3]>>,
}

fn largest(points: impl IntoIterator<Item = DVec3>) -> f64 {
    let each = points.into_iter().map(|p| p.abs().max_element());
    each.fold(0.0, f64::max)
}

/// The scale factor of a similarity; `None` if the scale depends on the direction.
fn scale(map: &DAffine3) -> Option<f64> {
    let [x, y, z] = [0, 1, 2].map(|i| map.matrix3.col(i));
    let length = x.length();
    let even = [y, z]
        .iter()
        .all(|v| (v.length() - length).abs() <= 1e-12 * length);
    let skew = [x.dot(y), y.dot(z), z.dot(x)];
    (even && skew.iter().all(|x| x.abs() <= 1e-12 * length * length)).then_some(length)
}

/// Whether each edge occurs equally often in both directions.
fn is_closed(triangles: &[[[f64; 3]; 3]]) -> bool {
    // Adding 0 turns -0 into 0, so that equal numbers have equal bits.
    let key = |p: [f64; 3]| p.map(|x| (x + 0.0).to_bits());
    let mut runs: BTreeMap<_, i64> = BTreeMap::new();
    for corners in triangles {
        for k in 0..3 {
            let (from, to) = (key(corners[k]), key(corners[(k + 1) % 3]));
            if from != to {
                let side = if from < to { 1 } else { -1 };
                *runs.entry((from.min(to), from.max(to))).or_default() += side;
            }
        }
    }
    runs.values().all(|sum| *sum == 0)
}

impl Faces {
    fn new(
        description: &Description<'_>,
        plugin: &PluginTable<'_>,
        map: &DAffine3,
        triangles: &[[[f64; 3]; 3]],
    ) -> Result<Self, SceneErrors> {
        let world = |p: [f64; 3]| map.transform_point3(DVec3::from_array(p));
        let square = |z: f64| {
            largest([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].map(|[x, y]| world([x, y, z])))
        };
        if plugin.name == "csg" {
            let operands = decode::<csg::Config>(&plugin.table)?.operands(description)?;
            let faces = operands.iter().map(|(plugin, own)| {
                let triangles = match &*plugin.name {
                    "mesh" => mesh::read(description, &decode(&plugin.table)?)?.triangles,
                    _ => Vec::new(),
                };
                Self::new(description, plugin, &(*map * *own), &triangles)
            });
            return Ok(Self::Operands(faces.collect::<Result<_, _>>()?));
        }
        Ok(match &*plugin.name {
            "plane" => Self::Plane,
            "rectangle" | "disk" => Self::Flat(vec![square(0.0)]),
            "box" => {
                // For each axis the lower and the upper face.
                let face = |number: usize| {
                    let corner = |k: usize| {
                        let mut p = [0.0; 3];
                        p[number / 2] = [-1.0, 1.0][number % 2];
                        p[(number / 2 + 1) % 3] = [-1.0, 1.0][k % 2];
                        p[(number / 2 + 2) % 3] = [-1.0, 1.0][k / 2];
                        world(p)
                    };
                    largest((0..4).map(corner))
                };
                Self::Flat((0..6).map(face).collect())
            }
            "triangle" | "mesh" | "heightfield" => {
                let of = |corners: &[[f64; 3]; 3]| largest(corners.map(world));
                Self::Flat(triangles.iter().map(of).collect())
            }
            "prism" => {
                let shape: Prism = decode(&plugin.table)?;
                let at = |[x, z]: [f64; 2], y: f64| world([x, y, z]);
                let sides = shape
                    .edges()
                    .map(|(p, q)| largest([p, q].into_iter().flat_map(|p| shape.y.map(|y| at(p, y)))));
                let cap = |y: f64| largest(shape.outline.iter().map(|p| at(*p, y)));
                Self::Flat(sides.chain(shape.y.map(cap)).collect())
            }
            "lathe" => {
                let shape: Lathe = decode(&plugin.table)?;
                let segment = |ends: &[[f64; 2]]| {
                    let ([r, y], [s, z]) = (ends[0], ends[1]);
                    let r = r.max(s);
                    let around = [[r, 0.0], [0.0, r], [-r, 0.0], [0.0, -r]];
                    (y == z).then(|| largest(around.map(|[x, z]| world([x, y, z]))))
                };
                Self::Segments(shape.outline.windows(2).map(segment).collect())
            }
            "sphere" | "cylinder" | "cone" | "paraboloid" | "hyperboloid" | "polygon" => {
                Self::of_keys(&plugin.name, decode(&plugin.table)?, map)
            }
            _ => Self::Uncovered,
        })
    }

    fn of_keys(name: &str, keys: Keys, map: &DAffine3) -> Self {
        let world = |p: DVec3| map.transform_point3(p);
        let radius = keys.radius.unwrap_or(1.0);
        let turned = |z: [f64; 2], radii: [f64; 2], side: Option<Side>| {
            let cap = |k: usize| {
                let around = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y];
                largest(around.map(|d| world(z[k] * DVec3::Z + radii[k] * d)))
            };
            Self::Turned(side, [cap(0), cap(1)])
        };
        match name {
            "polygon" => {
                let vertices = keys.vertices.unwrap_or_default();
                Self::Flat(vec![largest(vertices.into_iter().map(|p| world(p.into())))])
            }
            // An instance may turn it into an ellipsoid.
            "sphere" => match scale(map) {
                Some(scale) => Self::Ball(Ball {
                    center: world(keys.center.into()),
                    radius: scale * radius,
                }),
                None => Self::Uncovered,
            },
            "cylinder" => {
                let z = keys.z.unwrap_or([-1.0, 1.0]);
                let side = scale(map).map(|scale| Side {
                    ends: z.map(|z| world(z * DVec3::Z)),
                    radius: scale * radius,
                });
                turned(z, [radius; 2], side)
            }
            "cone" => {
                let radii = keys.radii.map_or([1.0, 0.0], |radii| [radii[0], radii[1]]);
                turned(keys.z.unwrap_or([0.0, 1.0]), radii, None)
            }
            "paraboloid" => {
                let z = keys.z.unwrap_or([0.0, 1.0]);
                turned(z, z.map(|z| radius * z.sqrt()), None)
            }
            _ => {
                let (waist, slope) = (keys.radius.unwrap_or(0.5), keys.slope.unwrap_or(1.0));
                let z = keys.z.unwrap_or([-1.0, 1.0]);
                turned(z, z.map(|z| waist.hypot(slope * z)), None)
            }
        }
    }

    fn form(&self, primitive: u32) -> Form {
        match self {
            Self::Flat(all) => Form::Flat(all[primitive as usize]),
            Self::Segments(all) => all[primitive as usize].map_or(Form::Uncovered, Form::Flat),
            Self::Plane => Form::Flat(0.0),
            Self::Ball(ball) => Form::Ball(*ball),
            Self::Turned(side, caps) => match primitive {
                0 => side.map_or(Form::Uncovered, Form::Side),
                cap => Form::Flat(caps[(cap - 1) as usize]),
            },
            Self::Operands(operands) => {
                let count = operands.len() as u32;
                match operands[(primitive % count) as usize].form(primitive / count) {
                    Form::Flat(largest) => Form::Flat(largest),
                    _ => Form::Uncovered,
                }
            }
            Self::Uncovered => Form::Uncovered,
        }
    }
}

/// Whether two lengths that differ by `difference` metres count as equal, for surfaces with
/// coordinates up to `largest`. Undecided between both thresholds.
fn same(difference: f64, largest: f64) -> Decided<bool> {
    let ulps = difference / (f64::EPSILON * largest);
    if ulps <= TOGETHER {
        Ok(true)
    } else if ulps > APART {
        Ok(false)
    } else {
        Err(Undecided)
    }
}

impl Ball {
    fn is(self, other: Self) -> Decided<bool> {
        let reach = |ball: Self| ball.center.abs().max_element() + ball.radius;
        let largest = reach(self).max(reach(other));
        let centers = (self.center - other.center).length();
        same(centers.max((self.radius - other.radius).abs()), largest)
    }
}

impl Side {
    /// Whether both are part of the same infinite cylinder; overlap along the axis is given,
    /// because a line meets them at one point.
    fn is(self, other: Self) -> Decided<bool> {
        let reach = |side: Self| largest(side.ends) + side.radius;
        let size = reach(self).max(reach(other));
        let along = (other.ends[1] - other.ends[0]).normalize();
        let off = self
            .ends
            .map(|end| (end - other.ends[0]).reject_from_normalized(along).length());
        same(off[0].max(off[1]).max((self.radius - other.radius).abs()), size)
    }
}

impl Standing {
    /// Data of the shape at this path. `triangles` are in its object space; `map` leads to world
    /// space.
    pub(super) fn new(
        description: &Description<'_>,
        plugin: &PluginTable<'_>,
        path: Vec<usize>,
        map: &DAffine3,
        triangles: &[[[f64; 3]; 3]],
    ) -> Result<Self, SceneErrors> {
        let caps = || decode::<Keys>(&plugin.table).map(|keys| keys.caps != Some(false));
        let closed = match &*plugin.name {
            "sphere" | "box" | "ellipsoid" | "torus" | "csg" | "fractal" | "prism" => Some(true),
            "lathe" => Some(decode::<Lathe>(&plugin.table)?.is_closed()),
            "cylinder" | "cone" | "paraboloid" | "hyperboloid" => Some(caps()?),
            "mesh" => Some(is_closed(triangles)),
            "plane" | "rectangle" | "disk" | "triangle" | "polygon" | "heightfield" => Some(false),
            // No face of the other shapes is covered.
            _ => None,
        };
        Ok(Self {
            path,
            closed: vec![closed],
            faces: Faces::new(description, plugin, map, triangles)?,
        })
    }

    /// Sets for each instance whether its shapes are closed. Call it with all parts of the scene.
    pub(super) fn join(all: Vec<&mut Self>) {
        let mut kinds: BTreeMap<Vec<usize>, BTreeSet<Option<bool>>> = BTreeMap::new();
        for part in &all {
            for level in 1..=part.path.len() {
                let kind = kinds.entry(part.path[..level].to_vec()).or_default();
                kind.insert(part.closed[0]);
            }
        }
        for part in all {
            let of = |level: usize| {
                let kind = &kinds[&part.path[..level]];
                kind.first().copied().flatten().filter(|_| kind.len() == 1)
            };
            part.closed = (1..=part.path.len()).map(of).collect();
        }
    }
}

/// An intersection of a line with a shape.
#[derive(Clone, Copy)]
pub(super) struct Meeting<'a> {
    pub(super) of: &'a Standing,
    pub(super) root: &'a Root,
}

impl Meeting<'_> {
    /// The order of two coincident surfaces along the line; `None` if they do not coincide.
    pub(super) fn order(self, other: Self, line: &Line) -> Decided<Option<Ordering>> {
        let level = self.of.path.iter().zip(&other.of.path).position(|(a, b)| a != b);
        let Some(level) = level else {
            return Ok(None);
        };
        if !self.coincides(other, line)? {
            return Ok(None);
        }
        let (lower, first) = if self.of.path[level] < other.of.path[level] {
            (self, Ordering::Less)
        } else {
            (other, Ordering::Greater)
        };
        // The common normal is the direction of the line.
        let place = |one: Self| match (one.of.closed[level], one.root.enters) {
            (None, _) => Err(Undecided),
            (Some(true), false) => Ok(0),
            (Some(false), _) => Ok(1),
            (Some(true), true) => Ok(2),
        };
        let (mine, theirs) = (place(self)?, place(other)?);
        let lower_is_first = match mine {
            0 => false,
            1 => lower.root.enters,
            _ => true,
        };
        Ok(Some(match mine.cmp(&theirs) {
            Ordering::Equal if lower_is_first => first,
            Ordering::Equal => first.reverse(),
            order => order,
        }))
    }

    fn coincides(self, other: Self, line: &Line) -> Decided<bool> {
        let [n, m] = [self, other].map(|one| one.root.normal.normalize());
        let along = n.dot(line.direction.nearest()).abs();
        let gap = (&self.root.t - &other.root.t).abs();
        let place = line.origin.nearest() + self.root.t.nearest() * line.direction.nearest();
        let forms = [self, other].map(|one| one.of.faces.form(one.root.primitive));
        let size = |form: &Form| match form {
            Form::Flat(largest) => *largest,
            _ => 0.0,
        };
        let most = largest([place]).max(size(&forms[0])).max(size(&forms[1]));
        let ulp = f64::EPSILON * most;
        if gap.below() * along > APART * ulp || n.cross(m).length() > CROSSING {
            return Ok(false);
        }
        if (gap.above() - gap.below()) * along > 0.01 * ulp || n.cross(m).length() > PARALLEL {
            return Err(Undecided);
        }
        match forms {
            [Form::Flat(a), Form::Flat(b)] => {
                // Infinite planes are known to coincide only if they are equal.
                let together = TOGETHER * f64::EPSILON * a.max(b) + 1e-6 * ulp;
                if gap.above() * along <= together {
                    Ok(true)
                } else {
                    Err(Undecided)
                }
            }
            [Form::Ball(a), Form::Ball(b)] => a.is(b),
            [Form::Side(a), Form::Side(b)] => a.is(b),
            _ => Err(Undecided),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::tracer::{Tracer, Value};
    use std::path::Path;
    use whitstone_scene::{Description, Sources};

    /// The centre of an image of two shapes, the first red, the second blue, seen along -z.
    fn seen(shapes: [&str; 2]) -> Option<[f64; 3]> {
        let head = "[film]\nwidth = 3\nheight = 3\n\
            [camera]\ntype = \"perspective\"\nfov = 20\n\
            look_at = { origin = [0.11, 0.07, 5], target = [0.1, 0.05, 1] }\n\
            [integrator]\ntype = \"whitted\"\n\
            [[light]]\ntype = \"ambient\"\nradiance = 1\n";
        let colors = ["[1, 0, 0]", "[0, 0, 1]"];
        let each = shapes.iter().zip(colors).map(|(shape, color)| {
            format!("[[shape]]\n{shape}\nmaterial = {{ type = \"matte\", reflectance = {color} }}\n")
        });
        let text = head.to_owned() + &each.collect::<String>();
        let sources = Sources::from_text("scene.toml", &text, Path::new("."), &[]).unwrap();
        let tracer = Tracer::new(&Description::parse(&sources).into_result().unwrap()).unwrap();
        match tracer.pixel([1, 1]) {
            Value::Known { rgb, .. } => Some(rgb),
            Value::Unknown(_) => None,
        }
    }

    const RED: Option<[f64; 3]> = Some([1.0, 0.0, 0.0]);
    const BLUE: Option<[f64; 3]> = Some([0.0, 0.0, 1.0]);

    /// A rectangle this many ulp above z = 1.
    fn rectangle(ulps: f64) -> String {
        format!(
            "type = \"rectangle\"\ntransform = {{ translate = [0, 0, {:?}] }}",
            1.0 + ulps * f64::EPSILON
        )
    }

    #[test]
    fn a_gap_that_may_be_none_is_not_known() {
        for (gap, expected) in [
            (0.0, RED),
            (4.0, RED),
            (-4.0, RED),
            (20.0, None),
            (100.0, BLUE),
            (-100.0, RED),
        ] {
            assert_eq!(seen([&rectangle(0.0), &rectangle(gap)]), expected, "{gap}");
        }
    }

    #[test]
    fn forms_and_sides_decide() {
        let cube = "type = \"box\"";
        let under = "type = \"rectangle\"\n\
            transform = [{ rotate = { axis = [1, 0, 0], degrees = 180 } }, { translate = [0, 0, 1] }]";
        let ball = |radius: f64| format!("type = \"sphere\"\nradius = {radius:?}");
        let egg = "type = \"ellipsoid\"\nradii = [1, 2, 1]";
        let (flat, round) = (rectangle(0.0), ball(1.0));
        let rounder = ball(1.0 + 2.0 * f64::EPSILON);
        // The box lies behind its face; a rectangle that faces away lies behind one that does not.
        for (shapes, expected) in [
            ([cube, &flat], BLUE),
            ([&flat, cube], RED),
            ([under, &flat], BLUE),
            ([&flat, under], RED),
            ([cube, cube], RED),
            ([&round, &rounder], RED),
            ([&rounder, &round], RED),
            ([egg, egg], None),
        ] {
            assert_eq!(seen(shapes), expected, "{shapes:?}");
        }
    }
}
