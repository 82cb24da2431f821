//! Generates `docs/formats.md` from the tables of the scene formats.

use std::fmt::Write as _;
use whitstone::core::{ExportScene, Feature, ImportOptions, Registry, SceneFormat, Treatment};

/// The page.
pub(crate) const PAGE: &str = "docs/formats.md";

const INTRODUCTION: &str = "\
# Scene formats

Every command that takes a scene also takes a file of another program; the extension decides.

```sh
whitstone render model.glb -o model.png
whitstone validate model.glb
whitstone convert model.glb model.toml
whitstone convert scene.toml scene.xml
```

`convert` prints a summary: what was kept, what was approximated and how, and what was dropped, with
the names or places in the file. `--strict` refuses to drop anything; `--json` writes the summary
for programs; without an output file nothing is written.

A TOML scene imports such files as parts:

```toml
[[import]]
file = \"model.glb\"
transform = { translate = [0, 1, 0] }
materials = { \"paint\" = \"red\" }
```

| key | meaning | default |
|---|---|---|
| `file` | the file to import; required | |
| `transform` | transform of everything in it, in the form of a shape's | none |
| `prefix` | prefix of the ids that it defines | the name of the file and a slash |
| `scene` | name or index of the scene, where the format has several | that of the file, else the first |
| `node` | name or index of the node to import, with everything below it | all nodes of the scene |
| `camera` | name or index of the camera | the first |
| `lights` | whether its lights are imported | `true` |
| `photometric` | whether intensities in candela and lux are divided by 683 lm/W | `false`: the numbers are used as W/sr and W/m2 |
| `materials` | materials of the scene instead of those of the file: name in the file = id | none |
| `allow_outside` | whether it may read files outside of its folder | `false` |

The imported camera counts only if the scene has none. Errors name the place in the file: a JSON
pointer in glTF, line and column in XML and pbrt, the line in OBJ and MTL. Files outside of the
folder of the imported file are refused unless `allow_outside` is set. It has no effect in glTF,
whose URIs may not leave the folder; links in the folder are followed there. Addresses on a network
are always refused.

In every format, a file without a camera gets one that shows the whole scene, and a file without
lights a directional light, an ambient light and a grey background.

The tables below are those that the conversions use themselves. *Kept* means the same image,
*approximated* a similar image, and *dropped* no effect. Plugins of Mitsuba and pbrt that are not
listed are errors. Rows that begin with a bracket are about the export and name the tables of a TOML
scene.
";

/// The text of the page.
pub(crate) fn page(registry: &Registry) -> String {
    let mut text = INTRODUCTION.to_owned();
    for format in registry.formats() {
        let extensions: Vec<String> = format
            .extensions()
            .iter()
            .map(|extension| format!("`.{extension}`"))
            .collect();
        let _ = writeln!(
            text,
            "\n## {} ({})\n\n{}.\n",
            format.name(),
            extensions.join(", "),
            directions(format)
        );
        // What is about the export begins with a bracket.
        let (exported, imported): (Vec<&Feature>, Vec<&Feature>) =
            (format.features().iter()).partition(|feature| feature.name.starts_with('['));
        let both = !exported.is_empty() && !imported.is_empty();
        for (title, mut features) in [("Import", imported), ("Export", exported)] {
            if features.is_empty() {
                continue;
            }
            if both {
                let _ = writeln!(text, "{}### {title}\n", if title == "Export" { "\n" } else { "" });
            }
            text.push_str("| feature | | how |\n|---|---|---|\n");
            features.sort_by_key(|feature| feature.treatment);
            for Feature { name, treatment, how } in features {
                let what = match treatment {
                    Treatment::Kept => "kept",
                    Treatment::Approximated => "approximated",
                    Treatment::Dropped => "dropped",
                };
                let _ = writeln!(text, "| {name} | {what} | {how} |");
            }
        }
    }
    text
}

/// Whether a format is read and written. Formats answer for a file that does not exist.
fn directions(format: &dyn SceneFormat) -> &'static str {
    let folder = std::path::Path::new("no such folder");
    let document = toml::Table::new();
    let scene = ExportScene {
        document: &document,
        base: folder,
    };
    let reads = format.name() == "toml" || format.import(&folder.join("x"), &ImportOptions::all()).is_some();
    let writes = format.export(&scene, &folder.join("x")).is_some();
    match (reads, writes) {
        (true, true) => "Read and written",
        (true, false) => "Read",
        (false, true) => "Written",
        (false, false) => "Neither read nor written",
    }
}
