//! Groups of shapes: finds those that are instantiated, and numbers their shapes.

use crate::{Description, ReplacedMaterial, ShapeTable};
use std::collections::{BTreeMap, BTreeSet};
use whitstone_core::config::{GroupRef, PluginRef};
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

/// Maximum number of variants of shapes. Nested instances multiply them.
const MAX_VARIANTS: usize = 1 << 20;

/// How hits show a shape, by the number of a shape or of a variant. A *variant* is a shape of a
/// group as an instance shows it that replaces its material or takes its shadow.
#[derive(Clone, Copy, Debug)]
pub struct Appearance<'d, 's> {
    /// Number of the shape.
    pub shape: u32,
    /// Its table.
    pub table: &'d ShapeTable<'s>,
    /// `None` for the default material.
    pub material: Option<&'d (SourceSpan, PluginRef)>,
    /// Whether it casts shadows.
    pub casts_shadow: bool,
}

/// The shapes and their variants.
#[derive(Clone, Debug, Default)]
pub struct Appearances<'d, 's> {
    /// All shapes by number, then all variants.
    pub all: Vec<Appearance<'d, 's>>,
    shapes: usize,
    /// For the numbers of instances: pairs of the number of a shape (or variant) in the group and
    /// that of its variant in this instance, both ascending.
    pub of_instances: BTreeMap<u32, Vec<(u32, u32)>>,
}

impl<'d, 's> Appearances<'d, 's> {
    /// From all shapes by number, and from the groups in use, each after those that it
    /// instantiates.
    pub(crate) fn new(
        description: &'d Description<'s>,
        shapes: Vec<&'d ShapeTable<'s>>,
        groups: &[PlannedGroup<'d>],
        errors: &mut SceneErrors,
    ) -> Self {
        let all = shapes.iter().zip(0..).map(|(table, shape)| Appearance {
            shape,
            table,
            material: table.material.as_ref(),
            casts_shadow: table.casts_shadow,
        });
        let mut appearances = Self {
            all: all.collect(),
            shapes: shapes.len(),
            of_instances: BTreeMap::new(),
        };
        let changes = |table: &&ShapeTable<'_>| {
            table.group.is_some() && !(table.casts_shadow && table.materials.is_empty())
        };
        if !shapes.iter().any(changes) {
            return appearances;
        }
        for table in &shapes {
            for ReplacedMaterial { id, span, .. } in &table.materials {
                let faulty = || description.faulty.shared.contains(&("material", id.clone()));
                if !description.materials.contains_key(id) && !faulty() {
                    let known = description.materials.keys();
                    errors.0.push(unknown_id("material", span, id, known));
                }
            }
        }
        // The numbers that hits in each group have.
        let mut reached: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
        let top = PlannedGroup {
            id: "",
            first_shape: 0,
        };
        let structures = groups
            .iter()
            .map(|group| (group, &description.groups[group.id].shapes));
        for (group, tables) in structures.chain([(&top, &description.shapes)]) {
            let mut numbers = BTreeSet::new();
            let mut unchanged = BTreeSet::new();
            for (table, number) in tables.iter().zip(group.first_shape..) {
                let Some(place) = &table.group else {
                    numbers.insert(number);
                    continue;
                };
                // Empty for a group with errors.
                let inside = reached.get(place.id.as_str()).into_iter().flatten();
                if changes(&table) {
                    numbers.extend(appearances.shown(table, number, inside.copied()));
                } else if unchanged.insert(&place.id) {
                    numbers.extend(inside);
                }
                if appearances.all.len() > appearances.shapes + MAX_VARIANTS {
                    let message =
                        format!("instances change the materials of more than {MAX_VARIANTS} shapes");
                    errors.0.push(SceneError::at(place.span.clone(), message));
                    return appearances;
                }
            }
            reached.insert(group.id, numbers);
        }
        appearances
    }

    /// The number of shapes, which variants follow.
    pub fn shapes(&self) -> usize {
        self.shapes
    }

    /// The numbers of the shapes of a group in an instance; adds the variants that it needs.
    fn shown(
        &mut self,
        instance: &'d ShapeTable<'s>,
        number: u32,
        inside: impl Iterator<Item = u32>,
    ) -> Vec<u32> {
        let mut pairs = Vec::new();
        let shown = inside.map(|from| {
            let old = self.all[from as usize];
            let replaced = old.material.and_then(|(_, material)| match material {
                PluginRef::Shared(id) => instance.materials.iter().find(|replaced| replaced.id == *id),
                PluginRef::Inline(_) => None,
            });
            let new = Appearance {
                material: replaced.map(|replaced| &replaced.by).or(old.material),
                casts_shadow: old.casts_shadow && instance.casts_shadow,
                ..old
            };
            if replaced.is_none() && new.casts_shadow == old.casts_shadow {
                return from;
            }
            let to = self.all.len() as u32;
            self.all.push(new);
            pairs.push((from, to));
            to
        });
        let shown = shown.collect();
        if !pairs.is_empty() {
            self.of_instances.insert(number, pairs);
        }
        shown
    }
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

