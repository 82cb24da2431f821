//! Finds geometry for which boxes in single precision are too coarse.
//!
//! The boxes of `bvh` and `kdtree` are widened by about 2^-20 of the size of the structure. Where
//! many elements are smaller than that and lie close together, their widened boxes coincide, and a
//! ray that meets one is tested against all: 2 ms for a ball of 20,000 triangles in a mesh with a
//! triangle of 10^7 times its size.

use crate::support::leaves::items::Items;
use rayon::prelude::*;
use whitstone_core::{DVec3, Geometry};

/// Boxes are compared in cells of this size, in local coordinates: a few of the widths by which
/// single-precision boxes are widened.
const CELL: f64 = 1.0 / (1u64 << 17) as f64;

/// A group of boxes that coincide is crowded if it has at least this many.
const CROWD: usize = 32;

/// One crowd of this size makes rays slow, however many other elements there are.
const LARGE_CROWD: usize = 256;

/// Smaller crowds do so if they hold at least one in this many elements.
const SHARE: usize = 8;

/// Why rays would be slow in a structure whose boxes and leaves are in single precision; `None` if
/// they would not.
pub(crate) fn obstacle(geometry: &Geometry) -> Option<String> {
    let Census { all, flat, crowded } = Census::of(geometry);
    if crowded > 0 {
        return Some(format!(
            "single precision cannot separate {crowded} elements, which are tiny next to others"
        ));
    }
    // They fill the leaves of such a structure, and `bvh2` leaves them out.
    (all > 0 && 2 * flat >= all).then(|| format!("{flat} triangles have no area and are left out"))
}

struct Census {
    /// All elements of the structure.
    all: usize,
    /// Triangles with two equal corners, which nothing can hit.
    flat: usize,
    /// Elements whose boxes coincide with many others in single precision, but not in double
    /// precision; 0 if there are too few to make rays slow.
    crowded: usize,
}

impl Census {
    fn of(geometry: &Geometry) -> Self {
        let items = Items::new(geometry);
        // Elements that are large along all axes are told apart by their sizes.
        let keys = items.each(|number| {
            if items.is_flat(number) {
                return Found::Flat;
            }
            let aabb = items.bounds(number);
            let [min, max] = [aabb.min, aabb.max].map(|corner| items.frame.point(corner));
            if (max - min).min_element() < CELL {
                Found::Small(Key::new(min, max))
            } else {
                Found::Large
            }
        });
        let all = keys.len();
        let flat = keys.iter().filter(|found| matches!(found, Found::Flat)).count();
        let small = keys.into_iter().filter_map(|found| match found {
            Found::Small(key) => Some(key),
            Found::Flat | Found::Large => None,
        });
        let mut keys: Vec<Key> = small.collect();
        keys.par_sort_unstable();
        keys.dedup();
        let sizes = keys.chunk_by(|a, b| a.cells == b.cells).map(<[Key]>::len);
        let sizes = sizes.filter(|size| *size >= CROWD);
        let (sum, largest) = sizes.fold((0, 0), |(sum, largest), size| (sum + size, largest.max(size)));
        let slow = largest >= LARGE_CROWD || sum >= all.div_ceil(SHARE);
        Self {
            all,
            flat,
            crowded: if slow { sum } else { 0 },
        }
    }
}

/// What is found about an element.
enum Found {
    Flat,
    Small(Key),
    Large,
}

/// The cells of both corners of a box, and a hash of the box: equal boxes are not told apart in
/// double precision either.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    cells: u128,
    hash: u64,
}

impl Key {
    fn new(min: DVec3, max: DVec3) -> Self {
        let mut key = Self { cells: 0, hash: 0 };
        for coordinate in [min, max].iter().flat_map(|corner| corner.to_array()) {
            // Coordinates are from -1 to 1, so the number of a cell is at most 2^18.
            key.cells = key.cells << 20 | ((coordinate + 1.0) / CELL) as u128;
            // The multiplier is that of the generator of Steele and Vigna 2021, for 64 bits.
            key.hash = (key.hash ^ coordinate.to_bits()).wrapping_mul(0xd134_2543_de82_ef95);
            key.hash ^= key.hash >> 32;
        }
        key
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{LoweredShape, TriangleMesh};

    /// Small triangles at random places in a cube around the origin, and one of size 1.
    fn crowded_of(count: u32, size: f64) -> usize {
        let mut random = whitstone_testkit::Random::new(5);
        let corner = |_| size * random.cube();
        let mut positions: Vec<DVec3> = (0..3 * count).map(corner).collect();
        positions.extend([DVec3::NEG_ONE, DVec3::X, DVec3::ONE]);
        let mesh = |positions: Vec<DVec3>| TriangleMesh {
            triangles: (0..positions.len() as u32 / 3)
                .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
                .collect(),
            positions,
            orientation: 1.0,
            ..TriangleMesh::default()
        };
        Census::of(&Geometry::new(vec![LoweredShape::Triangles(mesh(positions))])).crowded
    }

    #[test]
    fn elements_are_crowded_where_they_are_many_and_tiny() {
        for size in [1e-2, 1e-4] {
            assert_eq!(crowded_of(4000, size), 0, "{size}");
        }
        for size in [1e-7, 1e-9, 1e-15] {
            assert!(crowded_of(4000, size) > 3000, "{size}");
        }
        assert_eq!(crowded_of(16, 1e-9), 0);
        // Triangles of one point are never hit.
        assert_eq!(crowded_of(4000, 0.0), 0);
    }
}
