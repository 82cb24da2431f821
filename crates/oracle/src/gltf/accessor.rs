//! Accessors: typed views of the bytes of buffers.

use super::{Gltf, number};
use serde_json::Value;

/// The numbers of an accessor.
pub(crate) struct Numbers {
    /// Components of an element.
    pub(crate) width: usize,
    /// Whether the components are unsigned integers that are not normalised.
    pub(crate) whole: bool,
    values: Vec<f64>,
}

impl Numbers {
    pub(crate) fn count(&self) -> usize {
        self.values.len() / self.width
    }

    /// All elements, which have N components.
    pub(crate) fn all<const N: usize>(&self) -> Result<Vec<[f64; N]>, String> {
        if self.width != N {
            return Err(format!("an accessor of {} components instead of {N}", self.width));
        }
        let (elements, _) = self.values.as_chunks::<N>();
        Ok(elements.to_vec())
    }

    /// All elements as indices.
    pub(crate) fn indices<const N: usize>(&self) -> Result<Vec<[usize; N]>, String> {
        if !self.whole {
            return Err("indices that are no unsigned integers".to_owned());
        }
        let all = self.all::<N>()?.into_iter();
        Ok(all.map(|element| element.map(|x| x as usize)).collect())
    }
}

/// The type of a component.
#[derive(Clone, Copy)]
struct Component {
    code: usize,
    size: usize,
}

impl Component {
    fn of(object: &Value) -> Result<Self, String> {
        let code = number(object, "componentType", None)?;
        let size = match code {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5125 | 5126 => 4,
            _ => return Err(format!("the component type {code}")),
        };
        Ok(Self { code, size })
    }

    /// The number that some bytes mean.
    fn read(self, bytes: &[u8]) -> Option<f64> {
        Some(match self.code {
            5120 => f64::from(i8::from_le_bytes(bytes.try_into().ok()?)),
            5121 => f64::from(u8::from_le_bytes(bytes.try_into().ok()?)),
            5122 => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            5123 => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            5125 => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            _ => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
        })
    }

    /// The largest number; `None` for floats.
    fn most(self) -> Option<f64> {
        match self.code {
            5120 => Some(127.0),
            5121 => Some(255.0),
            5122 => Some(32_767.0),
            5123 => Some(65_535.0),
            5125 => Some(4_294_967_295.0),
            _ => None,
        }
    }
}

/// `count` elements of `width` components each. They start at `offset`, `stride` bytes apart.
fn elements(
    bytes: &[u8],
    [offset, stride, count, width]: [usize; 4],
    component: Component,
) -> Result<Vec<f64>, String> {
    let mut values = Vec::new();
    for i in 0..count {
        for c in 0..width {
            let start = i.checked_mul(stride).and_then(|at| at.checked_add(offset));
            let start = start.and_then(|at| at.checked_add(c * component.size));
            let part = start.and_then(|at| bytes.get(at..at.checked_add(component.size)?));
            let value = part.and_then(|part| component.read(part));
            values.push(value.ok_or("an accessor that exceeds its buffer view")?);
        }
    }
    Ok(values)
}

impl Gltf {
    pub(crate) fn accessor(&self, index: usize) -> Result<Numbers, String> {
        let accessor = self.element("accessors", index)?;
        let component = Component::of(accessor)?;
        let count = number(accessor, "count", None)?;
        let width = match accessor.get("type").and_then(Value::as_str) {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4") => 4,
            Some("MAT4") => 16,
            _ => return Err("an accessor of this type".to_owned()),
        };
        let normalized = accessor.get("normalized").and_then(Value::as_bool) == Some(true);
        let packed = width * component.size;
        let mut values = match accessor.get("bufferView") {
            Some(_) => {
                let view = number(accessor, "bufferView", None)?;
                let stride = number(self.element("bufferViews", view)?, "byteStride", Some(packed))?;
                if stride == 0 {
                    return Err("a stride of 0".to_owned());
                }
                let offset = number(accessor, "byteOffset", Some(0))?;
                elements(self.view(view)?, [offset, stride, count, width], component)?
            }
            None if count > MAX_COUNT => return Err("an accessor of this length".to_owned()),
            None => vec![0.0; count * width],
        };
        if let Some(sparse) = accessor.get("sparse") {
            let many = number(sparse, "count", None)?;
            let part = |key: &str, width: usize, component: Option<Component>| {
                let part = sparse.get(key).ok_or("a malformed sparse accessor")?;
                let component = component.map_or_else(|| Component::of(part), Ok)?;
                let offset = number(part, "byteOffset", Some(0))?;
                let view = self.view(number(part, "bufferView", None)?)?;
                elements(view, [offset, width * component.size, many, width], component)
            };
            let places = part("indices", 1, None)?;
            let replacements = part("values", width, Some(component))?;
            for (place, element) in places.iter().zip(replacements.chunks_exact(width)) {
                let start = *place as usize * width;
                let old = values.get_mut(start..start + width);
                old.ok_or("a sparse index out of range")?.copy_from_slice(element);
            }
        }
        if normalized && let Some(most) = component.most() {
            for value in &mut values {
                *value = (*value / most).max(-1.0);
            }
        }
        if values.iter().any(|value| !value.is_finite()) {
            return Err("numbers that are not finite".to_owned());
        }
        Ok(Numbers {
            width,
            whole: [5121, 5123, 5125].contains(&component.code) && !normalized,
            values,
        })
    }
}

/// Largest supported number of elements without data.
const MAX_COUNT: usize = 1 << 24;
