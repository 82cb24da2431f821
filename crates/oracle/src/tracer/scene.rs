//! The shapes of a scene with their materials, and the first hit of a ray.

use super::coincident::{Meeting, Standing};
use super::footprint::{Differential, Footprint, NEAR, Sides, slope};
use super::mapping::Place;
use super::material::{At, Material, bodies};
use super::place::{Attributes, Coordinates, Corner};
use super::{Unsure, unknown_part};
use crate::interval::{Decided, Undecided};
use crate::root::Root;
use crate::shapes::instance::Config as Copies;
use crate::shapes::{self, Placed, Surface};
use crate::vector::Line;
use crate::{FIRST_BITS, MAX_BITS};
use serde::Deserialize;
use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering as MemoryOrdering};
use std::time::{Duration, Instant};
use whitstone_core::config::{PluginRef, decode};
use whitstone_core::{DAffine3, DMat3, DVec2, DVec3, MaterialRef, Ray, SceneErrors};
use whitstone_scene::{Description, ShapeTable};

/// A root of the surface that a ray leaves counts as the start itself if it is this close to it,
/// relative to the coordinates.
const LEFT: f64 = 1e-11;

/// A surface contains a point if it is at most this many units in the last place away.
const AT: f64 = 64.0;

/// One instance of a shape.
struct Part {
    placed: Placed,
    /// From object space to the space of the group, and on to world space.
    maps: Vec<DAffine3>,
    /// The normal matrix of each map.
    normals: Vec<DMat3>,
    coordinates: Coordinates,
    continues: Continues,
    material: Material,
    casts_shadow: bool,
    standing: Standing,
}

/// How a surface extends next to a point, for derivatives.
#[derive(Clone, Copy, PartialEq)]
enum Continues {
    /// Flat: the formulas of its coordinates hold in the whole plane. `angle` tells whether one of
    /// them is an angle.
    Flat { angle: bool },
    /// At the intersection with a line across the surface.
    Curved,
    /// Unknown: it counts as flat, with constant coordinates.
    Untold,
}

impl Continues {
    fn of(name: &str) -> Self {
        match name {
            "disk" => Self::Flat { angle: true },
            "plane" | "rectangle" | "box" | "triangle" | "mesh" | "heightfield" | "polygon" => {
                Self::Flat { angle: false }
            }
            "fractal" | "isosurface" => Self::Untold,
            _ => Self::Curved,
        }
    }
}

/// All shapes of the scene.
pub(super) struct Scene {
    parts: Vec<Part>,
    /// Whether light passes through anything, even with opaque shadows.
    pub(super) has_holes: bool,
    /// The longest time of a ray so far, in nanoseconds.
    slowest: AtomicU64,
}

/// The first hit of a ray.
pub(super) struct Hit {
    pub(super) shape: usize,
    pub(super) primitive: u32,
    pub(super) t: f64,
    /// The double vector nearest to the intersection.
    pub(super) point: DVec3,
    /// The geometric normal, of unit length.
    pub(super) normal: DVec3,
    parameters: Option<[f64; 2]>,
}

/// Largest supported number of quads of a height field: every ray tests all of them.
const MAX_QUADS: u64 = 1 << 16;

/// Largest supported number of shape instances: every ray tests all of them.
const MAX_PARTS: usize = 4096;

/// The resolution of a height field.
#[derive(Deserialize)]
struct Grid {
    columns: Option<u64>,
    rows: Option<u64>,
}

/// Rejects shapes that would take too long.
fn check(shape: &ShapeTable<'_>) -> Result<(), SceneErrors> {
    let plugin = &shape.plugin;
    if plugin.name == "heightfield" {
        let Grid { columns, rows } = decode(&plugin.table)?;
        if columns.unwrap_or(64).saturating_mul(rows.unwrap_or(64)) > MAX_QUADS {
            return Err(unknown_part(plugin, "a height field of this resolution"));
        }
    }
    Ok(())
}

