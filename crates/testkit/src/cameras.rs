//! Laws of cameras.

use crate::streams::camera_streams;
use whitstone_core::{Camera, DMat4, DVec2, FilmSize, Ray};

/// Checks the laws of cameras:
///
/// - Rays are finite, have unit direction and depend only on the raster position and the lens
///   point.
/// - Different quarters of the image have different rays.
/// - Streams give the same rays as single calls.
/// - The image is neither mirrored nor upside down.
/// - The projection, if there is one, maps every point of a ray to the raster position of the ray.
///
/// # Panics
///
/// If the camera breaks one of these laws; the message says which and where.
pub fn camera_laws(camera: &dyn Camera, film: FilmSize) {
    let size = DVec2::new(f64::from(film.width), f64::from(film.height));
    let mut rasters = Vec::new();
    assert!(camera.lens_points() > 0, "a lens must have at least one point");
    let steps = [0.0, 1e-9, 0.1, 0.25, 0.5, 0.5 + 1e-12, 0.9, 1.0];
    for x in steps {
        for y in steps {
            let raster = size * DVec2::new(x, y);
            rasters.extend((0..5).map(|k| raster + 0.01 * f64::from(k)));
            let ray = camera.ray(raster);
            sound(&ray, raster);
            assert_eq!(
                camera.ray(raster),
                ray,
                "the ray through {raster} must be deterministic"
            );
            for point in 0..camera.lens_points() {
                let ray = camera.lens_ray(raster, point);
                sound(&ray, raster);
                let again = camera.lens_ray(raster, point);
                assert_eq!(again, ray, "a lens ray through {raster} must be deterministic");
            }
            let near = camera.near(raster);
            assert!(
                near.is_finite(),
                "`near` must be finite, found {near} for the ray through {raster}"
            );
            if let Some(projection) = camera.projection() {
                goes_back(&projection, &ray, near, raster, size);
            }
        }
    }
    let broken = camera_streams(camera, &rasters).err();
    assert_eq!(broken, None, "streams must give the same rays as single calls");
    // A point in front of the camera represents its ray, since parallel rays differ in their
    // origins. Borders are excluded: a panorama sees them twice.
    let point = |x: f64, y: f64| {
        let ray: Ray = camera.ray(size * DVec2::new(x, y));
        ray.origin + ray.direction
    };
    let (low, high) = (0.25, 0.75);
    let corners = [
        point(low, low),
        point(high, low),
        point(high, high),
        point(low, high),
    ];
    for i in 0..4 {
        assert_ne!(
            corners[i],
            corners[(i + 1) % 4],
            "neighbouring quarters of the image must have different rays"
        );
    }
    let right = point(high, 0.5) - point(low, 0.5);
    let down = point(0.5, high) - point(0.5, low);
    let forward = camera.ray(0.5 * size).direction;
    assert!(
        right.cross(down).dot(forward) > 0.0,
        "the image must not be mirrored: x must increase to the right and y downwards"
    );
}

/// Checks the properties of a single ray.
fn sound(ray: &Ray, raster: DVec2) {
    assert!(
        ray.origin.is_finite(),
        "the origin of the ray through {raster} must be finite: {ray:?}"
    );
    let length = ray.direction.length();
    assert!(
        (length - 1.0).abs() < 1e-14,
        "the ray through {raster} must have a unit direction, found length {length}"
    );
}