    /// For each variant, the number of its shape and the id of its material; the pairs of each
    /// instance; and the error messages.
    fn variants(text: &str) -> (Vec<(u32, String)>, Pairs, Vec<String>) {
        let materials = ["one", "two", "three"].map(|id| format!("[material.{id}]\ntype = \"matte\"\n"));
        let text = format!(
            "{text}\n{}\n[camera]\ntype = \"perspective\"\n",
            materials.concat()
        );
        let sources = Sources::from_text("groups.toml", &text, Path::new(""), &[]).unwrap();
        let description = Description::parse(&sources).into_result().unwrap();
        let mut errors = SceneErrors::default();
        let groups = plan(&description, &mut errors);
        let shapes = crate::plan::shapes_by_number(&description, &groups);
        let found = Appearances::new(&description, shapes, &groups, &mut errors);
        let variants = found.all[found.shapes()..].iter().map(|variant| {
            let material = variant.material.map(|(_, material)| match material {
                PluginRef::Shared(id) => id.clone(),
                PluginRef::Inline(_) => "inline".to_owned(),
            });
            (variant.shape, material.unwrap_or_default())
        });
        let messages = errors.0.into_iter().map(|error| error.message).collect();
        (variants.collect(), found.of_instances, messages)
    }

    type Pairs = BTreeMap<u32, Vec<(u32, u32)>>;

    const CHAIN: &str = r#"
        [[shape]]
        type = "instance"
        group = "outer"
        materials = { two = "three" }
        [[shape]]
        type = "instance"
        group = "outer"
        [[group.inner.shape]]
        type = "box"
        material = "one"
        [[group.inner.shape]]
        type = "disk"
        [[group.outer.shape]]
        type = "instance"
        group = "inner"
        materials = { one = "two" }
        [[group.outer.shape]]
        type = "instance"
        group = "inner"
    "#;

    #[test]
    fn instances_replace_materials_from_the_innermost() {
        // Shapes 0 and 1 are those of the scene, 2 and 3 of the inner group, 4 and 5 of the outer.
        let (variants, pairs, errors) = variants(CHAIN);
        assert_eq!(variants, [(2, "two".to_owned()), (2, "three".to_owned())]);
        assert_eq!(pairs, BTreeMap::from([(4, vec![(2, 6)]), (0, vec![(6, 7)])]));
        assert!(errors.is_empty(), "{errors:?}");
        // Without a shadow, all that the instance places is changed.
        let dark = CHAIN.replace("materials = { two = \"three\" }", "casts_shadow = false");
        let (variants, pairs, _) = self::variants(&dark);
        let shapes: Vec<u32> = variants.iter().map(|(shape, _)| *shape).collect();
        assert_eq!(shapes, [2, 2, 3, 2]);
        assert_eq!(pairs[&0], [(2, 7), (3, 8), (6, 9)]);
        let (none, pairs, errors) = self::variants(&CHAIN.replace("two = ", "tow = "));
        assert_eq!((none.len(), pairs.len()), (1, 1));
        assert_eq!(errors, ["no material has the id \"tow\""]);
    }

    #[test]
    fn variants_that_multiply_are_an_error() {
        let level = |k: usize| {
            let inner = format!(
                "[[group.g{k}.shape]]\ntype = \"instance\"\ngroup = \"g{}\"\n",
                k - 1
            );
            format!("{inner}materials = {{ one = \"two\" }}\n{inner}materials = {{ two = \"one\" }}\n")
                .repeat(8)
        };
        let boxes = "[[group.g1.shape]]\ntype = \"box\"\nmaterial = \"one\"\n[[group.g1.shape]]\ntype = \"box\"\nmaterial = \"two\"\n";
        let levels: String = (2..=10).map(level).collect();
        let place = "[[shape]]\ntype = \"instance\"\ngroup = \"g10\"\n";
        let (_, _, errors) = variants(&format!("{boxes}{levels}{place}"));
        assert_eq!(
            errors,
            ["instances change the materials of more than 1048576 shapes"]
        );
    }
}
