//! Accessors: numbers of any type as double precision, and indices.

use crate::document::{Document, Error};
use crate::json::accessor::{ComponentType, Type};
use crate::json::validation::Checked;
use crate::usage::{self, Part};

/// Maximum number of elements of an accessor without a buffer view, whose size nothing else bounds.
const MAX_ZEROS: u64 = 1 << 27;

/// Rows of numbers: the elements of an accessor.
pub struct Numbers {
    values: Vec<f64>,
    width: usize,
}

impl Numbers {
    /// Number of components of an element.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.values.len() / self.width
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The elements.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.width)
    }

    /// The elements as arrays; missing components are `fill`.
    pub fn arrays<const N: usize>(&self, fill: f64) -> Vec<[f64; N]> {
        self.rows()
            .map(|row| {
                let mut array = [fill; N];
                for (to, from) in array.iter_mut().zip(row) {
                    *to = *from;
                }
                array
            })
            .collect()
    }
}

/// How the numbers of an accessor are stored.
#[derive(Clone, Copy)]
struct Layout {
    component: ComponentType,
    kind: Type,
    normalized: bool,
}

impl Layout {
    /// Number of components.
    fn width(self) -> usize {
        match self.kind {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 | Type::Mat2 => 4,
            Type::Mat3 => 9,
            Type::Mat4 => 16,
        }
    }

    /// Offsets of the components in an element, and its size in bytes. The columns of matrices are
    /// aligned to 4 bytes.
    fn offsets(self) -> (Vec<usize>, usize) {
        let size = self.component.size();
        let column = match self.kind {
            Type::Mat2 => 2,
            Type::Mat3 => 3,
            Type::Mat4 => 4,
            _ => return ((0..self.width()).map(|k| k * size).collect(), self.width() * size),
        };
        let step = (column * size).next_multiple_of(4);
        let offsets = (0..self.width()).map(|k| k / column * step + k % column * size);
        (offsets.collect(), column * step)
    }

    /// Appends the elements in `bytes`, `count` of them with a distance of `stride`.
    fn decode(self, bytes: &[u8], stride: usize, count: usize, to: &mut Vec<f64>) {
        use ComponentType::*;
        let (offsets, size) = self.offsets();
        macro_rules! numbers {
            ($type:ty, $scale:expr) => {{
                const SIZE: usize = size_of::<$type>();
                let scale: fn(f64) -> f64 = $scale;
                for element in 0..count {
                    let element = &bytes[element * stride..element * stride + size];
                    for offset in &offsets {
                        let mut raw = [0u8; SIZE];
                        raw.copy_from_slice(&element[*offset..*offset + SIZE]);
                        to.push(scale(<$type>::from_le_bytes(raw) as f64));
                    }
                }
            }};
        }
        to.reserve(count * offsets.len());
        match (self.component, self.normalized) {
            (F32, _) => numbers!(f32, |x| x),
            (U8, false) => numbers!(u8, |x| x),
            (U16, false) => numbers!(u16, |x| x),
            (U32, false) => numbers!(u32, |x| x),
            (I8, false) => numbers!(i8, |x| x),
            (I16, false) => numbers!(i16, |x| x),
            (U8, true) => numbers!(u8, |x| x / 255.0),
            (U16, true) => numbers!(u16, |x| x / 65535.0),
            (U32, true) => numbers!(u32, |x| x / 4_294_967_295.0),
            (I8, true) => numbers!(i8, |x| (x / 127.0).max(-1.0)),
            (I16, true) => numbers!(i16, |x| (x / 32767.0).max(-1.0)),
        }
    }
}

