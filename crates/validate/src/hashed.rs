//! JSON files of caches, with a hash of their contents: a damaged file counts as missing, and is
//! made again.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
struct Hashed<T> {
    /// Hash of the contents as JSON.
    hash: String,
    contents: T,
}

fn hash(contents: &impl Serialize) -> serde_json::Result<String> {
    let text = serde_json::to_vec(contents)?;
    Ok(blake3::hash(&text).to_hex()[..32].to_owned())
}

/// The bytes of a file with these contents.
///
/// # Errors
/// If they cannot be written as JSON.
pub fn to_bytes(contents: &impl Serialize) -> serde_json::Result<Vec<u8>> {
    let hash = hash(contents)?;
    serde_json::to_vec(&Hashed { hash, contents })
}

/// The contents of a file of [`to_bytes`]; none if it is damaged or of another kind.
pub fn from_bytes<T: Serialize + DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    let file: Hashed<T> = serde_json::from_slice(bytes).ok()?;
    (hash(&file.contents).ok()? == file.hash).then_some(file.contents)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn damaged_contents_are_none() {
        let contents = BTreeMap::from([
            ("3,4".to_owned(), vec![Some(0.113_017_732_710_969_31), None]),
            ("5,6".to_owned(), vec![Some(1e-320), Some(-0.0)]),
        ]);
        let whole = to_bytes(&contents).unwrap();
        let read = |bytes: &[u8]| from_bytes::<BTreeMap<String, Vec<Option<f64>>>>(bytes);
        assert_eq!(read(&whole), Some(contents.clone()));
        for at in 0..whole.len() {
            assert_eq!(read(&whole[..at]), None, "{at}");
            for bit in 0..8 {
                let mut damaged = whole.clone();
                damaged[at] ^= 1 << bit;
                // Or the same number, written in another way.
                let read = read(&damaged);
                assert!(
                    read.is_none() || read == Some(contents.clone()),
                    "{at} {bit}: {read:?}"
                );
            }
        }
    }
}
