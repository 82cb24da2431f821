//! Rasterization: projects each triangle to the image and keeps the nearest one per sample in a
//! depth buffer; shading is that of ray casting, unless `interpolation = "gouraud"`.
//!
//! Catmull, *A subdivision algorithm for computer display of curved surfaces*, 1974 (the depth
//! buffer); Pineda, *A parallel algorithm for polygon rasterization*, 1988 (edge functions); Olano
//! and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, 1997 (edge functions
//! without the perspective division); Gouraud, *Continuous shading of curved surfaces*, 1971; Blinn
//! and Newell, *Clipping using homogeneous coordinates*, 1978. The steps are those of the lecture
//! notes, in order: `project`, `Bins`, `Depths::draw`, and `Depths::hits` with shading.
//!
//! - Twin: the Mitsuba driver at depth 0, without branches: the visible surfaces are the same.
//! - Example: `scenes/integrators/rasterizer.toml`.

mod bins;
mod fill;
mod gouraud;

use crate::rules::{Rules, zero};
use bins::Bins;
use fill::{Depths, Projected, project};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use whitstone_core::config::NonNegative;
use whitstone_core::stream::{Colors, HitStream, Lanes, RayStream};
use whitstone_core::{
    Context, DMat4, DVec2, DVec3, DVec4, DirectLighting, Integrator, Integrators, Interval, LoweredShape,
    ObjectOrder, Plugin, Ray, Refused, Rgb, Scene, SceneError, SceneErrors, Scratch, SelfHitFilter,
    ShadowMode, View,
};

/// Rasterization of triangles with a depth buffer, local illumination and shadows.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "opaque": surfaces block light, except in the holes of the material `mask` and on shapes
    /// with `casts_shadow = false`; "filtered": transparent surfaces also let light pass straight
    /// through, attenuated; "none": no shadows.
    #[serde(default)]
    shadows: ShadowMode,
    /// A light sample (a light, or a point of an area light) does not count where its irradiance is
    /// below this in every channel, in W/m².
    #[serde(default = "zero")]
    light_cutoff: NonNegative,
    /// Interpolation over a triangle: "phong" interpolates normals; "gouraud" interpolates colours,
    /// which are computed at the vertices, with shadow rays from there.
    #[serde(default)]
    interpolation: Interpolation,
}

/// The quantity that is interpolated over a triangle.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Interpolation {
    /// Normals; each sample is shaded.
    #[default]
    Phong,
    /// Colours; vertices are shaded.
    Gouraud,
}

/// The `rasterizer` integrator; see the module documentation.
#[derive(Clone, Copy)]
pub struct Rasterizer {
    lighting: DirectLighting,
    interpolation: Interpolation,
}

impl Rasterizer {
    /// The rules of tracing: local illumination at the nearest hit, without branches.
    fn rules(&self) -> Rules {
        Rules {
            lighting: self.lighting,
            branches: None,
        }
    }

    /// Radiance along rays whose nearest hits are given; overwrites `hits`.
    fn shade(
        &self,
        scene: &Scene,
        rays: &RayStream,
        hits: &mut Box<HitStream>,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        match self.interpolation {
            Interpolation::Phong => self.rules().shade_stream(scene, rays, hits, scratch, out),
            Interpolation::Gouraud => {
                for lane in 0..rays.len {
                    out.set(
                        lane,
                        gouraud::radiance(self.lighting, scene, &rays.ray(lane), hits.get(lane), scratch),
                    );
                }
            }
        }
    }
}

impl Plugin<Integrators> for Rasterizer {
    const TYPE: &'static str = "rasterizer";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            lighting: DirectLighting {
                shadows: config.shadows,
                light_cutoff: config.light_cutoff.get(),
            },
            interpolation: config.interpolation,
        }))
    }
}

impl Integrator for Rasterizer {
    fn follows_branches(&self) -> bool {
        false
    }

    /// Interpolated colours have no paths of their own.
    fn splits_paths(&self) -> bool {
        self.interpolation == Interpolation::Phong
    }

    /// Uses ray casting: projecting all triangles does not pay off for a single ray.
    fn radiance(&self, scene: &Scene, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        match self.interpolation {
            Interpolation::Phong => self.rules().radiance(scene, ray, scratch),
            Interpolation::Gouraud => {
                scratch.counters.closest += 1;
                let hit = scene
                    .accelerator
                    .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
                gouraud::radiance(self.lighting, scene, ray, hit, scratch)
            }
        }
    }

    fn radiance_stream(&self, scene: &Scene, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        let mut hits = Box::<HitStream>::default();
        scratch.counters.closest += rays.len as u64;
        scene.accelerator.intersect_stream(rays, &mut hits);
        self.shade(scene, rays, &mut hits, scratch, out);
    }

