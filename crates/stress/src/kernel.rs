//! Judges another program's ray-triangle kernel: holes, wrong hits and errors of its answers.
//!
//! The program reads requests as JSON lines and answers each with a line (docs/subjects.md). All
//! vertices and rays have single precision, so that what it is asked is exactly what the truth is
//! computed for: by Whitstone's watertight test in double precision.

use crate::Lab;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone_core::{DVec3, Interval, Ray, SelfHitFilter};
use whitstone_testkit::Random;
use whitstone_validate::Stop;
use whitstone_validate::driver::{Driver, DriverError};

/// Largest error of t, times the cosine to the normal, in units of the distance of the farthest
/// corner of the triangle.
const ERROR: f64 = 1e-5;
/// A ray that passes an edge at this distance, in units in the last place of the largest coordinate
/// in single precision, may hit or miss the triangle.
const NEAR_EDGE: f64 = 8.0;
/// Rays of one request.
const BATCH: usize = 4096;
/// Examples that are kept of each set.
const EXAMPLES: usize = 3;
/// An upper end of an interval that no hit reaches; JSON has no infinity.
const FAR: f64 = 1e30;

/// Triangles with corners in single precision.
struct Mesh {
    name: &'static str,
    vertices: Vec<DVec3>,
    triangles: Vec<[usize; 3]>,
    /// The largest distance of a vertex from the first one.
    size: f64,
}

/// A ray and the interval of its hits.
#[derive(Clone, Copy, Debug)]
struct Question {
    ray: Ray,
    interval: Interval,
}

/// A hit, by the kernel or in truth.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hit {
    t: f64,
    triangle: usize,
    uv: [f64; 2],
}

/// How an answer is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Judgement {
    /// Right, with the error of t.
    Right(f64),
    /// Wrong, but the ray passes an edge so closely that rounding decides.
    NearEdge,
    /// A miss, or a hit further away, although the ray hits a triangle.
    Hole,
    /// A hit where there is none.
    WrongHit,
}

/// What the answers about one mesh are.
#[derive(Clone, Debug, Default, Serialize)]
pub struct KernelReport {
    /// Name of the mesh.
    pub mesh: &'static str,
    /// Number of its triangles.
    pub triangles: usize,
    /// Number of rays.
    pub rays: usize,
    /// Rays that hit it.
    pub hits: usize,
    /// Misses, or hits further away, although the ray hits a triangle.
    pub holes: usize,
    /// Hits where there is none, or with a wrong distance or wrong coordinates.
    pub wrong_hits: usize,
    /// Wrong answers about rays that pass an edge so closely that rounding decides.
    pub near_edges: usize,
    /// The largest error of t, times the cosine to the normal, in units of the distance of the
    /// farthest corner of the triangle.
    pub largest_error: f64,
    /// The first wrong answers.
    pub examples: Vec<String>,
    /// Requests that the kernel does not support, with its reason.
    pub skipped: Option<String>,
    /// Time until the kernel gave its answers, in seconds, while the answers before were judged.
    pub seconds: f64,
}

#[derive(Deserialize)]
struct Answers {
    t: Vec<Option<f64>>,
    primitive: Vec<i64>,
    u: Vec<Option<f64>>,
    v: Vec<Option<f64>>,
}

fn single(v: DVec3) -> DVec3 {
    v.as_vec3().as_dvec3()
}

impl Mesh {
    /// A closed ball of triangles, `levels` times divided, moved and scaled.
    fn ball(name: &'static str, levels: usize, center: DVec3, radius: f64) -> Self {
        let mut triangles: Vec<[DVec3; 3]> = Vec::new();
        for signs in 0..8 {
            let sign = |bit: u32| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let [x, y, z] = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
            let outwards = sign(0) * sign(1) * sign(2) > 0.0;
            triangles.push(if outwards { [x, y, z] } else { [x, z, y] });
        }
        for _ in 0..levels {
            triangles = (triangles.iter())
                .flat_map(|&[a, b, c]| {
                    let middle = |a: DVec3, b: DVec3| (a + b).normalize();
                    let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
                })
                .collect();
        }
        let place = |v: DVec3| single(center + radius * v);
        Self::joined(name, triangles.iter().map(|triangle| triangle.map(place)))
    }