/// Checks that a projection maps points of a ray to its raster position; the ray starts `near` in
/// front of the camera. Also checks one point behind the camera.
fn goes_back(projection: &DMat4, ray: &Ray, near: f64, raster: DVec2, size: DVec2) {
    for t in [0.25, 1.0, 1e3] {
        let projected = *projection * ray.at(t - near.min(0.0)).extend(1.0);
        assert!(
            projected.z > 0.0,
            "points on {ray:?} must have positive depth, found {}",
            projected.z
        );
        let back = projected.truncate().truncate() / projected.w;
        let error = ((back - raster) / size).abs().max_element();
        assert!(
            error < 1e-7,
            "the point at {t} of {ray:?} must project to {raster}, found {back}"
        );
    }
    let behind = *projection * ray.at(-0.25 - near).extend(1.0);
    assert!(
        behind.z < 0.0,
        "a point behind the camera must have negative depth, found {}",
        behind.z
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DVec3, DVec4};

    const FILM: FilmSize = FilmSize { width: 4, height: 3 };

    struct Pinhole<F>(F);

    impl<F: Fn(f64, f64) -> DVec3 + Send + Sync> Camera for Pinhole<F> {
        fn ray(&self, raster: DVec2) -> Ray {
            Ray::new(DVec3::ZERO, (self.0)(raster.x / 4.0 - 0.5, 0.5 - raster.y / 3.0))
        }
    }

    #[test]
    fn a_correct_camera_passes() {
        camera_laws(&Pinhole(|a, c| DVec3::new(a, c, -1.0).normalize()), FILM);
    }

    struct Projected(DMat4);

    impl Camera for Projected {
        fn ray(&self, raster: DVec2) -> Ray {
            Pinhole(|a, c| DVec3::new(a, c, -1.0).normalize()).ray(raster)
        }

        fn projection(&self) -> Option<DMat4> {
            Some(self.0)
        }
    }

    /// The projection of the camera above: x = 4 (a + 1/2), y = 3 (1/2 - c), with a and c at depth
    /// -z.
    fn right_projection() -> [DVec4; 4] {
        let (x, y) = (DVec4::new(4.0, 0.0, -2.0, 0.0), DVec4::new(0.0, -3.0, -1.5, 0.0));
        [x, y, DVec4::NEG_Z, DVec4::NEG_Z]
    }

    #[test]
    fn a_correct_projection_passes() {
        let [x, y, z, w] = right_projection();
        camera_laws(&Projected(DMat4::from_cols(x, y, z, w).transpose()), FILM);
    }

    #[test]
    #[should_panic(expected = "must project to")]
    fn a_slightly_wrong_projection_is_found() {
        let [x, y, z, w] = right_projection();
        let off = x + 1e-6 * w;
        camera_laws(&Projected(DMat4::from_cols(off, y, z, w).transpose()), FILM);
    }

    #[test]
    #[should_panic(expected = "a point behind the camera")]
    fn a_wrong_near_limit_is_found() {
        struct Far;
        impl Camera for Far {
            fn ray(&self, raster: DVec2) -> Ray {
                Pinhole(|a, c| DVec3::new(a, c, -1.0).normalize()).ray(raster)
            }
            fn near(&self, _: DVec2) -> f64 {
                -0.5
            }
            fn projection(&self) -> Option<DMat4> {
                let [x, y, z, w] = right_projection();
                Some(DMat4::from_cols(x, y, z, w).transpose())
            }
        }
        camera_laws(&Far, FILM);
    }

    #[test]
    #[should_panic(expected = "unit direction")]
    fn a_long_direction_from_one_lens_point_is_found() {
        struct Lens;
        impl Camera for Lens {
            fn ray(&self, raster: DVec2) -> Ray {
                Pinhole(|a, c| DVec3::new(a, c, -1.0).normalize()).ray(raster)
            }
            fn lens_points(&self) -> u32 {
                2
            }
            fn lens_ray(&self, raster: DVec2, point: u32) -> Ray {
                let ray = self.ray(raster);
                Ray::new(ray.origin, (1.0 + f64::from(point)) * ray.direction)
            }
        }
        camera_laws(&Lens, FILM);
    }

    #[test]
    #[should_panic(expected = "must have positive depth")]
    fn a_wrong_sign_of_depth_is_found() {
        let [x, y, z, w] = right_projection();
        camera_laws(&Projected(DMat4::from_cols(-x, -y, -z, -w).transpose()), FILM);
    }

    #[test]
    #[should_panic(expected = "unit direction")]
    fn a_long_direction_is_found() {
        camera_laws(&Pinhole(|a, c| DVec3::new(a, c, -1.0)), FILM);
    }

    #[test]
    #[should_panic(expected = "must not be mirrored")]
    fn a_mirrored_image_is_found() {
        camera_laws(&Pinhole(|a: f64, c| DVec3::new(-a, c, -1.0).normalize()), FILM);
    }

    #[test]
    #[should_panic(expected = "different rays")]
    fn an_image_of_one_ray_is_found() {
        camera_laws(&Pinhole(|_, _| DVec3::NEG_Z), FILM);
    }
}
