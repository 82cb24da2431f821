use crate::Ray;
use crate::stream::{Lanes, RayStream};
use glam::{DMat4, DVec2};

/// Size of the image in pixels, each at least 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilmSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Turns positions in the image into rays.
pub trait Camera: Send + Sync {
    /// The ray through `raster`, in pixels from the top left corner, x right and y down (section 3 of the
    /// model). The direction is of unit length.
    fn ray(&self, raster: DVec2) -> Ray;

    /// [`Self::ray`] through each of `rays.len` positions: origins and directions.
    fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
        for lane in 0..rays.len {
            let ray = self.ray(raster[lane]);
            rays.origin.set(lane, ray.origin);
            rays.direction.set(lane, ray.direction);
        }
    }

    /// The way back from points to positions in the image, where that is linear: a matrix that takes a point of
    /// the world to (x w, y w, depth, w), with x, y the raster position at which it is seen, and depth how far it is in
    /// front of the camera, in metres along the view. `None` if straight lines are not straight in the image.
    fn projection(&self) -> Option<DMat4> {
        None
    }
}
