//! The image itself: named planes of `f32`.

use std::collections::BTreeMap;

/// Maximum number of pixels of an [`Image`]: 2^28.
pub const MAX_PIXELS: usize = 1 << 28;

/// Maximum length of the name of a channel or attribute in bytes, as in an OpenEXR file.
const MAX_NAME_BYTES: usize = 255;

/// An invalid part of an [`Image`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// A side is zero, or there are more than [`MAX_PIXELS`] pixels.
    #[error(
        "an image of {width} x {height} pixels: each side must be at least 1, and there may be at most {MAX_PIXELS} pixels"
    )]
    Size {
        /// Requested number of columns.
        width: usize,
        /// Requested number of rows.
        height: usize,
    },
    /// The number of samples of a plane differs from the number of pixels.
    #[error("channel `{channel}` has {found} samples, but {width} x {height} pixels need {}", width * height)]
    SampleCount {
        /// Name of the channel.
        channel: String,
        /// Number of samples given.
        found: usize,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// The name is empty, longer than 255 bytes (with its prefix), or has a zero byte in it.
    #[error(
        "`{name}` cannot be the name of a channel or an attribute: it must have 1 to 255 bytes, none of them zero"
    )]
    Name {
        /// The offending name.
        name: String,
    },
    /// The image already has a channel of that name.
    #[error("the channel `{channel}` already exists")]
    DuplicateChannel {
        /// Name of the channel.
        channel: String,
    },
    /// The image has no such channel.
    #[error("no channel `{channel}`; available channels: {}", available.join(", "))]
    MissingChannel {
        /// Name of the requested channel.
        channel: String,
        /// Names of the channels that the image has, sorted.
        available: Vec<String>,
    },
}

/// The position of an image in the frame from which it was cropped.
///
/// In terms of OpenEXR: the position of the data window relative to the display window, and the
/// size of the latter. A whole frame has `x = y = 0` and the size of the image itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placement {
    /// Column of the frame that contains column 0 of the image; may be negative.
    pub x: i32,
    /// Row of the frame that contains row 0 of the image; may be negative.
    pub y: i32,
    /// Columns of the whole frame.
    pub frame_width: usize,
    /// Rows of the whole frame.
    pub frame_height: usize,
}

/// Named planes of `f32` samples over `width * height` pixels, row-major, top row first.
///
/// Colour is in the channels `R`, `G`, `B` (linear Rec. 709); other layers are channels such as
/// `depth.Z`. Channels and attributes are sorted by name, so that equal images give equal files.
/// Samples may have any value, including NaN and infinities, which the metrics count.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    placement: Placement,
    channels: BTreeMap<String, Vec<f32>>,
    attributes: BTreeMap<String, String>,
}

impl Image {
    /// An image without channels.
    ///
    /// # Errors
    /// [`ImageError::Size`] if a side is zero or there are more than [`MAX_PIXELS`] pixels.
    pub fn new(width: usize, height: usize) -> Result<Self, ImageError> {
        let pixels = width.saturating_mul(height);
        if pixels == 0 || pixels > MAX_PIXELS {
            return Err(ImageError::Size { width, height });
        }
        Ok(Self {
            width,
            height,
            placement: Placement {
                x: 0,
                y: 0,
                frame_width: width,
                frame_height: height,
            },
            channels: BTreeMap::new(),
            attributes: BTreeMap::new(),
        })
    }

    /// An image with the channels `R`, `G`, `B` from `pixels`, row-major, top row first.
    ///
    /// # Errors
    /// As [`Image::new`]; [`ImageError::SampleCount`] if there are not `width * height` pixels.
    pub fn from_rgb(width: usize, height: usize, pixels: &[[f32; 3]]) -> Result<Self, ImageError> {
        let mut image = Self::new(width, height)?;
        for (index, name) in RGB.into_iter().enumerate() {
            image.add_channel(name, pixels.iter().map(|pixel| pixel[index]).collect())?;
        }
        Ok(image)
    }

