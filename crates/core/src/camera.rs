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
    /// The ray through `raster`, in pixels from the top left corner, x right and y down (section 3
    /// of the model). The direction is of unit length; the ray starts at the near limit, if there
    /// is one.
    fn ray(&self, raster: DVec2) -> Ray;

    /// [`Self::ray`] through each of `rays.len` positions: origins and directions.
    fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
        for lane in 0..rays.len {
            let ray = self.ray(raster[lane]);
            rays.origin.set(lane, ray.origin);
            rays.direction.set(lane, ray.direction);
        }
    }

    /// How far in front of the camera the ray through `raster` starts, in metres along it: what is
    /// nearer is not seen. Negative for one that starts behind it.
    fn near(&self, _raster: DVec2) -> f64 {
        0.0
    }

    /// Points of the lens through which every position in the image is seen: 1 for a pinhole.
    fn lens_points(&self) -> u32 {
        1
    }

    /// The ray through `raster` from a point of the lens, by its number (below
    /// [`Self::lens_points`]). [`Self::ray`] is the one through the middle of the lens.
    fn lens_ray(&self, raster: DVec2, _point: u32) -> Ray {
        self.ray(raster)
    }

    /// [`Self::lens_ray`] through each of `rays.len` positions, all from the same point of the
    /// lens.
    fn lens_stream(&self, raster: &Lanes<DVec2>, point: u32, rays: &mut RayStream) {
        if self.lens_points() == 1 {
            return self.ray_stream(raster, rays);
        }
        for lane in 0..rays.len {
            let ray = self.lens_ray(raster[lane], point);
            rays.origin.set(lane, ray.origin);
            rays.direction.set(lane, ray.direction);
        }
    }

    /// The way back from points to positions in the image, where that is linear: a matrix that
    /// takes a point of the world to (x w, y w, depth, w), with x, y the raster position at which
    /// it is seen, and depth how far it is in front of the camera, in metres along the view. `None`
    /// if straight lines are not straight in the image.
    fn projection(&self) -> Option<DMat4> {
        None
    }
}
