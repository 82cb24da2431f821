//! Macros that check a plugin against all laws of its family in one line.

/// Tests that a shape obeys the laws of shapes ([`shape_laws`](fn@crate::shape_laws)) in every
/// placement, for each text of its table; numbers in it may be ranges.
///
/// ```ignore
/// whitstone_testkit::shape_laws!(Superquadric, "", "north_south = 0.1..2\neast_west = 0.1..2");
/// ```
#[macro_export]
macro_rules! shape_laws {
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_shapes() {
            $crate::hold::<$crate::core::Shapes, $plugin>(&[$($text),*], &[]);
        }
    };
}

/// Tests that an accelerator obeys the laws of accelerators
/// ([`accelerator_laws`](fn@crate::accelerator_laws)) and agrees with testing every element over
/// random triangles and balls. A failure is reduced to the fewest shapes that show it.
///
/// ```ignore
/// whitstone_testkit::accelerator_laws!(Bvh2, "", "max_leaf = 1..8");
/// ```
#[macro_export]
macro_rules! accelerator_laws {
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_accelerators() {
            $crate::hold::<$crate::core::Accelerators, $plugin>(&[$($text),*], &[]);
        }
    };
}

/// Tests that a material obeys [`material_laws`](fn@crate::material_laws), or the named laws, which
/// are functions of this crate.
///
/// ```ignore
/// whitstone_testkit::material_laws!(Phong, "exponent = 1..1000");
/// whitstone_testkit::material_laws!(Matte: material_laws + energy_laws + reciprocity_laws, "reflectance = 0.0..1");
/// ```
#[macro_export]
macro_rules! material_laws {
    ($plugin:ty : $first:ident $(+ $law:ident)* $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_materials() {
            $crate::hold::<$crate::core::Materials, $plugin>(
                &[$($text),*],
                &[|material| $crate::$first(&**material) $(, |material| $crate::$law(&**material))*],
            );
        }
    };
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        $crate::material_laws!($plugin: material_laws $(, $text)*);
    };
}

/// Tests that a texture obeys [`texture_laws`](fn@crate::texture_laws).
///
/// ```ignore
/// whitstone_testkit::texture_laws!(Checker, "scale = [0.1..9, 0.1..9]");
/// ```
#[macro_export]
macro_rules! texture_laws {
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_textures() {
            $crate::hold::<$crate::core::Textures, $plugin>(&[$($text),*], &[]);
        }
    };
}

/// Tests that a camera obeys [`camera_laws`](fn@crate::camera_laws) for images of several aspect
/// ratios.
///
/// ```ignore
/// whitstone_testkit::camera_laws!(Perspective, "look_at = { origin = [0, 0, 5], target = [0, 0, 0] }\nfov = 1.0..170");
/// ```
#[macro_export]
macro_rules! camera_laws {
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_cameras() {
            $crate::hold::<$crate::core::Cameras, $plugin>(&[$($text),*], &[]);
        }
    };
}

/// Tests that a light obeys [`light_laws`](fn@crate::light_laws).
///
/// ```ignore
/// whitstone_testkit::light_laws!(Point, "position = [0, 0, 0]\nintensity = 0.0..1e6");
/// ```
#[macro_export]
macro_rules! light_laws {
    ($plugin:ty $(, $text:expr)* $(,)?) => {
        #[test]
        fn obeys_the_laws_of_lights() {
            $crate::hold::<$crate::core::Lights, $plugin>(&[$($text),*], &[]);
        }
    };
}
