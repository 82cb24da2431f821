//! The colours of error maps as tables, for example for scripts that draw them.

use colorous::Gradient;

/// The colours from the lower to the upper end of a scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorMap {
    /// Dark blue over green to dark red: magnitudes.
    Turbo,
    /// Blue over nearly white to red: values with a sign.
    Diverging,
    /// Black over violet to pale yellow: FLIP.
    Magma,
}

impl ColorMap {
    /// 256 colours, from the lower end to the upper one.
    #[must_use]
    pub fn table(self) -> [[u8; 3]; 256] {
        std::array::from_fn(|index| {
            let fraction = index as f64 / 255.0;
            let eval = |gradient: Gradient, fraction| {
                let color = gradient.eval_continuous(fraction);
                [color.r, color.g, color.b]
            };
            match self {
                Self::Turbo => eval(colorous::TURBO, fraction),
                // RdBu goes from red to blue.
                Self::Diverging => eval(colorous::RED_BLUE, 1.0 - fraction),
                Self::Magma => eval(colorous::MAGMA, fraction),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_the_documented_ends() {
        let [turbo, diverging, magma] =
            [ColorMap::Turbo, ColorMap::Diverging, ColorMap::Magma].map(ColorMap::table);
        let [r, _, b] = turbo[255];
        assert!(turbo[0][2] > turbo[0][1] && r > 2 * b);
        assert!(diverging[0][2] > diverging[0][0] && diverging[255][0] > diverging[255][2]);
        assert!(diverging[128].iter().all(|&part| part > 230));
        assert!(magma[0].iter().all(|&part| part < 8) && magma[255][0] > 240);
    }
}
