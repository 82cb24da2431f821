//! Parameter lists: `"type name" value`.

use super::token::At;
use crate::files::shorten;

/// Types of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Integer,
    Float,
    Point2,
    Vector2,
    Point3,
    Vector3,
    Normal,
    Rgb,
    Blackbody,
    Spectrum,
    Bool,
    Text,
    Texture,
}

/// The words for types. `point`, `vector` and `normal` have three coordinates.
pub(super) const KINDS: [(&str, Kind); 16] = [
    ("integer", Kind::Integer),
    ("float", Kind::Float),
    ("point2", Kind::Point2),
    ("vector2", Kind::Vector2),
    ("point3", Kind::Point3),
    ("point", Kind::Point3),
    ("vector3", Kind::Vector3),
    ("vector", Kind::Vector3),
    ("normal", Kind::Normal),
    ("normal3", Kind::Normal),
    ("rgb", Kind::Rgb),
    ("blackbody", Kind::Blackbody),
    ("spectrum", Kind::Spectrum),
    ("bool", Kind::Bool),
    ("string", Kind::Text),
    ("texture", Kind::Texture),
];

impl Kind {
    /// The name in messages.
    pub(super) fn word(self) -> &'static str {
        KINDS
            .iter()
            .find(|(_, kind)| *kind == self)
            .map_or("", |(word, _)| word)
    }

    /// Numbers in each value.
    pub(super) fn width(self) -> usize {
        match self {
            Self::Point2 | Self::Vector2 => 2,
            Self::Point3 | Self::Vector3 | Self::Normal | Self::Rgb => 3,
            _ => 1,
        }
    }
}

/// The values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Bools(Vec<bool>),
}

impl Values {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.len(),
            Self::Bools(values) => values.len(),
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Param {
    pub(super) kind: Kind,
    pub(super) name: String,
    pub(super) values: Values,
    pub(super) at: At,
}

/// The parameters of a directive, with marks on those that were read.
#[derive(Clone, Debug)]
pub(super) struct Args {
    /// The directive and its plugin, for messages.
    pub(super) what: String,
    pub(super) at: At,
    params: Vec<Param>,
    used: Vec<bool>,
    /// The number of parameters of the directive itself; the rest is from `Attribute` directives.
    own: usize,
    /// All names that were asked for.
    asked: Vec<&'static str>,
}

impl Args {
    /// The parameters of a directive; those in `defaults` count where it lacks them.
    pub(super) fn new(what: String, at: At, mut params: Vec<Param>, defaults: &[Param]) -> Self {
        let own = params.len();
        for default in defaults {
            if params[..own].iter().all(|param| param.name != default.name) {
                params.push(default.clone());
            }
        }
        Self {
            what,
            at,
            used: vec![false; params.len()],
            params,
            own,
            asked: Vec::new(),
        }
    }

    /// Takes the parameter with this name.
    pub(super) fn take(&mut self, name: &'static str) -> Option<Param> {
        if !self.asked.contains(&name) {
            self.asked.push(name);
        }
        // The last `Attribute` counts.
        let index = self.params.iter().rposition(|param| param.name == name)?;
        for (param, used) in self.params.iter().zip(&mut self.used) {
            *used |= param.name == name;
        }
        Some(self.params[index].clone())
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.params.iter().any(|param| param.name == name)
    }

    /// A parameter, which stays unread.
    pub(super) fn peek(&self, name: &str) -> Option<&Param> {
        self.params.iter().rfind(|param| param.name == name)
    }

    /// The type of a parameter, which stays unread.
    pub(super) fn kind(&self, name: &str) -> Option<Kind> {
        self.peek(name).map(|param| param.kind)
    }

    /// Takes parameters that have no effect on the result.
    pub(super) fn ignore(&mut self, names: &[&'static str]) {
        for name in names {
            self.take(name);
        }
    }

    /// Takes everything, so that nothing is unknown.
    pub(super) fn ignore_all(&mut self) {
        self.used.fill(true);
    }

    /// Messages for the parameters that were not read, with their places and the nearest names.
    pub(super) fn unknown(&self) -> Vec<(At, String, Option<&'static str>)> {
        let own = self.params.iter().zip(&self.used).take(self.own);
        own.filter(|(_, used)| !**used)
            .map(|(param, _)| {
                let message = format!("unknown parameter \"{}\" of {}", shorten(&param.name), self.what);
                let near = whitstone_core::nearest(&param.name, self.asked.iter().copied());
                (param.at, message, near)
            })
            .collect()
    }
}
