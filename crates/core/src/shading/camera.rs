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

/// Maps raster positions to rays.
pub trait Camera: Send + Sync {
    /// The ray through `raster`, in pixels from the top left corner, x right and y down (section 3
    /// of the model). Its direction has unit length. It starts at the near limit, if there is one.
    fn ray(&self, raster: DVec2) -> Ray;

    /// [`Self::ray`] through each of `rays.len` positions; sets origins and directions.
    fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
        for lane in 0..rays.len {
            let ray = self.ray(raster[lane]);
            rays.origin.set(lane, ray.origin);
            rays.direction.set(lane, ray.direction);
        }
    }

    /// Distance from the camera to the start of the ray through `raster`, in metres along the ray.
    /// Nearer surfaces are not seen. Negative if the ray starts behind the camera.
    fn near(&self, _raster: DVec2) -> f64 {
        0.0
    }

    /// Number of lens points through which every raster position is seen: 1 for a pinhole.
    fn lens_points(&self) -> u32 {
        1
    }

    /// The ray through `raster` from lens point `point` (below [`Self::lens_points`]).
    /// [`Self::ray`] goes through the centre of the lens.
    fn lens_ray(&self, raster: DVec2, _point: u32) -> Ray {
        self.ray(raster)
    }

    /// [`Self::lens_ray`] through each of `rays.len` positions, all from the same lens point.
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

    /// The projective matrix from world space to the raster, if the camera has one. It maps a point
    /// to (x w, y w, depth, w), where (x, y) is the raster position and depth the distance in front
    /// of the camera, in metres along the view direction. `None` if straight lines are not straight
    /// in the image.
    fn projection(&self) -> Option<DMat4> {
        None
    }
}
