//! Intersections of a line with each shape of the model (section 9), one file per shape.

pub(crate) mod cone;
mod conic;
pub(crate) mod csg;
pub(crate) mod cuboid;
pub(crate) mod cylinder;
pub(crate) mod disk;
pub(crate) mod ellipsoid;
pub(crate) mod heightfield;
pub(crate) mod hyperboloid;
pub(crate) mod instance;
pub(crate) mod lathe;
pub(crate) mod level;
pub(crate) mod mesh;
pub(crate) mod paraboloid;
pub(crate) mod patch;
pub(crate) mod plane;
pub(crate) mod polygon;
pub(crate) mod prism;
pub(crate) mod quadric;
pub(crate) mod rectangle;
pub(crate) mod sphere;
pub(crate) mod torus;
pub(crate) mod triangle;

use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use whitstone_core::config::{Table, decode};
use whitstone_core::{DAffine3, DVec3, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable};

/// The types of shapes that the oracle supports.
pub(crate) const KNOWN: [&str; 24] = [
    "box",
    "cone",
    "csg",
    "cylinder",
    "disk",
    "ellipsoid",
    "fractal",
    "heightfield",
    "hyperboloid",
    "implicit",
    "instance",
    "isosurface",
    "lathe",
    "mesh",
    "paraboloid",
    "patch",
    "plane",
    "polygon",
    "prism",
    "quadric",
    "rectangle",
    "sphere",
    "torus",
    "triangle",
];

/// A shape in its object space.
pub(crate) trait Surface: Send + Sync {
    /// All intersections with a line.
    fn meet(&self, line: &Line) -> Decided<Roots>;

    /// At least the first intersection beyond the parameter `from`; others may be left out.
    fn meet_beyond(&self, line: &Line, from: f64) -> Decided<Roots> {
        let _ = from;
        self.meet(line)
    }

    /// Centre and radius of a bounding sphere, in double precision. `None` if the shape is
    /// unbounded or has no simple bound.
    fn ball(&self) -> Option<(DVec3, f64)> {
        None
    }
}

/// Whether a line certainly misses a sphere, by much more than the rounding error of these few
/// operations. `size` bounds the numbers that the sphere was computed from.
pub(crate) fn passes_by((center, radius): (DVec3, f64), size: f64, o: DVec3, d: DVec3) -> bool {
    let across = (center - o).cross(d).length();
    let rounding = 1e-9 * (size + o.length()) * d.length();
    across > 1.000_001 * radius * d.length() + rounding
}

/// A shape with its transform.
pub(crate) struct Placed {
    pub(crate) surface: Box<dyn Surface>,
    pub(crate) map: DAffine3,
}

impl Surface for Placed {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        self.placed(line, |surface, inside| surface.meet(inside))
    }

    fn meet_beyond(&self, line: &Line, from: f64) -> Decided<Roots> {
        self.placed(line, |surface, inside| surface.meet_beyond(inside, from))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        let (center, radius) = self.surface.ball()?;
        let matrix = self.map.matrix3;
        // No direction is stretched by more than the root of the sum of all squares.
        let stretch = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec3::length_squared);
        let stretch = stretch.iter().sum::<f64>().sqrt();
        Some((self.map.transform_point3(center), radius * stretch))
    }
}

impl Placed {
    /// Intersections with a line, which `meet` finds in object space.
    fn placed(&self, line: &Line, meet: impl Fn(&dyn Surface, &Line) -> Decided<Roots>) -> Decided<Roots> {
        if let Some((center, radius)) = self.ball()
            && passes_by(
                (center, radius),
                self.map.translation.length() + center.length() + radius,
                line.origin.nearest(),
                line.direction.nearest(),
            )
        {
            return Ok(Roots::default());
        }
        let inside = line.inside(&self.map)?;
        let mut roots = meet(&*self.surface, &inside)?;
        let placed = roots.all.drain(..).map(|root| root.placed(&self.map, &inside));
        roots.all = placed.collect();
        Ok(roots)
    }
}

/// The shape that a table describes.
pub(crate) fn surface(
    description: &Description<'_>,
    plugin: &PluginTable<'_>,
) -> Result<Box<dyn Surface>, SceneErrors> {
    let table: &Table<'_> = &plugin.table;
    Ok(match plugin.name.as_str() {
        "box" => Box::new(decode::<cuboid::Cuboid>(table)?),
        "cone" => Box::new(decode::<cone::Cone>(table)?),
        "csg" => Box::new(csg::Csg::new(description, &decode(table)?)?),
        "cylinder" => Box::new(decode::<cylinder::Cylinder>(table)?),
        "disk" => Box::new(decode::<disk::Disk>(table)?),
        "ellipsoid" => Box::new(decode::<ellipsoid::Ellipsoid>(table)?),
        "heightfield" => Box::new(decode::<heightfield::Heightfield>(table)?.triangles(description)?),
        "fractal" => Box::new(decode::<level::fractal::Fractal>(table)?.shape()),
        "hyperboloid" => Box::new(decode::<hyperboloid::Hyperboloid>(table)?),
        "implicit" => Box::new(decode::<level::implicit::Implicit>(table)?.shape()),
        "isosurface" => Box::new(decode::<level::isosurface::Config>(table)?.read(description)?),
        "instance" => Box::new(instance::Instance::new(description, &decode(table)?)?),
        "lathe" => Box::new(decode::<lathe::Lathe>(table)?),
        "mesh" => Box::new(triangle::Triangles(
            mesh::read(description, &decode(table)?)?.triangles,
        )),
        "paraboloid" => Box::new(decode::<paraboloid::Paraboloid>(table)?),
        "patch" => Box::new(decode::<patch::Patches>(table)?.read()?),
        "plane" => Box::new(decode::<plane::Plane>(table)?),
        "polygon" => Box::new(decode::<polygon::Polygon>(table)?),
        "prism" => Box::new(decode::<prism::Prism>(table)?),
        "quadric" => Box::new(decode::<quadric::Quadric>(table)?),
        "rectangle" => Box::new(decode::<rectangle::Rectangle>(table)?),
        "sphere" => Box::new(decode::<sphere::Sphere>(table)?),
        "torus" => Box::new(decode::<torus::Torus>(table)?),
        "triangle" => Box::new(decode::<triangle::Triangle>(table)?),
        other => {
            let message = format!("the oracle does not support the shape \"{other}\"");
            return Err(SceneError::at(plugin.name_span.clone(), message).into());
        }
    })
}

fn yes() -> bool {
    true
}