    /// Triangles of all sizes, without slivers.
    fn soup(name: &'static str, count: usize, random: &mut Random) -> Self {
        let mut triangles = Vec::new();
        while triangles.len() < count {
            let size = 10.0_f64.powf(-2.5 * random.unit());
            let center = random.cube();
            let [a, b, c] = [0, 1, 2].map(|_| single(center + size * random.cube()));
            let longest = [b - a, c - b, a - c].map(|edge| edge.length_squared());
            let longest = longest.into_iter().fold(0.0, f64::max);
            // The normal of a sliver has no digits in single precision.
            if (b - a).cross(c - a).length() > 0.05 * longest {
                triangles.push([a, b, c]);
            }
        }
        Self::joined(name, triangles.into_iter())
    }

    /// A level grid, whose edges are parallel to axes.
    fn grid(name: &'static str, side: usize) -> Self {
        let vertex = |i: usize, j: usize| {
            let at = |k: usize| 2.0 * k as f64 / side as f64 - 1.0;
            DVec3::new(at(i), at(j), 0.0)
        };
        let quads = (0..side * side).map(|index| (index % side, index / side));
        let triangles = quads.flat_map(|(i, j)| {
            let [a, b, c, d] = [
                vertex(i, j),
                vertex(i + 1, j),
                vertex(i + 1, j + 1),
                vertex(i, j + 1),
            ];
            [[a, b, c], [a, c, d]]
        });
        Self::joined(name, triangles)
    }

    /// Vertices at the same place are one.
    fn joined(name: &'static str, triangles: impl Iterator<Item = [DVec3; 3]>) -> Self {
        let mut known = std::collections::HashMap::new();
        let mut vertices = Vec::new();
        let mut index = |v: DVec3| {
            let key = v.to_array().map(f64::to_bits);
            *known.entry(key).or_insert_with(|| {
                vertices.push(v);
                vertices.len() - 1
            })
        };
        let triangles = triangles.map(|triangle| triangle.map(&mut index)).collect();
        let first = vertices.first().copied().unwrap_or_default();
        let size = vertices.iter().map(|v| (*v - first).length()).fold(0.0, f64::max);
        Self {
            name,
            vertices,
            triangles,
            size,
        }
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|index| self.vertices[index])
    }

    /// An OBJ file. The shortest decimals of doubles are exact.
    fn obj(&self) -> String {
        let mut text = String::new();
        for v in &self.vertices {
            let _ = writeln!(text, "v {:?} {:?} {:?}", v.x, v.y, v.z);
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|index| index + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        text
    }

    /// A ray at the mesh: at a vertex, at an edge, along an axis through a vertex, or anywhere.
    fn ray(&self, random: &mut Random) -> Ray {
        let [a, b, c] = self.corners(random.below(self.triangles.len()));
        let size = self.size;
        let target = match random.below(4) {
            0 => a,
            1 => a + (b - a) * random.unit(),
            2 => a,
            _ => {
                let [u, v] = [random.unit(), random.unit()];
                let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                a + u * (b - a) + v * (c - a) + 0.05 * size * random.cube() * random.unit().powi(3)
            }
        };
        let away = match random.below(8) {
            0 => {
                [DVec3::X, DVec3::Y, DVec3::Z][random.below(3)]
                    * if random.below(2) == 0 { 1.0 } else { -1.0 }
            }
            _ => random.direction(),
        };
        let origin = single(target + size * (0.2 + random.unit()) * away);
        Ray::new(origin, single((target - origin).normalize()))
    }
}

/// The distance of a line from a segment.
fn distance(ray: &Ray, a: DVec3, b: DVec3) -> f64 {
    let d = ray.direction.normalize();
    // Across the line, it is a point and the segment a segment.
    let across = |p: DVec3| (p - ray.origin) - d * (p - ray.origin).dot(d);
    let (from, to) = (across(a), across(b));
    let along = to - from;
    let part = match along.length_squared() {
        0.0 => 0.0,
        squared => (-from.dot(along) / squared).clamp(0.0, 1.0),
    };
    (from + along * part).length()
}

