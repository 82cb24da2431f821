#![allow(
    unsafe_code,
    reason = "calling a function that is compiled for more instructions than the caller"
)]

use std::sync::OnceLock;

/// A set of vector instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// The baseline of the target: SSE2 on x86-64, NEON on AArch64.
    Baseline,
    /// AVX2, FMA and BMI: 4 doubles or 8 floats per register.
    Avx2,
    /// Also AVX-512 F, BW, DQ and VL: 8 doubles or 16 floats per register.
    Avx512,
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        })
    }
}

impl Level {
    /// The best level of this processor, limited by the environment variable `WHITSTONE_SIMD`
    /// (`baseline`, `avx2`, `avx512`); determined once.
    pub fn current() -> Self {
        static LEVEL: OnceLock<Level> = OnceLock::new();
        *LEVEL.get_or_init(|| {
            let wanted = Self::wanted().unwrap_or(Self::Avx512);
            Self::detected().min(wanted)
        })
    }

    /// The limit set by the environment variable; the highest level if it is unset.
    /// [`Self::current`] also uses the highest level for an unknown value.
    ///
    /// # Errors
    /// If the value is none of the three.
    pub fn wanted() -> Result<Self, String> {
        match std::env::var("WHITSTONE_SIMD").as_deref() {
            Ok("baseline") => Ok(Self::Baseline),
            Ok("avx2") => Ok(Self::Avx2),
            Ok("avx512" | "") | Err(_) => Ok(Self::Avx512),
            Ok(other) => Err(format!(
                "WHITSTONE_SIMD: expected baseline, avx2 or avx512, found \"{other}\""
            )),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn detected() -> Self {
        macro_rules! all {
            ($($feature:tt)*) => { $(std::arch::is_x86_feature_detected!($feature))&&* };
        }
        if !all!("avx2" "fma" "bmi1" "bmi2" "lzcnt" "popcnt") {
            Self::Baseline
        } else if all!("avx512f" "avx512bw" "avx512dq" "avx512vl") {
            Self::Avx512
        } else {
            Self::Avx2
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn detected() -> Self {
        Self::Baseline
    }
}

/// Runs `f`, compiled for the best instructions of this processor. This covers inlined code only:
/// pass `#[inline(always)] || ...` and call only functions marked likewise.
#[inline(always)]
pub fn dispatch<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    match Level::current() {
        Level::Baseline => {}
        // SAFETY: `current` returns only levels that the processor supports.
        Level::Avx2 => return unsafe { avx2(f) },
        // SAFETY: as above.
        Level::Avx512 => return unsafe { avx512(f) },
    }
    f()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<R>(f: impl FnOnce() -> R) -> R {
    f()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn avx512<R>(f: impl FnOnce() -> R) -> R {
    f()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_computes_the_same() {
        let a: Vec<f64> = (0..67).map(|i| 1.0 / f64::from(i + 1)).collect();
        let found: Vec<u64> = dispatch(
            #[inline(always)]
            || a.iter().map(|x| (x * x + x).sqrt().to_bits()).collect(),
        );
        let plain: Vec<u64> = a.iter().map(|x| (x * x + x).sqrt().to_bits()).collect();
        assert_eq!(found, plain);
    }
}