impl Scene {
    pub(super) fn new(description: &Description<'_>) -> Result<Self, SceneErrors> {
        let mut parts = Vec::new();
        for (number, (shape, face)) in description
            .shapes
            .iter()
            .zip(bodies::faces(description)?)
            .enumerate()
        {
            place(description, shape, &Around::default(), &[number], &mut parts)?;
            // A prioritised dielectric is never a group.
            if let (Some(face), Some(part)) = (face, parts.last_mut()) {
                part.material = Material::of_body(face);
            }
        }
        Standing::join(parts.iter_mut().map(|part| &mut part.standing).collect());
        let has_holes = |part: &Part| part.material.has_masks() || !part.casts_shadow;
        Ok(Self {
            has_holes: parts.iter().any(has_holes),
            parts,
            slowest: AtomicU64::new(0),
        })
    }

    /// The longest time that a ray has taken so far.
    pub(super) fn slowest(&self) -> Duration {
        Duration::from_nanos(self.slowest.load(MemoryOrdering::Relaxed))
    }

    /// Attempts an answer with more and more bits.
    fn decide<T>(&self, attempt: impl Fn(usize) -> Decided<T>) -> Result<T, Unsure> {
        let begin = Instant::now();
        let mut bits = FIRST_BITS;
        let answer = loop {
            match attempt(bits) {
                Ok(answer) => break Ok(answer),
                Err(Undecided) if bits >= MAX_BITS => break Err(Unsure::Touch),
                Err(Undecided) => bits *= 2,
            }
        };
        let nanoseconds = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.slowest.fetch_max(nanoseconds, MemoryOrdering::Relaxed);
        answer
    }

    /// Whether light is stopped or attenuated where this shape was hit.
    pub(super) fn casts_shadow(&self, hit: &Hit) -> bool {
        self.parts[hit.shape].casts_shadow
    }

    /// The nearest hit with 0 < t < end; `from` is the primitive that the ray starts on.
    pub(super) fn nearest(
        &self,
        ray: &Ray,
        from: Option<(usize, u32)>,
        end: f64,
    ) -> Result<Option<Hit>, Unsure> {
        self.decide(|bits| self.attempt(ray, from, end, bits))
    }

    /// All hits in ascending order, as for [`Self::nearest`].
    pub(super) fn all(&self, ray: &Ray, from: Option<(usize, u32)>, end: f64) -> Result<Vec<Hit>, Unsure> {
        self.decide(|bits| self.attempt_all(ray, from, end, bits))
    }

    /// All hits, each with the number of its part.
    fn ahead(
        &self,
        line: &Line,
        ray: &Ray,
        from: Option<(usize, u32)>,
        end: f64,
    ) -> Decided<Vec<(usize, Root)>> {
        let mut met = Vec::new();
        for (number, part) in self.parts.iter().enumerate() {
            let roots = part.placed.meet(line)?.all;
            met.extend(roots.into_iter().map(|root| (number, root)));
        }
        let zero = line.number(0.0);
        let last = end.is_finite().then(|| line.number(end));
        let near = LEFT * (1.0 + ray.origin.abs().max_element());
        let is_left = |(number, root): &(usize, Root)| {
            from == Some((*number, root.primitive)) && root.t.nearest().abs() <= near
        };
        let distance = |(_, root): &(usize, Root)| root.t.nearest().abs();
        let left = met.iter().filter(|one| is_left(one));
        let left = left.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let at_light = self.at_light(&met, line, ray, end)?;
        let mut found = Vec::new();
        for (place, one) in met.iter().enumerate() {
            let t = &one.1.t;
            if is_left(one) || at_light.contains(&place) {
                continue;
            }
            // A surface that coincides with the one that the ray leaves is ordered by the rule of
            // the model, regardless of the rounding of the origin.
            let order = match left {
                Some(left) => self.meeting(left).order(self.meeting(one), line)?,
                None if from.is_some() && self.is_at(one, ray, 0.0) => return Err(Undecided),
                None => None,
            };
            if order.map_or_else(|| zero.compare(t), Ok)? != Ordering::Less {
                continue;
            }
            if let Some(last) = &last
                && t.compare(last)? != Ordering::Less
            {
                continue;
            }
            found.push(one.clone());
        }
        found.sort_by(|(_, a), (_, b)| a.t.nearest().total_cmp(&b.t.nearest()));
        Ok(found)
    }

    fn meeting<'a>(&'a self, (number, root): &'a (usize, Root)) -> Meeting<'a> {
        Meeting {
            of: &self.parts[*number].standing,
            root,
        }
    }