/// Whether a ray passes an edge of a triangle so closely that rounding decides.
fn is_near_edge(ray: &Ray, corners: [DVec3; 3]) -> bool {
    let [a, b, c] = corners;
    let largest = [ray.origin, a, b, c]
        .map(|v| v.abs().max_element())
        .into_iter()
        .fold(0.0, f64::max);
    let limit = NEAR_EDGE * f64::from(f32::EPSILON) * largest;
    [[a, b], [b, c], [c, a]]
        .into_iter()
        .any(|[a, b]| distance(ray, a, b) <= limit)
}

/// The largest distance of a corner from the origin of a ray, in whose units a kernel rounds.
fn farthest(ray: &Ray, corners: [DVec3; 3]) -> f64 {
    corners
        .map(|corner| (corner - ray.origin).length())
        .into_iter()
        .fold(0.0, f64::max)
}

/// Judges an answer.
fn judge(mesh: &Mesh, question: &Question, truth: Option<Hit>, found: Option<Hit>) -> Judgement {
    let Question { ray, interval } = question;
    let normal = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a).normalize()
    };
    let cosine = |triangle: usize| ray.direction.normalize().dot(normal(triangle)).abs().max(1e-9);
    let near = |hit: Hit| is_near_edge(ray, mesh.corners(hit.triangle));
    // A hit at an end of the interval, or along the surface, may count or not. It is at an end if
    // the error that t may have takes it to the other side.
    let is_open = |hit: Hit| {
        let room = ERROR * farthest(ray, mesh.corners(hit.triangle)) / cosine(hit.triangle);
        let is_near = |end: f64| end.is_finite() && end > 0.0 && (hit.t - end).abs() <= room;
        let ends = [interval.min, interval.max].map(is_near);
        ends.contains(&true) || cosine(hit.triangle) < 1e-3
    };
    let excused = |hit: Hit| near(hit) || is_open(hit);
    match (truth, found) {
        (None, None) => Judgement::Right(0.0),
        (Some(truth), None) => match excused(truth) {
            true => Judgement::NearEdge,
            false => Judgement::Hole,
        },
        (truth, Some(found)) => {
            // Whether the point that the answer names is on the ray.
            let [a, b, c] = mesh.corners(found.triangle);
            let [u, v] = found.uv;
            let point = a + u * (b - a) + v * (c - a);
            let off = (point - (ray.origin + found.t * ray.direction)).length();
            let is_on = off * cosine(found.triangle) <= ERROR * farthest(ray, [a, b, c]);
            let error = |truth: Hit| {
                let unit = farthest(ray, mesh.corners(truth.triangle));
                (found.t - truth.t).abs() / unit * cosine(truth.triangle)
            };
            match truth {
                Some(truth) if error(truth) <= ERROR && is_on => Judgement::Right(error(truth)),
                // The surface next to an edge, or another one behind it.
                Some(truth) if found.t > truth.t && is_on => match excused(truth) {
                    true => Judgement::NearEdge,
                    false => Judgement::Hole,
                },
                _ if is_on && excused(found) => Judgement::NearEdge,
                _ => Judgement::WrongHit,
            }
        }
    }
}

/// A problem of the kernel. The driver's messages name what drivers usually are.
fn told(error: &DriverError) -> String {
    error
        .to_string()
        .replace("the driver of the reference", "the kernel")
}

