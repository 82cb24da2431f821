//! Rasterization: each triangle is projected to the image, and a depth buffer keeps the nearest at each pixel; shading as ray casting.
//!
//! Catmull, *A subdivision algorithm for computer display of curved surfaces*, 1974 (the depth buffer); Pineda, *A parallel algorithm for
//! polygon rasterization*, 1988 (edge functions); Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*,
//! 1997 (their form before the division); Blinn and Newell, *Clipping using homogeneous coordinates*, 1978. The steps of the
//! lecture notes, one after the other: `project`, `Bins`, `Depths::draw`, and `Depths::hits` with what is shaded.
//!
//! - Twin: the driver at depth 0, without branches: what is seen is the same.
//! - Example: `scenes/integrators/rasterizer.toml`.

mod bins;
mod fill;

use crate::rules::Rules;
use crate::shadows::Shadows;
use bins::Bins;
use fill::{Depths, Projected, project};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::stream::{Colors, Lanes, RayStream};
use whitstone_core::{
    Context, DMat4, DVec2, DVec4, Integrator, Integrators, ObjectOrder, Plugin, Ray, Refused, Rgb, SceneError,
    SceneErrors, Scratch, Shape, View, World,
};

/// Rasterization of triangles with a depth buffer, and local shading with shadows.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "opaque": surfaces hide lights; "none": every light is visible.
    #[serde(default)]
    shadows: Shadows,
}

/// See the module.
pub struct Rasterizer {
    shadows: Shadows,
}

impl Rasterizer {
    /// At what is nearest, local shading.
    fn rules(&self) -> Rules {
        Rules {
            shadows: self.shadows,
            branches: None,
        }
    }
}

impl Plugin<Integrators> for Rasterizer {
    const TYPE: &'static str = "rasterizer";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Integrator>, SceneErrors> {
        Ok(Box::new(Self {
            shadows: config.shadows,
        }))
    }
}

impl Integrator for Rasterizer {
    fn follows_branches(&self) -> bool {
        false
    }

    /// By ray casting: for a single ray there is nothing to project all triangles for.
    fn radiance(&self, world: &World, ray: &Ray, scratch: &mut Scratch) -> Rgb {
        self.rules().radiance(world, ray, scratch)
    }

    fn radiance_stream(&self, world: &World, rays: &RayStream, scratch: &mut Scratch, out: &mut Colors) {
        self.rules().radiance_stream(world, rays, scratch, out);
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
        let to_image = view.camera.projection().filter(|_| view.camera.lens_points() == 1);
        let to_image = to_image.ok_or_else(|| {
            let help = "use the camera \"perspective\" or \"orthographic\", or the integrator \"appel\"";
            refuse(None, "the camera does not project straight lines to straight lines", help)
        })?;
        let (mut vertices, mut triangles) = (0, 0);
        for (shape, number) in view.geometry.shapes().iter().zip(0..) {
            let Shape::Triangles(mesh) = shape else {
                let help = "draw a mesh instead, or use the integrator \"appel\", which shows the same by casting rays";
                return Err(refuse(Some(number), "only triangles can be rasterized", help));
            };
            vertices += mesh.positions.len();
            triangles += mesh.triangles.len();
        }
        let bytes = vertices * size_of::<DVec4>() + triangles * Bins::BYTES_A_TRIANGLE;
        context.reserve(bytes as u64).map_err(|mut errors| Refused {
            shape: None,
            error: errors.0.pop().unwrap_or_else(|| SceneError::anywhere("too little memory")),
        })?;
        let projected = project(view.geometry, &to_image);
        let bins = Bins::new(view.geometry, &projected, view.film);
        Ok(Some(Box::new(Frame {
            rules: self.rules(),
            to_image,
            projected,
            bins,
            film: DVec2::new(f64::from(view.film.width), f64::from(view.film.height)),
        })))
    }
}

/// All triangles in the image.
struct Frame {
    rules: Rules,
    to_image: DMat4,
    projected: Projected,
    bins: Bins,
    film: DVec2,
}

impl ObjectOrder for Frame {
    fn radiance_stream(
        &self,
        world: &World,
        raster: &Lanes<DVec2>,
        rays: &RayStream,
        scratch: &mut Scratch,
        out: &mut Colors,
    ) {
        let mut depths = Depths::new(raster, rays, &self.to_image);
        let (low, high) = depths.bounds();
        for names in self.bins.around(low, high) {
            depths.draw(world.geometry.shapes(), &self.projected, self.film, names);
        }
        let mut hits = depths.hits(&world.geometry, rays);
        self.rules.shade_stream(world, rays, &mut hits, scratch, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Camera, DVec3, FilmSize, Geometry, TriangleMesh};
    use whitstone_testkit::{TestContext, Wall, build, floor, integrator_laws};

    #[test]
    fn laws() {
        for (text, shadows) in [("", true), ("shadows = \"none\"", false)] {
            integrator_laws(&*build::<Integrators, Rasterizer>(text, ()).unwrap(), shadows);
        }
    }

    /// One that projects to the image, or does not, with so many points of a lens.
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
        let mesh = || Shape::Triangles(TriangleMesh::default());
        let wall: Wall = floor(0.0);
        let film = FilmSize { width: 4, height: 4 };
        let refused = |shapes: Vec<Shape>, eye: &Eye| {
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
        let (shape, message) = refused(vec![mesh(), Shape::Opaque(Box::new(wall))], &straight).unwrap();
        assert_eq!((shape, &*message), (Some(1), "only triangles can be rasterized"));
        for eye in [Eye(None, 1), Eye(Some(DMat4::IDENTITY), 4)] {
            assert_eq!(refused(vec![mesh()], &eye).unwrap().0, None);
        }
    }
}
