//! Tables of features: what the conversions of a format keep, approximate and drop.

/// A table of features, one line each: treatment, name in the format, how.
macro_rules! features {
    ($($treatment:ident $name:literal: $how:literal;)*) => {
        &[$(whitstone_core::Feature {
            name: $name,
            treatment: whitstone_core::Treatment::$treatment,
            how: $how,
        }),*]
    };
}

/// The part of a table that is about the export: its names begin with a bracket, as TOML tables do,
/// and it comes last.
pub(crate) const fn exported(features: &[whitstone_core::Feature]) -> &[whitstone_core::Feature] {
    let mut first = 0;
    while first < features.len() && features[first].name.as_bytes()[0] != b'[' {
        first += 1;
    }
    features.split_at(first).1
}