/// Asks a kernel `rays` questions about each mesh, and judges its answers. The meshes are written
/// to `folder`.
///
/// # Errors
/// If the kernel cannot be run, or its answers are no answers to the questions.
pub fn judge_kernel(
    lab: &Lab<'_>,
    command: Command,
    limit: Duration,
    stop: &Stop,
    folder: &Path,
    rays: usize,
    stage: &dyn Fn(&str),
) -> Result<Vec<KernelReport>, String> {
    let mut random = Random::new(33);
    let meshes = [
        Mesh::ball("ball", 4, DVec3::ZERO, 1.0),
        Mesh::ball("far ball", 4, DVec3::new(1000.0, -2000.0, 500.0), 1.0),
        Mesh::grid("grid", 32),
        Mesh::soup("soup", 2000, &mut random),
    ];
    let mut driver = Driver::spawn(command, limit).map_err(|error| told(&error))?;
    driver.set_stop(stop.clone());
    let folder = std::path::absolute(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut reports = Vec::new();
    for mesh in &meshes {
        stage(mesh.name);
        let file = folder.join(format!("{}.obj", mesh.name.replace(' ', "-")));
        std::fs::write(&file, mesh.obj()).map_err(|error| format!("{}: {error}", file.display()))?;
        let scene = format!(
            "accelerator = {{ type = \"bvh2\" }}\n[[shape]]\ntype = \"mesh\"\nfile = {:?}\n",
            file.display().to_string()
        );
        let pipeline = lab.pipeline(&scene)?;
        let nearest = |question: &Question| {
            let hit = (pipeline.scene.accelerator).intersect(
                &question.ray,
                question.interval,
                SelfHitFilter::NOTHING,
            );
            hit.map(|hit| Hit {
                t: hit.t,
                triangle: hit.primitive as usize,
                uv: hit.prim_uv.to_array(),
            })
        };
        (driver.request(&json!({ "op": "load", "mesh": file }))).map_err(|error| told(&error))?;
        let mut report = KernelReport {
            mesh: mesh.name,
            triangles: mesh.triangles.len(),
            ..KernelReport::default()
        };
        // The first half has no limits, then there is an upper, then a lower one.
        for (kind, count) in [(0, rays - rays / 2), (1, rays / 4), (2, rays / 2 - rays / 4)] {
            let mut ask = |batch: &Batch| {
                let start = Instant::now();
                let answer = driver.request(&batch.request);
                let seconds = start.elapsed().as_secs_f64();
                let found = answer.map(|answer| hits(mesh, &answer, batch.questions.len()));
                (found, seconds)
            };
            let mut left = count;
            let mut next = || {
                let size = left.min(BATCH);
                left -= size;
                (size > 0).then(|| Batch::new(mesh, size, kind, &nearest, &mut random))
            };
            let mut open = next();
            // While the kernel works on a batch, the answers to the last one are judged.
            let mut answered: Option<(Batch, Vec<Option<Hit>>)> = None;
            while let Some(batch) = open.take() {
                let judging = || {
                    if let Some((batch, found)) = answered.take() {
                        report.add_all(mesh, &batch, &found);
                    }
                    open = next();
                };
                let ((found, seconds), ()) = rayon::join(|| ask(&batch), judging);
                report.seconds += seconds;
                match found {
                    Err(DriverError::Unsupported(why)) => {
                        report.skipped = Some(why);
                        break;
                    }
                    Err(error) => return Err(told(&error)),
                    Ok(found) => answered = Some((batch, found?)),
                }
            }
            if let Some((batch, found)) = answered {
                report.add_all(mesh, &batch, &found);
            }
        }
        reports.push(report);
    }
    Ok(reports)
}

/// Rays of one request, with the true answers.
struct Batch {
    questions: Vec<Question>,
    truths: Vec<Option<Hit>>,
    request: Value,
}

impl Batch {
    /// Rays at a mesh whose intervals have no limits (0), end near the nearest hit (1) or begin
    /// there (2).
    fn new(
        mesh: &Mesh,
        size: usize,
        kind: u32,
        nearest: &(dyn Fn(&Question) -> Option<Hit> + Sync),
        random: &mut Random,
    ) -> Self {
        // Each ray has numbers of its own, so that threads can share the work.
        let seeds: Vec<u64> = (0..size).map(|_| random.bits()).collect();
        let (questions, truths): (Vec<Question>, _) = seeds
            .into_par_iter()
            .map(|seed| {
                let mut random = Random::new(seed);
                let mut question = Question {
                    ray: mesh.ray(&mut random),
                    interval: Interval::FORWARD,
                };
                let first = nearest(&question);
                if kind == 0 {
                    return (question, first);
                }
                let t = first.map_or(1.0, |hit| hit.t);
                let end = f64::from((t * (0.5 + random.unit())) as f32);
                question.interval = match kind {
                    1 => Interval::up_to(end),
                    _ => Interval {
                        min: end,
                        max: f64::INFINITY,
                    },
                };
                (question, nearest(&question))
            })
            .unzip();
        Self {
            request: request(&questions),
            questions,
            truths,
        }
    }
}

fn request(questions: &[Question]) -> Value {
    let all = |of: &dyn Fn(&Question) -> [f64; 3]| questions.iter().map(of).collect::<Vec<_>>();
    json!({
        "op": "intersect",
        "origins": all(&|question| question.ray.origin.to_array()),
        "directions": all(&|question| question.ray.direction.to_array()),
        "t_min": questions.iter().map(|question| question.interval.min).collect::<Vec<f64>>(),
        "t_max": questions.iter().map(|question| question.interval.max.min(FAR)).collect::<Vec<f64>>(),
    })
}

/// The hits of an answer.
fn hits(mesh: &Mesh, answer: &Value, count: usize) -> Result<Vec<Option<Hit>>, String> {
    let answers = Answers::deserialize(answer)
        .map_err(|error| format!("the kernel gave an invalid answer: {error}"))?;
    let lengths = [
        answers.t.len(),
        answers.primitive.len(),
        answers.u.len(),
        answers.v.len(),
    ];
    if lengths != [count; 4] {
        return Err(format!(
            "the kernel answered {lengths:?} values of t, primitive, u and v to {count} rays"
        ));
    }
    (0..count)
        .map(|index| {
            let number = |values: &[Option<f64>]| values[index].unwrap_or(f64::NAN);
            match usize::try_from(answers.primitive[index]) {
                Err(_) => Ok(None),
                Ok(triangle) if triangle < mesh.triangles.len() => Ok(Some(Hit {
                    t: number(&answers.t),
                    triangle,
                    uv: [number(&answers.u), number(&answers.v)],
                })),
                Ok(triangle) => Err(format!(
                    "the kernel answered the primitive {triangle}; the mesh \"{}\" has {} from 0, and -1 is a miss",
                    mesh.name,
                    mesh.triangles.len()
                )),
            }
        })
        .collect()
}

impl KernelReport {
    /// Adds the answers to a batch.
    fn add_all(&mut self, mesh: &Mesh, batch: &Batch, found: &[Option<Hit>]) {
        let Batch {
            questions, truths, ..
        } = batch;
        let judged: Vec<Judgement> = (questions, truths, found)
            .into_par_iter()
            .map(|(question, truth, found)| judge(mesh, question, *truth, *found))
            .collect();
        for (index, judgement) in judged.into_iter().enumerate() {
            self.add(&questions[index], truths[index], found[index], judgement);
        }
    }

    fn add(&mut self, question: &Question, truth: Option<Hit>, found: Option<Hit>, judgement: Judgement) {
        self.rays += 1;
        self.hits += usize::from(truth.is_some());
        let word = match judgement {
            Judgement::Right(error) => {
                self.largest_error = self.largest_error.max(error);
                return;
            }
            Judgement::NearEdge => {
                self.near_edges += 1;
                return;
            }
            Judgement::Hole => {
                self.holes += 1;
                "a hole"
            }
            Judgement::WrongHit => {
                self.wrong_hits += 1;
                "a wrong hit"
            }
        };
        if self.examples.len() < EXAMPLES {
            let told = |hit: Option<Hit>| {
                hit.map_or("a miss".to_owned(), |hit| {
                    format!(
                        "triangle {} at t = {}, (u, v) = ({}, {})",
                        hit.triangle, hit.t, hit.uv[0], hit.uv[1]
                    )
                })
            };
            let Ray { origin, direction } = question.ray;
            self.examples.push(format!(
                "{word}: origin {:?}, direction {:?}, t from {} to {}: the kernel says {}, the truth is {}",
                origin.to_array(),
                direction.to_array(),
                question.interval.min,
                question.interval.max,
                told(found),
                told(truth)
            ));
        }
    }

    /// Whether all answers are right.
    pub fn is_right(&self) -> bool {
        self.holes + self.wrong_hits == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh() -> Mesh {
        Mesh::joined("one", [[DVec3::ZERO, DVec3::X, DVec3::Y]].into_iter())
    }

    fn down(x: f64, y: f64) -> Question {
        Question {
            ray: Ray::new(DVec3::new(x, y, 1.0), -DVec3::Z),
            interval: Interval::FORWARD,
        }
    }

    fn hit(t: f64, uv: [f64; 2]) -> Option<Hit> {
        Some(Hit { t, triangle: 0, uv })
    }

    #[test]
    fn answers_are_judged() {
        let mesh = mesh();
        let of = |question: Question, truth, found| judge(&mesh, &question, truth, found);
        let inside = down(0.25, 0.25);
        let right = hit(1.0, [0.25; 2]);
        assert_eq!(of(inside, right, right), Judgement::Right(0.0));
        assert_eq!(of(inside, right, None), Judgement::Hole);
        // A wrong distance, wrong coordinates, exchanged ones.
        assert_eq!(of(inside, right, hit(1.0001, [0.25; 2])), Judgement::WrongHit);
        assert_eq!(of(inside, right, hit(1.0, [0.25, 0.3])), Judgement::WrongHit);
        assert_eq!(of(inside, right, hit(f64::NAN, [0.25; 2])), Judgement::WrongHit);
        assert_eq!(
            of(down(0.75, 0.75), None, hit(1.0, [0.75; 2])),
            Judgement::WrongHit
        );
        // Eight units in the last place of 1 are 9.5e-7.
        for (x, expected) in [(9e-7, Judgement::NearEdge), (1.1e-6, Judgement::Hole)] {
            assert_eq!(of(down(x, 0.5), hit(1.0, [x, 0.5]), None), expected, "{x}");
            let outside = of(down(-x, 0.5), None, hit(1.0, [-x, 0.5]));
            assert_eq!(
                outside == Judgement::NearEdge,
                expected == Judgement::NearEdge,
                "{x}"
            );
        }
    }

    /// The error that t may have decides at an end of the interval, too: close to the origin of a
    /// ray it is not relative to t.
    #[test]
    fn ends_of_intervals_are_rounded_like_t() {
        let mesh = mesh();
        let question = |to: f64| Question {
            ray: Ray::new(DVec3::new(0.25, 0.25, 1e-4), -DVec3::Z),
            interval: Interval::up_to(to),
        };
        let found = hit(1e-4, [0.25; 2]);
        // The farthest corner is 0.79 m away, so 7.9e-6 are allowed.
        for (short, expected) in [(7e-6, Judgement::NearEdge), (9e-6, Judgement::WrongHit)] {
            let question = question(1e-4 - short);
            assert_eq!(judge(&mesh, &question, None, found), expected, "{short}");
        }
        for (long, expected) in [(7e-6, Judgement::NearEdge), (9e-6, Judgement::Hole)] {
            let question = question(1e-4 + long);
            assert_eq!(judge(&mesh, &question, found, None), expected, "{long}");
        }
    }

    #[test]
    fn meshes_are_exact_in_single_precision() {
        let mut random = Random::new(1);
        for mesh in [
            Mesh::ball("ball", 3, DVec3::new(1000.0, -2000.0, 500.0), 1.0),
            Mesh::soup("soup", 200, &mut random),
            Mesh::grid("grid", 32),
        ] {
            assert!(mesh.vertices.iter().all(|&v| v == single(v)), "{}", mesh.name);
        }
        // Closed: each edge is used once in each direction.
        let ball = Mesh::ball("ball", 2, DVec3::ZERO, 1.0);
        let edges = ball
            .triangles
            .iter()
            .flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)]);
        let edges: std::collections::BTreeSet<_> = edges.collect();
        assert_eq!(edges.len(), 3 * ball.triangles.len());
        assert!(edges.iter().all(|(a, b)| edges.contains(&(*b, *a))));
    }
}
