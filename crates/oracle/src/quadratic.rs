//! Roots of `a t² + 2 b t + c`.

use crate::interval::{Decided, Interval, Undecided};
use std::cmp::Ordering;

/// Each root with half of the derivative there, in no order. Undecided for a double root.
pub(crate) fn roots(a: &Interval, b: &Interval, c: &Interval) -> Decided<Vec<(Interval, Interval)>> {
    if a.sign()? == Ordering::Equal {
        if b.sign()? == Ordering::Equal {
            return Ok(Vec::new());
        }
        let t = (-c).over(&(b + b))?;
        return Ok(vec![(t, b.clone())]);
    }
    let discriminant = b * b - a * c;
    match discriminant.sign()? {
        Ordering::Less => Ok(Vec::new()),
        // A double root: the line touches.
        Ordering::Equal => Err(Undecided),
        Ordering::Greater => {
            let root = discriminant.sqrt()?;
            let one = (-b - &root).over(a)?;
            let other = (&root - b).over(a)?;
            Ok(vec![(one, -&root), (other, root)])
        }
    }
}
