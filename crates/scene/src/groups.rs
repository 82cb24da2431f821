//! Groups of shapes: finds those that are instantiated, and numbers their shapes.

use crate::Description;
use std::collections::BTreeMap;
use whitstone_core::config::GroupRef;
use whitstone_core::{SceneError, SceneErrors, SourceSpan, nearest};

/// Maximum nesting of groups. A ray is transformed at each level, and hand-written scenes are much
/// shallower.
const MAX_NESTING: usize = 16;

/// A group that at least one instance uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedGroup<'d> {
    /// The id, as in `[group.ID]`.
    pub id: &'d str,
    /// Number of its first shape.
    pub first_shape: u32,
}

/// The groups in use, each after the groups that it instantiates itself.
pub(crate) fn plan<'d>(description: &'d Description<'_>, errors: &mut SceneErrors) -> Vec<PlannedGroup<'d>> {
    let mut search = Search {
        description,
        errors,
        open: Vec::new(),
        nesting: BTreeMap::new(),
        order: Vec::new(),
    };
    for place in description.shapes.iter().filter_map(|shape| shape.group.as_ref()) {
        search.follow(place);
    }
    let mut planned = search.order;
    let mut by_id: Vec<&mut PlannedGroup<'_>> = planned.iter_mut().collect();
    by_id.sort_unstable_by_key(|group| group.id);
    let mut next = description.shapes.len() as u32;
    for group in by_id {
        group.first_shape = next;
        next += description.groups[group.id].shapes.len() as u32;
    }
    planned
}

struct Search<'a, 'd, 's> {
    description: &'d Description<'s>,
    errors: &'a mut SceneErrors,
    /// The groups on the path of the search.
    open: Vec<&'d str>,
    /// The nesting depth of each finished group, including itself.
    nesting: BTreeMap<&'d str, usize>,
    order: Vec<PlannedGroup<'d>>,
}

impl<'d> Search<'_, 'd, '_> {
    /// Returns the nesting depth of a group, including itself.
    fn follow(&mut self, place: &'d GroupRef) -> usize {
        let Some((id, group)) = self.description.groups.get_key_value(&place.id) else {
            if !self
                .description
                .faulty
                .shared
                .contains(&("group", place.id.clone()))
            {
                let known = self.description.groups.keys();
                self.errors
                    .0
                    .push(unknown_id("group", &place.span, &place.id, known));
            }
            return 0;
        };
        let known = self.nesting.get(id.as_str()).copied();
        let problem = if self.open.contains(&id.as_str()) {
            Some(format!("the group \"{id}\" contains itself"))
        } else if self.open.len() + known.unwrap_or(1) > MAX_NESTING {
            Some(format!("groups are nested more than {MAX_NESTING} deep"))
        } else {
            None
        };
        if let Some(problem) = problem {
            self.errors.0.push(SceneError::at(place.span.clone(), problem));
            return 0;
        }
        if let Some(nesting) = known {
            return nesting;
        }
        self.open.push(id);
        let places = group.shapes.iter().filter_map(|shape| shape.group.as_ref());
        let inside = places.map(|place| self.follow(place)).max().unwrap_or(0);
        self.open.pop();
        self.nesting.insert(id, inside + 1);
        self.order.push(PlannedGroup { id, first_shape: 0 });
        inside + 1
    }
}

/// The error that no item of a kind has this id, with the nearest existing one.
pub fn unknown_id<'a>(
    what: &str,
    span: &SourceSpan,
    id: &str,
    known: impl Iterator<Item = &'a String>,
) -> SceneError {
    let known: Vec<&str> = known.map(String::as_str).collect();
    let error = SceneError::at(span.clone(), format!("no {what} has the id \"{id}\""));
    error.with_help(match nearest(id, known.iter().copied()) {
        Some(near) => format!("did you mean \"{near}\"?"),
        None if known.is_empty() && what == "group" => format!("add [[group.{id}.shape]]"),
        None if known.is_empty() => format!("add [{what}.{id}], or write the {what} inline"),
        None => format!("the scene has the {what}s {}", known.join(", ")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sources;
    use std::path::Path;

    /// The plan as (id, first shape), and the error messages.
    fn planned(text: &str) -> (Vec<(String, u32)>, Vec<String>) {
        let text = format!("{text}\n[camera]\ntype = \"perspective\"\n");
        let sources = Sources::from_text("groups.toml", &text, Path::new(""), &[]).unwrap();
        let description = Description::parse(&sources).into_result().unwrap();
        let mut errors = SceneErrors::default();
        let plan = plan(&description, &mut errors);
        let plan = plan.iter().map(|group| (group.id.to_owned(), group.first_shape));
        (
            plan.collect(),
            errors.0.into_iter().map(|error| error.message).collect(),
        )
    }

    #[test]
    fn groups_in_use_are_built_innermost_first_and_numbered_by_id() {
        let text = r#"
            [[shape]]
            type = "instance"
            group = "outer"
            [[shape]]
            type = "sphere"
            [[group.outer.shape]]
            type = "instance"
            group = "z"
            [[group.outer.shape]]
            type = "instance"
            group = "a"
            [[group.z.shape]]
            type = "instance"
            group = "a"
            [[group.a.shape]]
            type = "box"
            [[group.a.shape]]
            type = "disk"
            [[group.unused.shape]]
            type = "instance"
            group = "nowhere"
        "#;
        let (plan, errors) = planned(text);
        let expected = [("a", 2), ("z", 6), ("outer", 4)];
        assert_eq!(plan, expected.map(|(id, first)| (id.to_owned(), first)));
        assert!(errors.is_empty(), "{errors:?}");
    }

    #[test]
    fn nesting_may_be_sixteen_deep_on_every_path() {
        let chain = |deepest: usize| {
            let link = |k: usize| {
                format!(
                    "[[group.g{k}.shape]]\ntype = \"instance\"\ngroup = \"g{}\"\n",
                    k - 1
                )
            };
            let links: String = (2..=deepest).map(link).collect();
            format!("[[group.g1.shape]]\ntype = \"box\"\n{links}")
        };
        let place = |k: usize| format!("[[shape]]\ntype = \"instance\"\ngroup = \"g{k}\"\n");
        assert_eq!(planned(&(chain(16) + &place(16))).1, [""; 0]);
        assert_eq!(
            planned(&(chain(17) + &place(17))).1,
            ["groups are nested more than 16 deep"]
        );
        // The depth of the lower groups is already known.
        let both = chain(17) + &place(9) + &place(17);
        assert_eq!(planned(&both).1, ["groups are nested more than 16 deep"]);
    }
}