    /// Whether the surface contains the point of the ray at `t`, up to rounding.
    fn is_at(&self, (_, root): &(usize, Root), ray: &Ray, t: f64) -> bool {
        let size = ray.origin.abs().max_element() + t;
        let across = root.normal.normalize().dot(ray.direction) * (root.t.nearest() - t);
        across.abs() <= AT * f64::EPSILON * size
    }

    /// Indices of the roots on coincident surfaces that contain the light at `end`.
    fn at_light(&self, met: &[(usize, Root)], line: &Line, ray: &Ray, end: f64) -> Decided<BTreeSet<usize>> {
        let mut found = BTreeSet::new();
        if !end.is_finite() {
            return Ok(found);
        }
        let near = met
            .iter()
            .enumerate()
            .filter(|(_, one)| self.is_at(one, ray, end));
        let near: Vec<_> = near.collect();
        for (number, (place, one)) in near.iter().enumerate() {
            for (other_place, other) in &near[number + 1..] {
                if self.meeting(one).order(self.meeting(other), line)?.is_some() {
                    found.extend([*place, *other_place]);
                }
            }
        }
        Ok(found)
    }

    /// The order of two roots. Two primitives of one shape that share an edge count as equal there.
    fn order(&self, one: &(usize, Root), other: &(usize, Root), line: &Line) -> Decided<Ordering> {
        if let Some(order) = self.meeting(one).order(self.meeting(other), line)? {
            return Ok(order);
        }
        match one.1.t.compare(&other.1.t) {
            Err(Undecided) if one.0 == other.0 && line.bits() >= MAX_BITS => Ok(Ordering::Equal),
            order => order,
        }
    }

    fn attempt(&self, ray: &Ray, from: Option<(usize, u32)>, end: f64, bits: usize) -> Decided<Option<Hit>> {
        let line = Line::of(ray, bits)?;
        let mut first: Option<(usize, Root)> = None;
        for (number, root) in self.ahead(&line, ray, from, end)? {
            let nearer = match &first {
                None => true,
                Some(first) => self.order(&(number, root.clone()), first, &line)? == Ordering::Less,
            };
            if nearer {
                first = Some((number, root));
            }
        }
        first.map(|(shape, root)| hit(shape, &root, &line)).transpose()
    }

    fn attempt_all(&self, ray: &Ray, from: Option<(usize, u32)>, end: f64, bits: usize) -> Decided<Vec<Hit>> {
        let line = Line::of(ray, bits)?;
        let mut sorted: Vec<(usize, Root)> = Vec::new();
        'roots: for (number, root) in self.ahead(&line, ray, from, end)? {
            for place in 0..sorted.len() {
                match self.order(&(number, root.clone()), &sorted[place], &line)? {
                    Ordering::Less => {
                        sorted.insert(place, (number, root));
                        continue 'roots;
                    }
                    Ordering::Equal => continue 'roots,
                    Ordering::Greater => {}
                }
            }
            sorted.push((number, root));
        }
        sorted
            .iter()
            .map(|(shape, root)| hit(*shape, root, &line))
            .collect()
    }

    /// The material of a hit, seen from the direction `viewer`; `nudge` as in [`Place`].
    pub(super) fn material(&self, hit: &Hit, viewer: DVec3, nudge: f64) -> At<'_> {
        let part = &self.parts[hit.shape];
        let p = part.object(hit.point);
        let interpolated = part.coordinates.normal(p, hit.primitive, &part.normals[0]);
        let attributes = part.coordinates.attributes(p, hit.primitive);
        let mut place = Place {
            uv: part.coordinates.uv(p, hit.primitive, hit.parameters),
            p: hit.point,
            n_s: interpolated.map_or(hit.normal, |n| part.outwards(n)),
            second: attributes.second,
            color: attributes.color,
            tangent: part.tangent(&attributes),
            gradients: [DVec3::ZERO; 2],
            footprint: Footprint::default(),
            nudge,
        };
        if part.material.has_heights() {
            place.gradients = part.gradients(hit, &place);
        }
        part.material.at(place, hit.normal, viewer)
    }

    /// The same with the footprint of the ray.
    pub(super) fn material_over(
        &self,
        hit: &Hit,
        ray: &Ray,
        differential: &Differential,
        nudge: f64,
    ) -> At<'_> {
        let part = &self.parts[hit.shape];
        let mut place = *self.material(hit, -ray.direction, nudge).place();
        let p = differential.steps(ray, hit.t, hit.normal);
        let moved = p.map(|step| part.change(hit, &place, step));
        place.footprint = Footprint {
            p,
            uv: moved.map(|(uv, _)| uv),
            n_s: moved.map(|(_, n_s)| n_s),
        };
        part.material.at(place, hit.normal, -ray.direction)
    }

    /// The vertices of the triangle that was hit: barycentric coordinate, position, and the
    /// material seen from `eye`. Empty for shapes without triangles.
    pub(super) fn corners(&self, hit: &Hit, eye: DVec3, nudge: f64) -> Vec<(f64, DVec3, At<'_>)> {
        let part = &self.parts[hit.shape];
        let p = part.object(hit.point);
        let corners = part.coordinates.corners(p, hit.primitive, &part.normals[0]);
        // They are the same on all of a triangle.
        let gradients = self.material(hit, eye, nudge).place().gradients;
        let seen = |corner: Corner| {
            let p = part.maps.iter().fold(corner.p, |p, map| map.transform_point3(p));
            let place = Place {
                uv: corner.uv,
                p,
                n_s: corner.normal.map_or(hit.normal, |n| part.outwards(n)),
                second: corner.attributes.second,
                color: corner.attributes.color,
                tangent: part.tangent(&corner.attributes),
                gradients,
                footprint: Footprint::default(),
                nudge,
            };
            let viewer = (eye - p).normalize();
            (corner.weight, p, part.material.at(place, hit.normal, viewer))
        };
        corners.into_iter().map(seen).collect()
    }
}

