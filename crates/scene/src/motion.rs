//! The `motion` of a shape: keyframes, between which the numbers of transform steps are
//! interpolated. Section 9 of the model.

use crate::document::{Value, type_name};
use crate::transform::{fault_at, parse_steps};
use serde::Deserialize;
use serde::de::IgnoredAny;
use toml::Spanned;
use toml::de::DeValue;
use whitstone_core::config::{Finite, decode};
use whitstone_core::transform_steps::TransformOp;
use whitstone_core::{DAffine3, SceneError, SceneErrors, SourceSpan, Transform};

/// The motion of a shape.
#[derive(Clone, Debug)]
pub struct Motion {
    /// The map of the shape's own `transform`, which is applied first.
    own: DAffine3,
    /// At least two, with ascending times and the same kinds of steps.
    keyframes: Vec<Keyframe>,
}

/// The steps at a time.
#[derive(Clone, Debug)]
struct Keyframe {
    /// In seconds.
    time: f64,
    steps: Vec<Spanned<TransformOp>>,
    /// Place of the value of `transform`.
    span: SourceSpan,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawKeyframe {
    time: Spanned<Finite>,
    /// Read by [`parse_steps`].
    #[serde(rename = "transform")]
    _transform: IgnoredAny,
}

impl Motion {
    /// Parses the value of the key `motion` of a shape whose own transform is `own`.
    ///
    /// # Errors
    ///
    /// All errors of the keyframes, each at its position.
    pub(crate) fn parse(value: &Value<'_>, own: &Transform) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        let help = "motion = [{ time = 0, transform = { translate = [0, 0, 0] } }, { time = 1, transform = { translate = [1, 0, 0] } }]";
        let items = match value.get_ref() {
            DeValue::Array(items) if items.len() >= 2 => items,
            DeValue::Array(items) => {
                let found = items.len();
                let message = format!("a motion needs at least two keyframes, found {found}");
                return Err(SceneError::at(value.span(), message).with_help(help).into());
            }
            other => {
                let message = format!("expected a list of keyframes, found {}", type_name(other));
                return Err(SceneError::at(value.span(), message).with_help(help).into());
            }
        };
        let mut keyframes: Vec<Keyframe> = Vec::new();
        for item in items {
            let DeValue::Table(table) = item.get_ref() else {
                let message = format!(
                    "expected a keyframe {{ time, transform }}, found {}",
                    type_name(item.get_ref())
                );
                errors.0.push(SceneError::at(item.span(), message));
                continue;
            };
            let raw: Option<RawKeyframe> = errors.take(decode(&Spanned::new(item.span(), table.clone())));
            let steps = table
                .get("transform")
                .map(|steps| (steps.span(), parse_steps(steps)));
            let steps = steps.and_then(|(span, steps)| Some((span, errors.take(steps)?)));
            let (Some(raw), Some((span, steps))) = (raw, steps) else {
                continue;
            };
            let time = raw.time.get_ref().get();
            if let Some(before) = keyframes.last() {
                if time <= before.time {
                    let message = format!(
                        "expected a time after {} s, that of the keyframe before",
                        before.time
                    );
                    errors.0.push(SceneError::at(raw.time.span(), message));
                } else if !(time - before.time).is_finite() {
                    let message = "the time between two keyframes is too large to be a number";
                    errors.0.push(SceneError::at(raw.time.span(), message));
                }
                if steps.len() != before.steps.len() {
                    let message = format!(
                        "expected as many steps as in the keyframe before, {}, found {}",
                        before.steps.len(),
                        steps.len()
                    );
                    errors.0.push(SceneError::at(span.clone(), message));
                }
                for (from, to) in before.steps.iter().zip(&steps) {
                    if let Err(fault) = from.get_ref().between(to.get_ref(), 0.0) {
                        errors.0.push(fault_at(to.span(), fault));
                    }
                }
            }
            keyframes.push(Keyframe { time, steps, span });
        }
        errors.into_result(Self {
            own: *own.world_from_object(),
            keyframes,
        })
    }

    /// The object-to-world transform at a time in seconds.
    ///
    /// # Errors
    ///
    /// If it is singular, at the keyframe after that time.
    pub fn at(&self, time: f64) -> Result<Transform, SceneErrors> {
        let after = self.keyframes.partition_point(|keyframe| keyframe.time <= time);
        let last = self.keyframes.len() - 1;
        let (from, to) = (
            &self.keyframes[after.saturating_sub(1)],
            &self.keyframes[after.min(last)],
        );
        let u = if to.time > from.time {
            (time - from.time) / (to.time - from.time)
        } else {
            0.0
        };
        let mut world_from_object = self.own;
        for (from, to) in from.steps.iter().zip(&to.steps) {
            let step = from.get_ref().between(to.get_ref(), u);
            world_from_object = step.map_err(|fault| fault_at(to.span(), fault))? * world_from_object;
        }
        Transform::new(world_from_object).ok_or_else(|| {
            let message = format!(
                "at {time} s the moving transform is singular: it flattens the shape or is not finite"
            );
            let error = SceneError::at(to.span.clone(), message);
            error
                .with_help("no interpolated scale factor may be zero at a time of the film")
                .into()
        })
    }
}
