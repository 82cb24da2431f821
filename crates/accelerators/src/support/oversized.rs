//! Oversized shapes, next to which all others vanish.
//!
//! The precision of a structure is that of its largest coordinate: around a ground of a million
//! kilometres, single-precision boxes cannot resolve the triangles of a bunny. Oversized shapes are
//! few, and are tested for every ray, like endless ones.

use whitstone_core::Aabb;

/// A shape is oversized if it is more than this many times as large as all others together.
/// Single-precision boxes still resolve a thousandth of the others' size.
const VAST: f64 = 16384.0;

/// Maximum number of elements of oversized shapes, which are tested for every ray.
const MAX: usize = 64;

/// The numbers of the oversized shapes, ascending, given the box and the number of elements of each
/// shape. Empty boxes are ignored.
pub(crate) fn oversized(shapes: &[(Aabb, usize)]) -> Vec<u32> {
    let size = |aabb: &Aabb| (aabb.max - aabb.min).max_element();
    let mut oversized: Vec<u32> = Vec::new();
    let mut left = MAX;
    loop {
        let others = || {
            let all = (0..).zip(shapes);
            all.filter(|(number, (aabb, _))| !aabb.is_empty() && !oversized.contains(number))
        };
        let largest = others().max_by(|(_, (a, _)), (_, (b, _))| size(a).total_cmp(&size(b)));
        let Some((number, (aabb, count))) = largest else {
            break;
        };
        let rest = others().filter(|(other, _)| *other != number);
        let rest = rest.fold(Aabb::EMPTY, |rest, (_, (aabb, _))| rest.union(*aabb));
        if rest.is_empty() || *count > left || size(aabb) <= VAST * size(&rest) {
            break;
        }
        left -= count;
        oversized.push(number);
    }
    oversized.sort_unstable();
    oversized
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;

    fn cube(center: f64, half: f64) -> Aabb {
        Aabb::around([DVec3::splat(center - half), DVec3::splat(center + half)])
    }

    #[test]
    fn what_is_vast_beside_the_rest_is_found() {
        let scene = |half: f64| [(cube(0.0, half), 2), (cube(3.0, 1.0), 100), (cube(-2.0, 0.5), 1)];
        assert!(oversized(&scene(1e4)).is_empty());
        assert_eq!(oversized(&scene(1e6)), [0]);
        // Three nested shapes.
        let nested = [
            (cube(0.0, 1e5), 1),
            (cube(0.0, 1.0), 1),
            (Aabb::EMPTY, 0),
            (cube(0.0, 1e12), 1),
        ];
        assert_eq!(oversized(&nested), [0, 3]);
        // Neither a mesh of many elements nor a single shape is oversized.
        assert!(oversized(&[(cube(0.0, 1e9), 65), (cube(0.0, 1.0), 1)]).is_empty());
        assert!(oversized(&[(cube(0.0, 1e9), 1)]).is_empty());
        assert!(oversized(&[]).is_empty());
    }
}