    /// An image with the channels `R`, `G`, `B` whose pixel `(x, y)` is `color(x, y)`.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn from_fn(
        width: usize,
        height: usize,
        mut color: impl FnMut(usize, usize) -> [f32; 3],
    ) -> Result<Self, ImageError> {
        let mut image = Self::new(width, height)?;
        let mut planes = RGB.map(|_| Vec::with_capacity(width * height));
        for y in 0..height {
            for x in 0..width {
                for (plane, value) in planes.iter_mut().zip(color(x, y)) {
                    plane.push(value);
                }
            }
        }
        for (name, plane) in RGB.into_iter().zip(planes) {
            image.add_channel(name, plane)?;
        }
        Ok(image)
    }

    /// Columns, at least 1.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows, at least 1.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of pixels, `width * height`.
    #[must_use]
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// The position of the image in its frame; a whole frame unless set otherwise.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// Sets the position of the image in its frame.
    pub fn set_placement(&mut self, placement: Placement) {
        self.placement = placement;
    }

    /// Adds a plane of `width * height` samples, row-major, top row first.
    ///
    /// # Errors
    /// [`ImageError::SampleCount`], [`ImageError::Name`] or [`ImageError::DuplicateChannel`].
    pub fn add_channel(&mut self, name: impl Into<String>, samples: Vec<f32>) -> Result<(), ImageError> {
        let name = name.into();
        check_name(&name, 0)?;
        if samples.len() != self.pixel_count() {
            return Err(ImageError::SampleCount {
                channel: name,
                found: samples.len(),
                width: self.width,
                height: self.height,
            });
        }
        if self.channels.contains_key(&name) {
            return Err(ImageError::DuplicateChannel { channel: name });
        }
        self.channels.insert(name, samples);
        Ok(())
    }

    /// Removes and returns a plane, or `None` if there is none of that name.
    pub fn remove_channel(&mut self, name: &str) -> Option<Vec<f32>> {
        self.channels.remove(name)
    }

    /// The samples of a channel, row-major, top row first, or `None` if there is none of that name.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.get(name).map(Vec::as_slice)
    }

    /// As [`Image::channel`], but mutable.
    pub fn channel_mut(&mut self, name: &str) -> Option<&mut [f32]> {
        self.channels.get_mut(name).map(Vec::as_mut_slice)
    }

    /// As [`Image::channel`], with an error that lists the existing channels.
    ///
    /// # Errors
    /// [`ImageError::MissingChannel`].
    pub fn require_channel(&self, name: &str) -> Result<&[f32], ImageError> {
        self.channel(name).ok_or_else(|| ImageError::MissingChannel {
            channel: name.to_owned(),
            available: self.channels.keys().cloned().collect(),
        })
    }

    /// All channels with their names, sorted by name.
    pub fn channels(&self) -> impl ExactSizeIterator<Item = (&str, &[f32])> {
        self.channels
            .iter()
            .map(|(name, samples)| (name.as_str(), samples.as_slice()))
    }

    /// The planes of the channels `R`, `G`, `B`.
    ///
    /// # Errors
    /// [`ImageError::MissingChannel`] naming the first that is missing.
    pub fn rgb(&self) -> Result<[&[f32]; 3], ImageError> {
        let [r, g, b] = RGB;
        Ok([
            self.require_channel(r)?,
            self.require_channel(g)?,
            self.require_channel(b)?,
        ])
    }

    /// Attributes, sorted by name. In an EXR file each is a text attribute whose name is
    /// [`whitstone:`](crate::exr_io::ATTRIBUTE_PREFIX) followed by the name here.
    #[must_use]
    pub fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
    }

    /// Sets an attribute, for example `scene_hash`, `samples` or `version`, replacing one of the
    /// same name.
    ///
    /// # Errors
    /// [`ImageError::Name`] if the name does not fit into an EXR file.
    pub fn set_attribute(
        &mut self,
        name: impl Into<String>,
        value: impl Into<String>,
    ) -> Result<(), ImageError> {
        let name = name.into();
        check_name(&name, crate::exr_io::ATTRIBUTE_PREFIX.len())?;
        self.attributes.insert(name, value.into());
        Ok(())
    }
}

/// Names of the colour channels, in the order in which pixels are given.
pub const RGB: [&str; 3] = ["R", "G", "B"];

fn check_name(name: &str, prefix_bytes: usize) -> Result<(), ImageError> {
    let fits = !name.is_empty() && name.len() + prefix_bytes <= MAX_NAME_BYTES && !name.contains('\0');
    if fits {
        Ok(())
    } else {
        Err(ImageError::Name {
            name: name.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_row_major_from_the_top() {
        let image = Image::from_fn(3, 2, |x, y| [x as f32, y as f32, 10.0]).unwrap();
        assert_eq!(image.channel("R").unwrap(), [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]);
        assert_eq!(image.channel("G").unwrap(), [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        assert_eq!(image.rgb().unwrap()[2], [10.0; 6]);
        let pixels: Vec<[f32; 3]> = (0..6).map(|i| [(i % 3) as f32, (i / 3) as f32, 10.0]).collect();
        assert_eq!(Image::from_rgb(3, 2, &pixels).unwrap(), image);
    }

    #[test]
    fn sizes_and_names_are_checked() {
        assert!(matches!(Image::new(0, 4), Err(ImageError::Size { .. })));
        assert!(matches!(Image::new(usize::MAX, 2), Err(ImageError::Size { .. })));
        assert!(matches!(
            Image::new(MAX_PIXELS + 1, 1),
            Err(ImageError::Size { .. })
        ));
        assert!(Image::new(MAX_PIXELS, 1).is_ok());

        let mut image = Image::new(2, 2).unwrap();
        assert!(matches!(
            image.add_channel("R", vec![0.0; 3]),
            Err(ImageError::SampleCount { found: 3, .. })
        ));
        assert!(matches!(
            image.add_channel("", vec![0.0; 4]),
            Err(ImageError::Name { .. })
        ));
        assert!(matches!(
            image.add_channel("a\0b", vec![0.0; 4]),
            Err(ImageError::Name { .. })
        ));
        image.add_channel("R", vec![0.0; 4]).unwrap();
        assert!(matches!(
            image.add_channel("R", vec![0.0; 4]),
            Err(ImageError::DuplicateChannel { .. })
        ));
        assert!(matches!(
            image.set_attribute("x".repeat(250), ""),
            Err(ImageError::Name { .. })
        ));
        assert_eq!(
            image.rgb().unwrap_err().to_string(),
            "no channel `G`; available channels: R"
        );
    }
}
