use crate::{Aabb, Ray};
use glam::{DAffine3, DMat3, DVec3};

/// An invertible affine map from a shape's object space to world space, with its inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    world_from_object: DAffine3,
    object_from_world: DAffine3,
}

impl Transform {
    /// The identity.
    pub const IDENTITY: Self = Self {
        world_from_object: DAffine3::IDENTITY,
        object_from_world: DAffine3::IDENTITY,
    };

    /// From `world_from_object`; `None` if it is singular or its inverse is not finite.
    ///
    /// Singular means that the image of the unit cube has a volume below 1e-15 of the product of
    /// its edge lengths, so the scale of the scene does not matter.
    pub fn new(world_from_object: DAffine3) -> Option<Self> {
        let m = world_from_object.matrix3;
        let lengths = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
        let object_from_world = world_from_object.inverse();
        let invertible = m.determinant().abs() > 1e-15 * lengths;
        (invertible && world_from_object.is_finite() && object_from_world.is_finite()).then_some(Self {
            world_from_object,
            object_from_world,
        })
    }

    /// This map after `first`, for nested spaces. `None` as in [`Self::new`].
    pub fn after(&self, first: &Self) -> Option<Self> {
        if *self == Self::IDENTITY {
            return Some(*first);
        }
        Self::new(self.world_from_object * first.world_from_object)
    }

    /// The matrix from object to world space.
    pub fn world_from_object(&self) -> &DAffine3 {
        &self.world_from_object
    }

    /// The matrix from world to object space.
    pub fn object_from_world(&self) -> &DAffine3 {
        &self.object_from_world
    }

    /// Transforms a point to world space.
    pub fn point_to_world(&self, p: DVec3) -> DVec3 {
        self.world_from_object.transform_point3(p)
    }

    /// Transforms a direction to world space, without normalisation.
    pub fn vector_to_world(&self, v: DVec3) -> DVec3 {
        self.world_from_object.transform_vector3(v)
    }

    /// Transforms a normal to a *unit* normal in world space, by the inverse transpose: outside
    /// stays outside under mirroring.
    pub fn normal_to_world(&self, n: DVec3) -> DVec3 {
        (self.object_from_world.matrix3.transpose() * n).normalize()
    }

    /// Transforms a ray to object space. Its parameter t stays the same.
    #[inline(always)]
    pub fn ray_to_object(&self, ray: &Ray) -> Ray {
        Ray {
            // Subtract the translation first: this difference is exact far from the world origin,
            // while the inverse's translation would cancel only up to a rounding of its size.
            origin: self.object_from_world.matrix3 * (ray.origin - self.world_from_object.translation),
            direction: self.object_from_world.transform_vector3(ray.direction),
        }
    }

    /// World-space bounding box of a box in object space.
    pub fn aabb_to_world(&self, aabb: &Aabb) -> Aabb {
        let corner = |i: usize| {
            DVec3::new(
                if i & 1 == 0 { aabb.min.x } else { aabb.max.x },
                if i & 2 == 0 { aabb.min.y } else { aabb.max.y },
                if i & 4 == 0 { aabb.min.z } else { aabb.max.z },
            )
        };
        Aabb::around((0..8).map(|i| self.point_to_world(corner(i))))
    }

    /// The scale factor if the map is a similarity (rotation or mirroring, uniform scale,
    /// translation) to a relative 1e-9; `None` otherwise.
    pub fn similarity_scale(&self) -> Option<f64> {
        let m: DMat3 = self.world_from_object.matrix3;
        let lengths = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
        let scale = lengths.x;
        // Lengths, not their squares, whose relative difference is twice as large.
        let unit = m * DMat3::from_diagonal(lengths.recip());
        let perpendicular = (unit.transpose() * unit).abs_diff_eq(DMat3::IDENTITY, 1e-9);
        let alike = (lengths - scale).abs().max_element() <= 1e-9 * scale;
        (perpendicular && alike).then_some(scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_maps_are_rejected_and_tiny_ones_are_not() {
        let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(Transform::new(flat).is_none());
        assert!(Transform::new(DAffine3::from_scale(DVec3::splat(1e-30))).is_some());
    }

    #[test]
    fn mirroring_keeps_the_outside_outside() {
        let mirror = Transform::new(DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0))).unwrap();
        assert_eq!(mirror.normal_to_world(DVec3::X), DVec3::NEG_X);
        assert_eq!(mirror.normal_to_world(DVec3::Z), DVec3::Z);
    }

    #[test]
    fn a_similarity_differs_from_shear_and_stretch() {
        let turn = DAffine3::from_axis_angle(DVec3::Y, 0.7) * DAffine3::from_scale(DVec3::splat(3.0));
        let scale = Transform::new(turn).unwrap().similarity_scale();
        approx::assert_relative_eq!(scale.unwrap(), 3.0, max_relative = 1e-14);
        for (stretch, is_similar) in [(1.1, false), (1.0 + 1.1e-9, false), (1.0 + 0.9e-9, true)] {
            let stretch = turn * DAffine3::from_scale(DVec3::new(1.0, 1.0, stretch));
            let found = Transform::new(stretch).unwrap().similarity_scale();
            assert_eq!(found.is_some(), is_similar, "{stretch}");
        }
    }
}
