//! The order in which coincident surfaces lie along their common normal.
//!
//! Solids that lie behind the common surface (their outside is in front of it) come first, then
//! open surfaces, then solids in front of it. Among solids on one side, the lowest number is
//! nearest to the middle. Among open surfaces, the lowest number is first on the side that its own
//! normal points to, and the others follow in the same way.

use super::contact::Contact;
use super::parts::Parts;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_core::DVec3;

/// Surfaces that coincide directly or through others.
pub(super) struct Class {
    /// The common normal. Not used for curved surfaces, whose normal points outward.
    pub(super) across: DVec3,
    pub(super) flat: bool,
    pub(super) sides: Vec<Side>,
    /// Indices of the contacts among them.
    pub(super) contacts: Vec<usize>,
}

/// The surfaces of one shape in a class.
pub(super) struct Side {
    pub(super) shape: usize,
    /// Displacement along the normal, in gaps.
    pub(super) level: i64,
    /// Indices of its contacts.
    pub(super) contacts: Vec<usize>,
}

/// All surfaces of a shape in a plane, or a single curved part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Node {
    Flat { plane: usize, shape: usize },
    Curved { part: usize },
}

/// Position of a surface along the normal.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Behind,
    Open,
    Before,
}

/// The classes, each with its surfaces in order.
pub(super) fn classes(parts: &Parts<'_>, contacts: &[Contact]) -> Vec<Class> {
    let mut numbers: BTreeMap<Node, usize> = BTreeMap::new();
    let mut nodes: Vec<(usize, BTreeSet<usize>)> = Vec::new();
    let mut number_of = |contact: &Contact, part: usize| {
        let shape = parts.all[part].shape;
        let node = match contact.plane {
            Some(plane) => Node::Flat { plane, shape },
            None => Node::Curved { part },
        };
        let number = *numbers.entry(node).or_insert_with(|| {
            nodes.push((shape, BTreeSet::new()));
            nodes.len() - 1
        });
        nodes[number].1.insert(part);
        number
    };
    let pairs: Vec<[usize; 2]> = contacts
        .iter()
        .map(|contact| contact.parts.map(|part| number_of(contact, part)))
        .collect();
    // Union-find: each node points to a lower one of its class, or to itself.
    let mut lower: Vec<usize> = (0..nodes.len()).collect();
    fn lowest(lower: &mut [usize], mut node: usize) -> usize {
        while lower[node] != node {
            lower[node] = lower[lower[node]];
            node = lower[node];
        }
        node
    }
    for [a, b] in &pairs {
        let (a, b) = (lowest(&mut lower, *a), lowest(&mut lower, *b));
        lower[a.max(b)] = a.min(b);
    }
    let mut grouped: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (contact, [a, _]) in pairs.iter().enumerate() {
        grouped.entry(lowest(&mut lower, *a)).or_default().push(contact);
    }
    let class = |contacts_of: Vec<usize>| {
        let first = &contacts[contacts_of[0]];
        let across = first.points[0].1;
        let flat = first.plane.is_some();
        let members: BTreeSet<usize> = contacts_of.iter().flat_map(|contact| pairs[*contact]).collect();
        let mut contacts_by_node: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for contact in &contacts_of {
            for node in pairs[*contact] {
                contacts_by_node.entry(node).or_default().push(*contact);
            }
        }
        let edges: BTreeSet<[usize; 2]> = contacts_of.iter().map(|contact| pairs[*contact]).collect();
        let members: Vec<Member> = members
            .into_iter()
            .map(|node| {
                let (shape, own) = &nodes[node];
                let along = own
                    .first()
                    .and_then(|part| normal(parts, *part))
                    .is_none_or(|n| n.dot(across) > 0.0);
                let solid = own.iter().all(|part| parts.solid(*part));
                Member {
                    node,
                    shape: *shape,
                    along,
                    place: match (solid, along) {
                        (false, _) => Place::Open,
                        (true, true) => Place::Behind,
                        (true, false) => Place::Before,
                    },
                    size: parts.sizes[*shape],
                }
            })
            .collect();
        let sides = levels(ordered(members), &edges)
            .into_iter()
            .map(|(member, level)| Side {
                shape: member.shape,
                level,
                contacts: contacts_by_node.remove(&member.node).unwrap_or_default(),
            });
        Class {
            across,
            flat,
            sides: sides.collect(),
            contacts: contacts_of,
        }
    };
    grouped.into_values().map(class).collect()
}

/// The normal of a flat part.
fn normal(parts: &Parts<'_>, part: usize) -> Option<DVec3> {
    use whitstone_core::SurfacePart;
    match &parts.all[part].surface {
        SurfacePart::Plane { normal, .. } | SurfacePart::Polygon { normal, .. } => Some(*normal),
        _ => None,
    }
}

#[derive(Clone, Copy)]
struct Member {
    node: usize,
    shape: usize,
    /// Whether its normal points along the common one.
    along: bool,
    place: Place,
    /// Number of elements of its shape.
    size: usize,
}

/// Sorts from back to front, along the normal.
fn ordered(mut members: Vec<Member>) -> Vec<Member> {
    members.sort_by_key(|member| (member.shape, member.node));
    let of = |place: Place| members.iter().filter(move |member| member.place == place);
    let mut order: Vec<Member> = of(Place::Behind).rev().copied().collect();
    let (mut back, mut front) = (Vec::new(), Vec::new());
    for member in of(Place::Open) {
        if member.along {
            front.push(*member);
        } else {
            back.push(*member);
        }
    }
    // The first ones are outermost.
    order.extend(back);
    order.extend(front.into_iter().rev());
    order.extend(of(Place::Before));
    order
}

/// The displacement of each member in gaps. A member moves further than those behind it that it
/// touches. The member that is hardest to move stays in place.
fn levels(order: Vec<Member>, edges: &BTreeSet<[usize; 2]>) -> Vec<(Member, i64)> {
    let mut places: BTreeMap<usize, usize> = BTreeMap::new();
    for (place, member) in order.iter().enumerate() {
        places.insert(member.node, place);
    }
    let mut behind: Vec<Vec<usize>> = vec![Vec::new(); order.len()];
    for edge in edges {
        let [a, b] = edge.map(|node| places[&node]);
        behind[a.max(b)].push(a.min(b));
    }
    let mut level: Vec<i64> = Vec::new();
    for place in 0..order.len() {
        let least = behind[place].iter().map(|other| level[*other] + 1).max();
        level.push(least.unwrap_or(0));
    }
    let hard = |member: &Member| {
        (
            member.size > 1,
            member.place == Place::Open,
            member.size,
            std::cmp::Reverse(member.shape),
        )
    };
    let anchor = (0..order.len()).max_by_key(|place| hard(&order[*place]));
    let shift = anchor.map_or(0, |anchor| level[anchor]);
    order
        .into_iter()
        .zip(level)
        .map(|(member, level)| (member, level - shift))
        .collect()
}
