//! Solids: shapes with an inside, and the intervals in which lines are inside them.

use crate::config::PluginRef;
use crate::{Interval, ShapeHit, SourceSpan};
use glam::DVec2;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};
use smallvec::SmallVec;
use std::borrow::Cow;
use std::fmt;
use toml::Spanned;

/// An interval of a line inside a solid. Parameters may be negative, since the line extends behind
/// the ray's start, and infinite for unbounded solids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where the line enters the solid.
    pub enter: ShapeHit,
    /// Where the line leaves the solid; farther along.
    pub exit: ShapeHit,
}

/// The intervals of a line inside a solid: ascending, non-empty, without common points.
pub type Spans = SmallVec<[Span; 4]>;

/// The ends of spans in order, entries and exits in turn.
pub fn ends(spans: &[Span]) -> SmallVec<[ShapeHit; 8]> {
    spans.iter().flat_map(|span| [span.enter, span.exit]).collect()
}

impl Span {
    /// `None` if the interval is empty.
    #[inline]
    pub fn new(enter: ShapeHit, exit: ShapeHit) -> Option<Self> {
        (enter.t < exit.t).then_some(Self { enter, exit })
    }
}

impl ShapeHit {
    /// A hit with sub-primitive 0 and zero parameters; also an end of a span at infinity.
    pub const fn plain(t: f64) -> Self {
        Self {
            t,
            primitive: 0,
            prim_uv: DVec2::ZERO,
        }
    }
}

/// The spans between sorted crossings of a closed surface, which enter and leave alternately. Pairs
/// at the same position cancel; a last crossing without a partner is ignored.
pub fn pair_up(crossings: &[ShapeHit]) -> Spans {
    let mut spans = Spans::new();
    for pair in crossings.chunks_exact(2) {
        push(&mut spans, pair[0], pair[1]);
    }
    spans
}

/// Appends a span that does not begin before the last one ends. If they touch, they are merged; an
/// empty span is ignored.
pub fn push(spans: &mut Spans, enter: ShapeHit, exit: ShapeHit) {
    let Some(span) = Span::new(enter, exit) else {
        return;
    };
    match spans.last_mut() {
        Some(last) if last.exit.t >= enter.t => last.exit = exit,
        _ => spans.push(span),
    }
}

/// The nearest end of a span inside the interval.
///
/// For a ray that starts on the surface, `inside` says whether it enters the solid. The first end
/// beyond its start must then be an exit if `inside`, otherwise an entry. If it is not, it is the
/// start itself, moved forward by rounding, and is skipped.
pub fn first_end(spans: &[Span], interval: Interval, inside: Option<bool>) -> Option<ShapeHit> {
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

/// A shape written inline as an operand of another shape, with its position in the source.
#[derive(Clone, Debug)]
pub struct SolidRef {
    /// Position in the source.
    pub span: SourceSpan,
    /// The inline table.
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

    fn end(t: f64) -> ShapeHit {
        ShapeHit::plain(t)
    }

    fn spans(ends: &[f64]) -> Spans {
        pair_up(&ends.iter().map(|t| end(*t)).collect::<Vec<_>>())
    }

    fn pairs(spans: &Spans) -> Vec<(f64, f64)> {
        spans.iter().map(|span| (span.enter.t, span.exit.t)).collect()
    }

    #[test]
    fn crossings_pair_up_and_empty_spans_are_ignored() {
        assert_eq!(pairs(&spans(&[1.0, 2.0, 3.0, 5.0])), [(1.0, 2.0), (3.0, 5.0)]);
        assert!(spans(&[1.0, 1.0]).is_empty());
        assert_eq!(pairs(&spans(&[1.0, 2.0, 2.0, 5.0])), [(1.0, 5.0)]);
        assert_eq!(pairs(&spans(&[1.0, 2.0, 3.0])), [(1.0, 2.0)]);
        assert!(spans(&[f64::NAN, 2.0]).is_empty());
    }

    #[test]
    fn the_first_end_after_the_start_is_an_entry_or_an_exit_as_expected() {
        let first =
            |ends: &[f64], inside| first_end(&spans(ends), Interval::FORWARD, inside).map(|end| end.t);
        let two = [-1.0, 1.0, 3.0, 5.0];
        assert_eq!(first(&two, None), Some(1.0));
        // Rounding may place the start slightly in front of or behind the ray's origin.
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
