use crate::stream::{Colors, Lanes, RayStream};
use crate::{Camera, FilmSize, Geometry, Scene, SceneError, Scratch};
use glam::DVec2;

/// The input of an object-order method, available before any ray is traced.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// All shapes.
    pub geometry: &'a Geometry,
    /// The camera.
    pub camera: &'a dyn Camera,
    /// The size of the image.
    pub film: FilmSize,
}

/// An object-order renderer: it projects shapes to pixels, instead of tracing rays from pixels.
pub trait ObjectOrder: Send + Sync {
    /// Radiance along the camera rays through these raster positions. Hits and counts may differ
    /// from [`crate::Integrator::radiance_stream`] only at edges, where rounding decides.
    fn radiance_stream(
        &self,
        scene: &Scene,
        raster: &Lanes<DVec2>,
        rays: &RayStream,
        scratch: &mut Scratch,
        out: &mut Colors,
    );
}

/// Why an object-order method cannot render a scene.
#[derive(Debug)]
pub struct Refused {
    /// The number of the offending shape, if there is one: the error is reported there.
    pub shape: Option<u32>,
    /// The error.
    pub error: SceneError,
}