impl Part {
    /// The mesh tangent in world space, and the sign of the bitangent.
    fn tangent(&self, attributes: &Attributes) -> Option<(DVec3, f64)> {
        let (along, sign) = attributes.tangent?;
        let placed = self.maps.iter().fold((along, sign), |(along, sign), map| {
            let mirrors = map.matrix3.determinant() < 0.0;
            (map.matrix3 * along, if mirrors { -sign } else { sign })
        });
        Some(placed)
    }

    /// The derivatives of (u, v) and n_s along a step in the tangent plane.
    fn change(&self, hit: &Hit, here: &Place, step: DVec3) -> (DVec2, DVec3) {
        let length = step.length();
        if self.continues == Continues::Untold || !length.is_normal() {
            return Default::default();
        }
        let away = NEAR * hit.t.max(hit.point.abs().max_element());
        let sides: Sides<_> = [-away, away].map(|away| {
            let (uv, n_s) = self.surface_at_offset(hit, hit.point + step * (away / length))?;
            let mut change = uv - here.uv;
            if self.continues != (Continues::Flat { angle: false }) {
                // Unwraps angles across the seam.
                change -= change.round();
            }
            Some((here.uv + change, n_s * n_s.dot(here.n_s).signum()))
        });
        let [uv_before, uv_after] = sides.map(|side| side.map(|(uv, _)| uv));
        let [n_before, n_after] = sides.map(|side| side.map(|(_, n_s)| n_s));
        (
            slope(uv_before, here.uv, uv_after, away) * length,
            slope(n_before, here.n_s, n_after, away) * length,
        )
    }

    /// The gradients of u and v: their changes along two unit vectors across the normal.
    fn gradients(&self, hit: &Hit, here: &Place) -> [DVec3; 2] {
        let (e, f) = hit.normal.any_orthonormal_pair();
        let [along_e, along_f] = [e, f].map(|along| self.change(hit, here, along).0);
        [along_e.x * e + along_f.x * f, along_e.y * e + along_f.y * f]
    }

    /// (u, v) and n_s of the primitive that was hit, at the point of the surface nearest `q` along
    /// the normal. The primitive is extrapolated past its edges.
    fn surface_at_offset(&self, hit: &Hit, q: DVec3) -> Option<(DVec2, DVec3)> {
        let (point, normal, parameters) = match self.continues {
            Continues::Curved => {
                let line = Line::of(
                    &Ray {
                        origin: q,
                        direction: hit.normal,
                    },
                    FIRST_BITS,
                )
                .ok()?;
                let roots = self.placed.meet(&line).ok()?.all;
                let same = roots.iter().filter(|root| root.primitive == hit.primitive);
                let nearest = same.min_by(|a, b| a.t.nearest().abs().total_cmp(&b.t.nearest().abs()))?;
                (
                    line.at(&nearest.t).nearest(),
                    nearest.normal.normalize(),
                    nearest.parameters,
                )
            }
            _ => (q, hit.normal, None),
        };
        let p = self.object(point);
        let interpolated = self.coordinates.normal(p, hit.primitive, &self.normals[0]);
        Some((
            self.coordinates.uv(p, hit.primitive, parameters),
            interpolated.map_or(normal, |n| self.outwards(n)),
        ))
    }

