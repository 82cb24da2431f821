//! A hierarchy over the lights of a scene, to find those that can be bright near a point.
//!
//! pbrt-v4 chooses lights at random by such a hierarchy (Pharr, Jakob and Humphreys, *Physically
//! Based Rendering*, 4th edition, section 12.6.3). Here it finds all lights above a threshold.

use crate::{Aabb, Light};
use glam::DVec3;
use std::sync::Arc;

/// Maximum number of lights in a leaf.
const LEAF: usize = 4;

/// Factor on bounds of irradiance, for the rounding of distances and of the irradiance itself.
const ROUNDING: f64 = 1.0 + 1e-9;

/// The light sources of a scene, by their bounds.
pub(crate) struct LightTree {
    /// In depth-first order, the root first.
    nodes: Vec<Node>,
    /// The lights with bounds, leaf by leaf: their indices and bounds.
    lights: Vec<(u32, LightBounds)>,
    /// Indices of the lights without bounds.
    unbounded: Vec<u32>,
}

struct Node {
    bounds: LightBounds,
    /// The position of its first light.
    first: usize,
    /// For a leaf, the number of its lights; 0 for an inner node.
    count: usize,
    /// The node that follows the subtree of this one.
    next: usize,
}

/// Bounds on the samples of a light: at the distance d from the box, in metres, the irradiance of
/// each is at most `max_intensity / d²` in every channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// The positions of the light.
    pub bounds: Aabb,
    /// The largest radiant intensity of any sample, in W/sr.
    pub max_intensity: f64,
}

impl LightBounds {
    /// Whether a sample can reach the irradiance `cutoff` > 0 at any point of a box.
    fn reaches(&self, points: &Aabb, cutoff: f64) -> bool {
        let gap = (self.bounds.min - points.max)
            .max(points.min - self.bounds.max)
            .max(DVec3::ZERO);
        // The length may overflow; the largest component is less than it.
        let (length, largest) = (gap.length(), gap.max_element());
        let distance = if length.is_finite() { length } else { largest };
        // Divided twice, because d² may overflow. The negation holds for NaN.
        let dark = self.max_intensity / distance / distance * ROUNDING < cutoff;
        !dark
    }

    fn union(&self, other: &Self) -> Self {
        Self {
            bounds: self.bounds.union(other.bounds),
            max_intensity: self.max_intensity.max(other.max_intensity),
        }
    }
}

impl LightTree {
    /// A hierarchy over lights, by their indices.
    pub(crate) fn new(lights: &[Arc<dyn Light>]) -> Self {
        let (mut bounded, mut unbounded) = (Vec::new(), Vec::new());
        for (number, light) in (0..).zip(lights) {
            match light.bounds() {
                Some(bounds) => bounded.push((number, bounds)),
                None => unbounded.push(number),
            }
        }
        let mut nodes = Vec::new();
        if !bounded.is_empty() {
            build(&mut bounded, 0, &mut nodes);
        }
        Self {
            nodes,
            lights: bounded,
            unbounded,
        }
    }

    /// The indices, in ascending order, of all lights with a sample that can reach the irradiance
    /// `cutoff` > 0 at any point of a box.
    pub(crate) fn find(&self, points: &Aabb, cutoff: f64, out: &mut Vec<u32>) {
        out.clear();
        out.extend(&self.unbounded);
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if node.bounds.reaches(points, cutoff) {
                let lights = &self.lights[node.first..node.first + node.count];
                let bright = lights.iter().filter(|(_, own)| own.reaches(points, cutoff));
                out.extend(bright.map(|(number, _)| number));
                at += 1;
            } else {
                at = node.next;
            }
        }
        out.sort_unstable();
    }
}