impl Document {
    /// The elements of an accessor. `pointer` is the place that refers to it.
    pub fn numbers(
        &self,
        number: usize,
        kinds: &[Type],
        pointer: &dyn Fn() -> String,
    ) -> Result<Numbers, Error> {
        let accessor = Self::item(&self.root.accessors, number, "accessors", pointer)?;
        let at = |key: &str| format!("/accessors/{number}{key}");
        let (Checked::Valid(component), Checked::Valid(kind)) = (&accessor.component_type, &accessor.type_)
        else {
            let (key, expected) = match accessor.component_type {
                Checked::Invalid => ("/componentType", "5120 to 5123, 5125 or 5126"),
                Checked::Valid(_) => ("/type", "SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4"),
            };
            return Err(Error::at(at(key), format!("expected {expected}")));
        };
        if !kinds.contains(kind) {
            let names: Vec<_> = kinds
                .iter()
                .map(|kind| format!("{kind:?}").to_uppercase())
                .collect();
            let message = format!(
                "expected {} here ({}), found {}",
                names.join(" or "),
                pointer(),
                format!("{kind:?}").to_uppercase()
            );
            return Err(Error::at(at("/type"), message));
        }
        usage::decoded(self, Part::Accessor(number));
        let layout = Layout {
            component: component.0,
            kind: *kind,
            normalized: accessor.normalized,
        };
        let count = accessor.count.0;
        let width = layout.width();
        let mut values = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let place = || at("/bufferView");
                let list = &self.root.buffer_views;
                let stride = Self::item(list, view.value(), "bufferViews", place)?.byte_stride;
                let stride = stride.map(|stride| stride.0);
                self.read(
                    layout,
                    view.value(),
                    accessor.byte_offset.map_or(0, |offset| offset.0),
                    count,
                    stride,
                    &place,
                    &mut values,
                )?;
            }
            None if count > MAX_ZEROS => {
                let message =
                    format!("expected at most {MAX_ZEROS} elements without a buffer view, found {count}");
                return Err(Error::at(at("/count"), message));
            }
            None => values.resize(count as usize * width, 0.0),
        }
        if let Some(sparse) = &accessor.sparse {
            let at = |key: &str| at(&format!("/sparse{key}"));
            let changed = sparse.count.0;
            if changed > count {
                let message = format!("{changed} elements are replaced, but there are {count}");
                return Err(Error::at(at("/count"), message));
            }
            let Checked::Valid(component) = sparse.indices.component_type else {
                return Err(Error::at(
                    at("/indices/componentType"),
                    "expected 5121, 5123 or 5125",
                ));
            };
            let scalars = Layout {
                component: component.0,
                kind: Type::Scalar,
                normalized: false,
            };
            let (mut places, mut new) = (Vec::new(), Vec::new());
            self.read(
                scalars,
                sparse.indices.buffer_view.value(),
                sparse.indices.byte_offset.0,
                changed,
                None,
                &|| at("/indices/bufferView"),
                &mut places,
            )?;
            self.read(
                layout,
                sparse.values.buffer_view.value(),
                sparse.values.byte_offset.0,
                changed,
                None,
                &|| at("/values/bufferView"),
                &mut new,
            )?;
            for (place, new) in places.iter().zip(new.chunks_exact(width)) {
                let place = *place as usize;
                let old = values
                    .get_mut(place * width..(place + 1) * width)
                    .ok_or_else(|| {
                        Error::at(
                            at("/indices"),
                            format!("element {place} is replaced, but there are {count}"),
                        )
                    })?;
                old.copy_from_slice(new);
            }
        }
        if let Some(bad) = values.iter().position(|value| !value.is_finite()) {
            let message = format!("element {} is not finite", bad / width);
            return Err(Error::at(at(""), message));
        }
        Ok(Numbers { values, width })
    }

    /// Appends `count` elements of a buffer view.
    #[expect(
        clippy::too_many_arguments,
        reason = "an accessor and its sparse parts share this"
    )]
    fn read(
        &self,
        layout: Layout,
        view: usize,
        offset: u64,
        count: u64,
        stride: Option<usize>,
        pointer: &dyn Fn() -> String,
        to: &mut Vec<f64>,
    ) -> Result<(), Error> {
        if count == 0 {
            return Ok(());
        }
        let (_, size) = layout.offsets();
        let stride = stride.unwrap_or(size);
        if stride < size {
            let message = format!("the stride of {stride} bytes is less than an element of {size} bytes");
            return Err(Error::at(format!("/bufferViews/{view}/byteStride"), message));
        }
        let length = (count - 1)
            .checked_mul(stride as u64)
            .and_then(|most| most.checked_add(size as u64))
            .ok_or_else(|| Error::at(pointer(), format!("{count} elements are more than fit in memory")))?;
        let bytes = self.view_bytes(view, offset, length, pointer)?;
        layout.decode(&bytes, stride, count as usize, to);
        Ok(())
    }

    /// The elements of an accessor of indices.
    pub fn indices(&self, number: usize, pointer: &dyn Fn() -> String) -> Result<Vec<u32>, Error> {
        let accessor = Self::item(&self.root.accessors, number, "accessors", pointer)?;
        if let Checked::Valid(component) = &accessor.component_type
            && !matches!(
                component.0,
                ComponentType::U8 | ComponentType::U16 | ComponentType::U32
            )
        {
            let place = format!("/accessors/{number}/componentType");
            return Err(Error::at(place, "expected 5121, 5123 or 5125 for indices"));
        }
        let numbers = self.numbers(number, &[Type::Scalar], pointer)?;
        Ok(numbers.values.iter().map(|value| *value as u32).collect())
    }
}