    /// Maps a point from world space to object space.
    fn object(&self, p: DVec3) -> DVec3 {
        let inwards = self.maps.iter().rev();
        inwards.fold(p, |p, map| map.inverse().transform_point3(p))
    }

    /// Maps an interpolated normal from the space around the shape to world space.
    fn outwards(&self, n: DVec3) -> DVec3 {
        let outer = self.normals[1..].iter();
        outer.fold(n.normalize(), |n, map| (*map * n).normalize())
    }
}

/// The instances that enclose a shape, the innermost first.
#[derive(Clone, Default)]
struct Around {
    maps: Vec<DAffine3>,
    /// The materials that they replace.
    replaced: Vec<BTreeMap<String, MaterialRef>>,
    /// Whether one of them takes the shadows of its shapes.
    without_shadow: bool,
}

impl Around {
    /// The material that is seen of a shape.
    fn shown<'a>(&'a self, shape: &'a ShapeTable<'_>) -> Option<&'a PluginRef> {
        let mut material = &shape.material.as_ref()?.1;
        for replaced in &self.replaced {
            if let PluginRef::Shared(id) = material
                && let Some(by) = replaced.get(id)
            {
                material = &by.material;
            }
        }
        Some(material)
    }
}

/// Adds the parts of a shape, which are several for an instance. `path` is its position in the
/// lists.
fn place(
    description: &Description<'_>,
    shape: &ShapeTable<'_>,
    around: &Around,
    path: &[usize],
    parts: &mut Vec<Part>,
) -> Result<(), SceneErrors> {
    check(shape)?;
    let own = *shape.transform.world_from_object();
    let maps = [&[own], &*around.maps].concat();
    let without_shadow = around.without_shadow || !shape.casts_shadow;
    if shape.plugin.name == "instance" {
        let copies: Copies = decode(&shape.plugin.table)?;
        let group = description.groups.get(&copies.group.id);
        let mut inside = Around {
            maps,
            replaced: vec![copies.materials],
            without_shadow,
        };
        inside.replaced.extend_from_slice(&around.replaced);
        for (number, inner) in group.into_iter().flat_map(|group| &group.shapes).enumerate() {
            place(description, inner, &inside, &[path, &[number]].concat(), parts)?;
        }
        return Ok(());
    }
    if parts.len() >= MAX_PARTS {
        return Err(unknown_part(&shape.plugin, "this many shapes"));
    }
    let coordinates = Coordinates::new(description, &shape.plugin)?;
    let mut placed = Placed {
        surface: shapes::surface(description, &shape.plugin)?,
        map: own,
    };
    for map in &around.maps {
        placed = Placed {
            surface: Box::new(placed),
            map: *map,
        };
    }
    let whole = maps.iter().fold(DAffine3::IDENTITY, |whole, map| *map * whole);
    let triangles = coordinates.triangles();
    parts.push(Part {
        standing: Standing::new(description, &shape.plugin, path.to_vec(), &whole, triangles)?,
        placed,
        normals: maps.iter().map(|map| map.matrix3.inverse().transpose()).collect(),
        maps,
        material: Material::of_shape(description, around.shown(shape))?,
        casts_shadow: !without_shadow,
        continues: Continues::of(&shape.plugin.name),
        coordinates,
    });
    Ok(())
}

fn hit(shape: usize, root: &Root, line: &Line) -> Decided<Hit> {
    if !root.t.is_narrow() {
        return Err(Undecided);
    }
    Ok(Hit {
        shape,
        primitive: root.primitive,
        t: root.t.nearest(),
        point: line.at(&root.t).nearest(),
        normal: root.normal.normalize(),
        parameters: root.parameters,
    })
}
