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
