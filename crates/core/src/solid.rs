//! Solids: shapes with an inside, and the parts of lines in them.

use crate::config::PluginRef;
use crate::{Interval, PrimitiveHit, SourceSpan};
use glam::DVec2;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};
use smallvec::SmallVec;
use std::borrow::Cow;
use std::fmt;
use toml::Spanned;

/// A part of a line that lies in a solid. The line goes on before the start of the ray, so
/// parameters may be negative, and infinite where the solid is endless.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where the line enters.
    pub enter: PrimitiveHit,
    /// Where it leaves; farther along.
    pub exit: PrimitiveHit,
}

/// The parts of a line that lie in a solid: in order, none of them empty, no two with a common
/// point.
pub type Spans = SmallVec<[Span; 4]>;

impl Span {
    /// `None` if nothing lies between the ends.
    #[inline]
    pub fn new(enter: PrimitiveHit, exit: PrimitiveHit) -> Option<Self> {
        (enter.t < exit.t).then_some(Self { enter, exit })
    }
}

impl PrimitiveHit {
    /// A hit with the only sub-primitive, without parameters; also the end of a span at infinity.
    pub const fn plain(t: f64) -> Self {
        Self {
            t,
            primitive: 0,
            params: DVec2::ZERO,
        }
    }
}

/// The spans between crossings of a closed surface, which are sorted: every other one is an entry.
/// Those at the same place cancel each other, and so does what has no partner.
pub fn pair_up(crossings: &[PrimitiveHit]) -> Spans {
    let mut spans = Spans::new();
    for pair in crossings.chunks_exact(2) {
        push(&mut spans, pair[0], pair[1]);
    }
    spans
}

/// Adds a span that begins no sooner than the last one ends. Where it begins just there, both
/// become one; an empty one is left out.
pub fn push(spans: &mut Spans, enter: PrimitiveHit, exit: PrimitiveHit) {
    let Some(span) = Span::new(enter, exit) else {
        return;
    };
    match spans.last_mut() {
        Some(last) if last.exit.t >= enter.t => last.exit = exit,
        _ => spans.push(span),
    }
}

/// The nearest end of a span inside the interval. `inside` says of a ray that starts on the surface
/// whether it goes into the solid: then the first end beyond its start is an exit, else an entry.
/// If it is not, it is the start itself, moved in front by rounding.
pub fn first_end(spans: &[Span], interval: Interval, inside: Option<bool>) -> Option<PrimitiveHit> {
    let ends = spans
        .iter()
        .flat_map(|span| [(false, span.enter), (true, span.exit)]);
    let mut ahead = ends.filter(|(_, end)| end.t > 0.0).peekable();
    if let (Some(inside), Some((exit, _))) = (inside, ahead.peek())
        && *exit != inside
    {
        ahead.next();
    }
    let (_, end) = ahead.find(|(_, end)| end.t > interval.min)?;
    interval.contains(end.t).then_some(end)
}

/// A shape that is written inside another one, as a part of it, with its place in the source.
#[derive(Clone, Debug)]
pub struct SolidRef {
    /// Place in the source.
    pub span: SourceSpan,
    /// The table that was there.
    pub shape: PluginRef,
}

impl<'de> Deserialize<'de> for SolidRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Inline(PluginRef);
        impl<'de> Deserialize<'de> for Inline {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct AnyShape;
                impl Visitor<'_> for AnyShape {
                    type Value = Inline;
                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str("a shape: a table with a `type`")
                    }
                    fn visit_str<E: Error>(self, text: &str) -> Result<Inline, E> {
                        Ok(Inline(text.into()))
                    }
                }
                deserializer.deserialize_any(AnyShape)
            }
        }
        let shape = Spanned::<Inline>::deserialize(deserializer)?;
        Ok(Self {
            span: shape.span(),
            shape: shape.into_inner().0,
        })
    }
}

impl JsonSchema for SolidRef {
    fn schema_name() -> Cow<'static, str> {
        "SolidRef".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "object",
            "properties": { "type": { "type": "string" } },
            "required": ["type"],
            "x-family": "shape"
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end(t: f64) -> PrimitiveHit {
        PrimitiveHit::plain(t)
    }

    fn spans(ends: &[f64]) -> Spans {
        pair_up(&ends.iter().map(|t| end(*t)).collect::<Vec<_>>())
    }

    fn pairs(spans: &Spans) -> Vec<(f64, f64)> {
        spans.iter().map(|span| (span.enter.t, span.exit.t)).collect()
    }

    #[test]
    fn crossings_pair_up_and_what_is_empty_is_not_there() {
        assert_eq!(pairs(&spans(&[1.0, 2.0, 3.0, 5.0])), [(1.0, 2.0), (3.0, 5.0)]);
        assert!(spans(&[1.0, 1.0]).is_empty());
        assert_eq!(pairs(&spans(&[1.0, 2.0, 2.0, 5.0])), [(1.0, 5.0)]);
        assert_eq!(pairs(&spans(&[1.0, 2.0, 3.0])), [(1.0, 2.0)]);
        assert!(spans(&[f64::NAN, 2.0]).is_empty());
    }

    #[test]
    fn what_a_ray_that_leaves_meets_first_is_of_the_right_kind() {
        let first =
            |ends: &[f64], inside| first_end(&spans(ends), Interval::FORWARD, inside).map(|end| end.t);
        let two = [-1.0, 1.0, 3.0, 5.0];
        assert_eq!(first(&two, None), Some(1.0));
        // The start may come out a little in front of or behind the ray.
        for start in [-1e-16, 0.0, 1e-16] {
            assert_eq!(first(&[start, 2.0, 3.0, 5.0], Some(true)), Some(2.0));
            assert_eq!(first(&[-2.0, start, 3.0, 5.0], Some(false)), Some(3.0));
            assert_eq!(first(&[-2.0, start], Some(false)), None);
        }
        let up_to = |max| first_end(&spans(&two), Interval { min: 1.0, max }, Some(true));
        assert_eq!(up_to(4.0).map(|end| end.t), Some(3.0));
        assert_eq!(up_to(3.0), None);
        assert_eq!(first(&[-1.0, f64::INFINITY], None), None);
    }
}
