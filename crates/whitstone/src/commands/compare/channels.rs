//! `--channel`: other channels than the colours, each with a limit of its own.

use serde::Serialize;
use whitstone_image::Image;
use whitstone_image::planes::RGB;

/// Channels, and by how much their values may differ.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ChannelLimit {
    /// The name of a channel, or the start of names and `*`.
    name: String,
    limit: f64,
}

impl ChannelLimit {
    /// `NAME` or `NAME=LIMIT`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let (name, limit) = match text.rsplit_once('=') {
            Some((name, limit)) => (name, super::at_least_0(limit)?),
            None => (text, 0.0),
        };
        match name.strip_suffix('*').unwrap_or(name) {
            "" if name.is_empty() => Err("expected the name of a channel".to_owned()),
            start if start.contains('*') => Err(format!("expected * only at the end of {name}")),
            _ => Ok(Self {
                name: name.to_owned(),
                limit,
            }),
        }
    }

    fn covers(&self, channel: &str) -> bool {
        match self.name.strip_suffix('*') {
            Some(start) => channel.starts_with(start),
            None => channel == self.name,
        }
    }
}

/// How a channel differs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct ChannelDifference {
    pub(super) name: String,
    pub(super) limit: f64,
    /// Pixels whose values differ by more than the limit, or are not both numbers.
    pub(super) pixels: usize,
    /// The first of the pixels with the largest difference, if there are any.
    pub(super) worst: Option<ChannelPixel>,
}

/// A pixel of a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct ChannelPixel {
    pub(super) at: [usize; 2],
    pub(super) ours: f32,
    pub(super) reference: f32,
}

impl ChannelDifference {
    /// What is wrong with it, or the number of pixels.
    pub(super) fn words(&self) -> String {
        let Self { pixels, limit, .. } = self;
        match &self.worst {
            None => format!("no pixel differs by more than {limit}"),
            Some(ChannelPixel {
                at: [x, y],
                ours,
                reference,
            }) => format!(
                "{} by more than {limit}; worst: pixel ({x}, {y}), ours {ours}, reference {reference}",
                match pixels {
                    1 => "1 pixel differs".to_owned(),
                    pixels => format!("{pixels} pixels differ"),
                }
            ),
        }
    }
}

/// Compares the channels that the limits cover, except the colours. The first limit that covers a
/// channel counts. Both images have the same size.
pub(super) fn compare(
    ours: &Image,
    reference: &Image,
    limits: &[ChannelLimit],
) -> Result<Vec<ChannelDifference>, String> {
    let mut names: Vec<&str> = (ours.channels())
        .chain(reference.channels())
        .map(|(name, _)| name)
        .filter(|name| !RGB.contains(name))
        .collect();
    names.sort_unstable();
    names.dedup();
    if let Some(limit) = limits
        .iter()
        .find(|limit| !names.iter().any(|name| limit.covers(name)))
    {
        let wanted = limit.name.as_str();
        return Err(match whitstone_core::nearest(wanted, names.iter().copied()) {
            Some(near) => format!("there is no channel {wanted}; did you mean {near}?"),
            None => format!(
                "there is no channel {wanted}; besides R, G, B there are {}",
                match names.as_slice() {
                    [] => "none".to_owned(),
                    names => names.join(", "),
                }
            ),
        });
    }
    let mut found = Vec::new();
    for name in names {
        let Some(limit) = limits.iter().find(|limit| limit.covers(name)) else {
            continue;
        };
        let (Some(mine), Some(theirs)) = (ours.channel(name), reference.channel(name)) else {
            let side = if ours.channel(name).is_none() {
                "ours"
            } else {
                "the reference"
            };
            return Err(format!("{side} has no channel {name}"));
        };
        found.push(of_channel(name, limit.limit, mine, theirs, ours.width()));
    }
    Ok(found)
}

