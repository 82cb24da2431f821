//! Runs POV-Ray on the classic scene, and parses its statistics.

use std::process::{Command, Stdio};

const SCENE: &str = "xtask/src/bench/classic.pov";

/// The statistics of a rendering.
#[derive(Debug, PartialEq)]
pub(super) struct Rendering {
    /// Number of rays, without shadow rays.
    pub(super) rays: u64,
    pub(super) shadow_rays: u64,
    /// Processor time of tracing alone, in seconds.
    pub(super) seconds: f64,
}

/// Renders without a display, a file or antialiasing, on one thread.
pub(super) fn render(width: u32, height: u32) -> Result<Rendering, String> {
    let size = [format!("+W{width}"), format!("+H{height}")];
    let output = Command::new("povray")
        .arg(format!("+I{SCENE}"))
        .args(size)
        .args(["-D", "-F", "-A", "-V", "+WT1"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("povray cannot be run (Debian: apt install povray): {error}"))?;
    let text = String::from_utf8_lossy(&output.stderr);
    parse(&text).ok_or_else(|| format!("cannot parse the output of povray:\n{text}"))
}

fn parse(text: &str) -> Option<Rendering> {
    let number = |after: &str| {
        let rest = text.split(after).nth(1)?;
        rest.split_whitespace().next()?.parse().ok()
    };
    let trace = text.split("Trace Time:").nth(1)?;
    let before = trace.split(" CPU-seconds").next()?;
    Some(Rendering {
        rays: number("\nRays:")?,
        shadow_rays: number("\nShadow Ray Tests:")?,
        seconds: before.split_whitespace().last()?.parse().ok()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_parsed() {
        let text = "Pixels:  2073600   Samples:  0\nRays:            9704944   Saved:   0   Max Level: 7/7\n\
            Shadow Ray Tests:           2826245   Succeeded:  843400\nShadow Cache Hits:  144020\n\
            Parse Time:  0 hours (0.000 seconds)\n   using 1 thread(s) with 0.000 CPU-seconds total\n\
            Trace Time:       0 hours  0 minutes  2 seconds (2.850 seconds)\n\
            \x20             using 1 thread(s) with 2.133 CPU-seconds total\n";
        let expected = Rendering {
            rays: 9_704_944,
            shadow_rays: 2_826_245,
            seconds: 2.133,
        };
        assert_eq!(parse(text), Some(expected));
        assert_eq!(parse("Fatal error"), None);
    }
}