/// Appends the subtree over some lights, which begin at the position `first`.
fn build(lights: &mut [(u32, LightBounds)], first: usize, nodes: &mut Vec<Node>) {
    let Some((&(_, start), others)) = lights.split_first() else {
        return;
    };
    let bounds = others.iter().fold(start, |whole, (_, own)| whole.union(own));
    let at = nodes.len();
    let is_leaf = lights.len() <= LEAF;
    nodes.push(Node {
        bounds,
        first,
        count: if is_leaf { lights.len() } else { 0 },
        next: 0,
    });
    if !is_leaf {
        let extent = bounds.bounds.extent();
        let axis = (0..3)
            .max_by(|a, b| extent[*a].total_cmp(&extent[*b]))
            .unwrap_or(0);
        let middle = lights.len() / 2;
        let center = |own: &LightBounds| own.bounds.center()[axis];
        lights.select_nth_unstable_by(middle, |(a, one), (b, other)| {
            center(one).total_cmp(&center(other)).then(a.cmp(b))
        });
        let (left, right) = lights.split_at_mut(middle);
        build(left, first, nodes);
        build(right, first + middle, nodes);
    }
    nodes[at].next = nodes.len();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LightFlags, LightSample, Rgb};

    /// A point light, with bounds or without.
    struct Bulb {
        position: DVec3,
        intensity: f64,
        bounded: bool,
    }

    impl Light for Bulb {
        fn flags(&self) -> LightFlags {
            LightFlags::SAMPLES
        }

        fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
            let way = self.position - point;
            out.push(LightSample {
                direction: way.normalize(),
                distance: way.length(),
                irradiance: Rgb::splat(self.intensity / way.length_squared()),
            });
        }

        fn bounds(&self) -> Option<LightBounds> {
            self.bounded.then_some(LightBounds {
                bounds: Aabb::around([self.position]),
                max_intensity: self.intensity,
            })
        }
    }

    fn bulbs(count: u32) -> Vec<Arc<dyn Light>> {
        let place = |n: u32, step: u32| f64::from(n * step % 1009) / 50.0;
        (0..count)
            .map(|n| -> Arc<dyn Light> {
                Arc::new(Bulb {
                    position: DVec3::new(place(n, 7), place(n, 11), place(n, 13)),
                    intensity: f64::from(n % 10),
                    bounded: n % 97 != 0,
                })
            })
            .collect()
    }

    #[test]
    fn every_light_above_the_cutoff_is_found_and_most_others_are_not() {
        let lights = bulbs(1000);
        let tree = LightTree::new(&lights);
        let mut found = Vec::new();
        for point in [DVec3::ZERO, DVec3::splat(10.1), DVec3::new(5.0, -3.0, 30.0)] {
            for cutoff in [1e-9, 0.01, 0.5, 7.0] {
                tree.find(&Aabb::around([point]), cutoff, &mut found);
                let mut bright = 0;
                for (number, light) in (0..).zip(&lights) {
                    let mut samples = Vec::new();
                    light.samples(point, &mut samples);
                    if samples[0].irradiance.g >= cutoff {
                        bright += 1;
                        assert!(found.binary_search(&number).is_ok(), "{point} {cutoff} {number}");
                    }
                }
                // Those without bounds, and those that rounding puts near the cutoff.
                let most = bright + 12;
                assert!(
                    found.len() <= most,
                    "{point} {cutoff}: {} of {bright}",
                    found.len()
                );
                assert!(found.is_sorted());
            }
        }
        tree.find(&Aabb::EVERYTHING, 1e300, &mut found);
        assert_eq!(found.len(), lights.len());
    }

    #[test]
    fn bounds_hold_at_any_scale() {
        for (distance, intensity, cutoff, expected) in [
            (1e200, 1e300, 1e-101, true),
            (1e200, 1e300, 1e-99, false),
            (1e-200, 1e-300, 1e90, true),
            // The distance underflows; `true` is on the safe side.
            (1e-200, 1e-300, 1e101, true),
            (1e-100, 1e-300, 1e-99, false),
            (0.0, 1.0, 1e300, true),
            (0.0, 0.0, 1.0, true),
            (2.0, 4.0, 1.0, true),
            (2.0, 4.0, 1.000_001, false),
        ] {
            let light = LightBounds {
                bounds: Aabb::around([DVec3::ZERO]),
                max_intensity: intensity,
            };
            let points = Aabb::around([DVec3::new(0.0, distance, 0.0)]);
            assert_eq!(light.reaches(&points, cutoff), expected, "{distance} {intensity}");
        }
        assert!(LightTree::new(&[]).nodes.is_empty());
    }
}