fn of_channel(name: &str, limit: f64, ours: &[f32], reference: &[f32], width: usize) -> ChannelDifference {
    let mut pixels = 0;
    let mut worst: Option<(f64, usize)> = None;
    for (index, (&a, &b)) in ours.iter().zip(reference).enumerate() {
        // Equal infinities are equal: the depth of pixels that show nothing.
        let difference = match a == b {
            true => 0.0,
            false => (f64::from(a) - f64::from(b)).abs(),
        };
        // Not if one of them is not a number.
        if difference <= limit {
            continue;
        }
        pixels += 1;
        let size = if difference.is_nan() {
            f64::INFINITY
        } else {
            difference
        };
        if worst.is_none_or(|(largest, _)| size > largest) {
            worst = Some((size, index));
        }
    }
    ChannelDifference {
        name: name.to_owned(),
        limit,
        pixels,
        worst: worst.map(|(_, index)| ChannelPixel {
            at: [index % width, index / width],
            ours: ours[index],
            reference: reference[index],
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(channels: &[(&str, [f32; 2])]) -> Image {
        let mut image = Image::new(2, 1).unwrap();
        for (name, values) in channels {
            image.add_channel(*name, values.to_vec()).unwrap();
        }
        image
    }

    fn limits(texts: &[&str]) -> Vec<ChannelLimit> {
        texts
            .iter()
            .map(|text| ChannelLimit::parse(text).unwrap())
            .collect()
    }

    #[test]
    fn each_channel_has_its_limit() {
        let reference = image(&[
            ("R", [0.0; 2]),
            ("depth.Z", [1.0, f32::INFINITY]),
            ("id.I", [1.0, 2.0]),
            ("normal.X", [0.5, 0.25]),
        ]);
        let ours = image(&[
            ("R", [9.0; 2]),
            ("depth.Z", [1.01, f32::INFINITY]),
            ("id.I", [1.0, 3.0]),
            ("normal.X", [0.5, f32::NAN]),
        ]);
        let with = |texts: &[&str]| -> Vec<(String, usize)> {
            let found = compare(&ours, &reference, &limits(texts)).unwrap();
            found
                .into_iter()
                .map(|channel| (channel.name, channel.pixels))
                .collect()
        };
        let named = |pairs: &[(&str, usize)]| -> Vec<(String, usize)> {
            pairs
                .iter()
                .map(|(name, count)| ((*name).to_owned(), *count))
                .collect()
        };
        assert_eq!(with(&["depth.Z=0.02"]), named(&[("depth.Z", 0)]));
        assert_eq!(with(&["depth.Z=0.005"]), named(&[("depth.Z", 1)]));
        // Ids exactly; what is no number differs.
        assert_eq!(
            with(&["depth.*=0.1", "normal.*=10", "*"]),
            named(&[("depth.Z", 0), ("id.I", 1), ("normal.X", 1)])
        );
        let found = compare(&ours, &reference, &limits(&["id.I"])).unwrap();
        assert_eq!(
            found[0].words(),
            "1 pixel differs by more than 0; worst: pixel (1, 0), ours 3, reference 2"
        );
    }

    #[test]
    fn missing_channels_and_bad_names_are_errors() {
        let (one, none) = (image(&[("depth.Z", [0.0; 2])]), image(&[("R", [0.0; 2])]));
        let error = |ours, reference, text| compare(ours, reference, &limits(&[text])).unwrap_err();
        assert_eq!(
            error(&one, &none, "depth.Z"),
            "the reference has no channel depth.Z"
        );
        assert_eq!(error(&none, &one, "*"), "ours has no channel depth.Z");
        assert!(error(&one, &one, "dept.Z").contains("did you mean depth.Z?"));
        assert!(error(&none, &none, "*").contains("besides R, G, B there are none"));
        for text in ["", "=1", "a*b", "depth.Z=-1", "depth.Z=x"] {
            assert!(ChannelLimit::parse(text).is_err(), "{text}");
        }
    }
}