    fn object_order(
        &self,
        view: &View<'_>,
        context: &mut dyn Context,
    ) -> Result<Option<Box<dyn ObjectOrder>>, Refused> {
        let refuse = |shape, message: &str, help: &str| Refused {
            shape,
            error: SceneError::anywhere(message).with_help(help),
        };
        if view.camera.lens_points() != 1 {
            let help = "set lens_samples = 1, or use the camera \"perspective\" or the integrator \"appel\"";
            return Err(refuse(
                None,
                "a lens with several points has no single projection",
                help,
            ));
        }
        let to_image = view.camera.projection().ok_or_else(|| {
            let help = "use the camera \"perspective\" or \"orthographic\", or the integrator \"appel\"";
            refuse(
                None,
                "the camera does not project straight lines to straight lines",
                help,
            )
        })?;
        let parallel = to_image.row(3).truncate() == DVec3::ZERO;
        let near = view.camera.near(DVec2::ZERO);
        if !parallel && near < 0.0 {
            let help = "use `near` >= 0, or the integrator \"appel\"";
            let message = "surfaces behind a perspective camera cannot be projected to its image";
            return Err(refuse(None, message, help));
        }
        if self.interpolation == Interpolation::Gouraud {
            // Vertex colours are computed for one viewer position, the origin of all camera rays.
            let limited = near != 0.0;
            if parallel || limited {
                let help = "use the camera \"perspective\" without `near`, or interpolation = \"phong\"";
                let message = "interpolated colours need camera rays that start at one point";
                return Err(refuse(None, message, help));
            }
        }
        let (mut vertices, mut triangles) = (0, 0);
        for (shape, number) in view.geometry.shapes().iter().zip(0..) {
            let LoweredShape::Triangles(mesh) = shape else {
                let help = "use a mesh, or the integrator \"appel\", which renders by ray casting: the same image, except with interpolation = \"gouraud\"";
                return Err(refuse(Some(number), "only triangles can be rasterized", help));
            };
            vertices += mesh.positions.len();
            triangles += mesh.triangles.len();
        }
        let bytes = vertices * size_of::<DVec4>() + triangles * Bins::BYTES_A_TRIANGLE;
        context.reserve(bytes as u64).map_err(|mut errors| Refused {
            shape: None,
            error: errors
                .0
                .pop()
                .unwrap_or_else(|| SceneError::anywhere("too little memory")),
        })?;
        let projected = project(view.geometry, &to_image);
        let bins = Bins::new(view.geometry, &projected, view.film);
        Ok(Some(Box::new(Frame {
            rasterizer: *self,
            to_image,
            projected,
            bins,
            film: DVec2::new(f64::from(view.film.width), f64::from(view.film.height)),
        })))
    }
}

/// All triangles of the scene, projected to the image.
struct Frame {
    rasterizer: Rasterizer,
    to_image: DMat4,
    projected: Projected,
    bins: Bins,
    film: DVec2,
}

impl ObjectOrder for Frame {
    fn radiance_stream(
        &self,
        scene: &Scene,
        raster: &Lanes<DVec2>,
        rays: &RayStream,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        let mut depths = Depths::new(raster, rays, &self.to_image);
        let (low, high) = depths.bounds();
        for names in self.bins.around(low, high) {
            depths.draw(scene.geometry.shapes(), &self.projected, self.film, names);
        }
        let mut hits = depths.hits(&scene.geometry, rays);
        self.rasterizer.shade(scene, rays, &mut hits, scratch, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Camera, FilmSize, Geometry, TriangleMesh};
    use whitstone_testkit::{TestContext, Wall, build, floor, integrator_laws};

    #[test]
    fn laws() {
        for (text, shadows) in [
            ("", true),
            ("shadows = \"none\"", false),
            ("interpolation = \"gouraud\"", true),
            ("shadows = \"none\"\ninterpolation = \"gouraud\"", false),
        ] {
            integrator_laws(&*build::<Integrators, Rasterizer>(text, ()).unwrap(), shadows);
        }
    }

    /// A camera with a given projection, if any, and number of lens points.
    struct Eye(Option<DMat4>, u32);

    impl Camera for Eye {
        fn ray(&self, raster: DVec2) -> Ray {
            Ray::new(raster.extend(0.0), DVec3::Z)
        }

        fn lens_points(&self) -> u32 {
            self.1
        }

        fn projection(&self) -> Option<DMat4> {
            self.0
        }
    }

    #[test]
    fn what_cannot_be_projected_is_refused() {
        let integrator = build::<Integrators, Rasterizer>("", ()).unwrap();
        let mesh = || LoweredShape::Triangles(TriangleMesh::default());
        let wall: Wall = floor(0.0);
        let film = FilmSize { width: 4, height: 4 };
        let refused = |shapes: Vec<LoweredShape>, eye: &Eye| {
            let view = View {
                geometry: &Geometry::new(shapes),
                camera: eye,
                film,
            };
            let found = integrator.object_order(&view, &mut TestContext::default());
            found.err().map(|refused| (refused.shape, refused.error.message))
        };
        let straight = Eye(Some(DMat4::IDENTITY), 1);
        assert_eq!(refused(vec![mesh()], &straight), None);
        let (shape, message) =
            refused(vec![mesh(), LoweredShape::Custom(Box::new(wall))], &straight).unwrap();
        assert_eq!((shape, &*message), (Some(1), "only triangles can be rasterized"));
        for eye in [Eye(None, 1), Eye(Some(DMat4::IDENTITY), 4)] {
            assert_eq!(refused(vec![mesh()], &eye).unwrap().0, None);
        }
        let text = "shadows = \"none\"\ninterpolation = \"gouraud\"";
        let view = View {
            geometry: &Geometry::new(Vec::new()),
            camera: &straight,
            film,
        };
        let found = build::<Integrators, Rasterizer>(text, ())
            .unwrap()
            .object_order(&view, &mut TestContext::default());
        let message = found.err().unwrap().error.message;
        assert_eq!(
            message,
            "interpolated colours need camera rays that start at one point"
        );
    }
}
