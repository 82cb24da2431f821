//! Union, intersection and difference of solids.

use super::{Placed, Surface, surface};
use crate::interval::{Decided, Undecided};
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::config::{PluginRef, SolidRef};
use whitstone_core::{DAffine3, SceneError, SceneErrors};
use whitstone_scene::{Description, PluginTable, parse_transform};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    pub(crate) operation: Operation,
    operands: Vec<SolidRef>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Operation {
    Union,
    Intersection,
    Difference,
}

pub(crate) struct Csg {
    operation: Operation,
    operands: Vec<Placed>,
}

impl Config {
    /// The tables of the operands, each with its own transform.
    pub(crate) fn operands<'s>(
        &self,
        description: &Description<'s>,
    ) -> Result<Vec<(PluginTable<'s>, DAffine3)>, SceneErrors> {
        let operand = |operand: &SolidRef| {
            let PluginRef::Inline(number) = &operand.shape else {
                return Err(SceneError::at(operand.span.clone(), "expected a shape").into());
            };
            let mut plugin = description.inline[*number].clone();
            let own = match plugin.table.get_mut().remove("transform") {
                None => DAffine3::IDENTITY,
                Some(steps) => *parse_transform(&steps)?.world_from_object(),
            };
            Ok((plugin, own))
        };
        self.operands.iter().map(operand).collect()
    }
}

impl Operation {
    /// Whether a point is inside the result, given for each operand whether the point is inside.
    pub(crate) fn inside(self, inside: &[bool]) -> bool {
        let mut each = inside.iter().copied();
        match self {
            Self::Union => each.any(|inside| inside),
            Self::Intersection => each.all(|inside| inside),
            Self::Difference => each.next() == Some(true) && !each.any(|inside| inside),
        }
    }
}

impl Csg {
    pub(crate) fn new(description: &Description<'_>, config: &Config) -> Result<Self, SceneErrors> {
        let operands = config.operands(description)?.into_iter().map(|(plugin, map)| {
            let surface = surface(description, &plugin)?;
            Ok(Placed { surface, map })
        });
        let operands: Result<_, SceneErrors> = operands.collect();
        Ok(Self {
            operation: config.operation,
            operands: operands?,
        })
    }
}

impl Surface for Csg {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let count = self.operands.len() as u32;
        let mut inside = Vec::new();
        let mut ends: Vec<(usize, Root)> = Vec::new();
        for (number, operand) in self.operands.iter().enumerate() {
            let roots = operand.meet(line)?;
            inside.push(roots.from_inside);
            let alternating = alternating(roots)?;
            ends.extend(alternating.into_iter().map(|root| (number, root)));
        }
        let from_inside = self.operation.inside(&inside);
        let (mut all, mut was) = (Vec::new(), from_inside);
        // Roots at equal t are processed together.
        let mut ends = sorted(ends)?.into_iter().peekable();
        while let Some((mut first, mut here)) = ends.next() {
            inside[first] = here.enters;
            let at = here.t.clone();
            while let Some((number, root)) =
                ends.next_if(|(_, root)| root.t.compare(&at) == Ok(Ordering::Equal))
            {
                inside[number] = root.enters;
                if number < first {
                    (first, here) = (number, root);
                }
            }
            let is = self.operation.inside(&inside);
            if is != was {
                let taken_away = first > 0 && matches!(self.operation, Operation::Difference);
                here.normal = if taken_away { -here.normal } else { here.normal };
                here.enters = is;
                here.primitive = here.primitive * count + first as u32;
                all.push(here);
            }
            was = is;
        }
        Ok(Roots { all, from_inside })
    }
}

/// Reduces the roots of a solid to alternating entries and exits. Roots at equal t, such as those
/// of several triangles, must agree. Nested or overlapping parts of a solid are undecided.
fn alternating(roots: Roots) -> Decided<Vec<Root>> {
    let mut found: Vec<Root> = Vec::new();
    for (_, root) in sorted(roots.all.into_iter().map(|root| (0, root)))? {
        let inside = found.last().map_or(roots.from_inside, |last| last.enters);
        if root.enters != inside {
            found.push(root);
            continue;
        }
        let again = match found.last() {
            Some(last) => last.t.compare(&root.t)? == Ordering::Equal,
            None => false,
        };
        if !again {
            return Err(Undecided);
        }
    }
    Ok(found)
}

/// Sorts by t, if the order is certain.
fn sorted(ends: impl IntoIterator<Item = (usize, Root)>) -> Decided<Vec<(usize, Root)>> {
    let mut sorted: Vec<(usize, Root)> = Vec::new();
    for end in ends {
        let mut place = sorted.len();
        while place > 0 && sorted[place - 1].1.t.compare(&end.1.t)? == Ordering::Greater {
            place -= 1;
        }
        sorted.insert(place, end);
    }
    Ok(sorted)
}
