//! The binary buffer: accessors of vertices and indices, and embedded files.

use serde_json::{Value, json};

/// Target of a buffer view with vertex attributes.
const ARRAY_BUFFER: u32 = 34962;
/// Target of a buffer view with indices.
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Component types.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// The buffer of a file, with its buffer views and accessors.
#[derive(Default)]
pub(super) struct Buffer {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
}

impl Buffer {
    /// Adds bytes as a buffer view; its index.
    pub(super) fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        // Accessors are aligned to their components.
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0,
            "byteOffset": self.bytes.len(),
            "byteLength": bytes.len(),
        });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds the values of a vertex attribute; `limits`: with their minimum and maximum. The index
    /// of the accessor.
    pub(super) fn attribute<const N: usize>(&mut self, values: &[[f32; N]], limits: bool) -> usize {
        let bytes: Vec<u8> = values
            .iter()
            .flatten()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        let view = self.view(&bytes, Some(ARRAY_BUFFER));
        let mut accessor = json!({
            "bufferView": view,
            "componentType": FLOAT,
            "count": values.len(),
            "type": format!("VEC{N}"),
        });
        if limits {
            let fold = |start: f32, choose: fn(f32, f32) -> f32| -> Vec<f64> {
                (0..N)
                    .map(|k| values.iter().map(|value| value[k]).fold(start, choose).into())
                    .collect()
            };
            accessor["min"] = fold(f32::INFINITY, f32::min).into();
            accessor["max"] = fold(f32::NEG_INFINITY, f32::max).into();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds indices of `vertices` vertices; the index of the accessor.
    pub(super) fn indices(&mut self, indices: &[[u32; 3]], vertices: usize) -> usize {
        let all = indices.iter().flatten();
        // The largest number of 16 bits is reserved.
        let (kind, bytes): (u32, Vec<u8>) = if vertices < 65535 {
            (
                UNSIGNED_SHORT,
                all.flat_map(|index| (*index as u16).to_le_bytes()).collect(),
            )
        } else {
            (UNSIGNED_INT, all.flat_map(|index| index.to_le_bytes()).collect())
        };
        let view = self.view(&bytes, Some(ELEMENT_ARRAY_BUFFER));
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": kind,
            "count": 3 * indices.len(),
            "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }
}
