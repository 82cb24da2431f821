//! Boxes.

use super::{Real, Roots, Textbook, Vector, first_positive};

/// The slab test: Kay and Kajiya 1986, in Glassner (ed.) 1989, ch. 2, 4.1.
pub(super) struct Cuboid;

impl Cuboid {
    #[inline]
    fn both<R: Real>(o: Vector<R>, d: Vector<R>) -> Option<[R; 2]> {
        let one = R::of(1.0);
        let (mut enter, mut exit) = (R::of(f64::NEG_INFINITY), R::of(f64::INFINITY));
        for axis in 0..3 {
            let (a, b) = ((-one - o[axis]) / d[axis], (one - o[axis]) / d[axis]);
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            enter = if near > enter { near } else { enter };
            exit = if far < exit { far } else { exit };
        }
        (enter <= exit).then_some([enter, exit])
    }
}

impl<R: Real> Textbook<R> for Cuboid {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let [enter, exit] = Self::both(o, d)?;
        first_positive(enter, exit)
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        Self::both(o, d).into_iter().flatten().collect()
    }
}
