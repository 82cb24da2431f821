use crate::stream::{Colors, Lanes, RayStream};
use crate::{Camera, FilmSize, Geometry, SceneError, Scratch, World};
use glam::DVec2;

/// What an object-order method looks at before any ray is asked for.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// All shapes.
    pub geometry: &'a Geometry,
    /// Who looks.
    pub camera: &'a dyn Camera,
    /// The size of the image.
    pub film: FilmSize,
}

/// Finds what camera rays meet from the objects: each is brought to the image, instead of the image
/// to all of them.
pub trait ObjectOrder: Send + Sync {
    /// Radiance along the camera rays through these positions of the image. What it finds and
    /// counts may differ from [`crate::Integrator::radiance_stream`] only where rounding decides:
    /// at edges.
    fn radiance_stream(
        &self,
        world: &World,
        raster: &Lanes<DVec2>,
        rays: &RayStream,
        scratch: &mut Scratch,
        out: &mut Colors,
    );
}

/// Why an object-order method cannot show a scene.
#[derive(Debug)]
pub struct Refused {
    /// The number of the shape that is at fault, if it is one: the error is shown there.
    pub shape: Option<u32>,
    /// What is wrong.
    pub error: SceneError,
}
