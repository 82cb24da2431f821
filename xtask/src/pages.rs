//! Generates a page for every plugin from its schema, the header comment of its file, and its
//! example.

use crate::bench::plugins::{Costs, kept};
use crate::{backends, course, parameters, plugins};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use whitstone::Failure;
use whitstone::core::{Entry, FamilyName, Registry};
use whitstone::image::atomic;
use whitstone::scene::table_schema;
use whitstone::validate::CaseResult;

/// The folder of the pages, which contains nothing else.
pub(crate) const FOLDER: &str = "docs/plugins";

/// The table of contents of docs/, for mdBook.
const SUMMARY: &str = "docs/SUMMARY.md";

/// Results of the stored references, by the name of the renderer that they come from.
pub(crate) type Cases<'a> = [(&'a str, &'a [CaseResult])];

/// All pages and the table of contents. `picture` renders an example to PNG.
pub(crate) fn pages<E>(
    registry: &Registry,
    cases: &Cases<'_>,
    picture: impl Fn(&str) -> Result<Vec<u8>, E>,
) -> Result<Vec<(PathBuf, Vec<u8>)>, E> {
    let costs = kept();
    let mut files = Vec::new();
    let mut summary = String::from("# Whitstone\n\n");
    for (title, file) in documents("docs", "quick-start.md") {
        let _ = writeln!(summary, "- [{title}]({file})");
    }
    summary += "\n# Course\n\n";
    for (title, file) in documents(course::FOLDER, "README.md") {
        let _ = writeln!(summary, "- [{title}](course/{file})");
    }
    for family in FamilyName::ALL {
        let plural = family.plural();
        let _ = writeln!(summary, "\n# {}{}\n", plural[..1].to_uppercase(), &plural[1..]);
        let own = |entry: &&Entry| entry.family == family && entry.crate_name != backends::CRATE;
        for entry in registry.entries().filter(own) {
            let name = entry.name;
            let _ = writeln!(summary, "- [{name}](plugins/{plural}/{name}.md)");
            let path = PathBuf::from(FOLDER).join(plural);
            files.push((
                path.join(format!("{name}.md")),
                page(entry, cases, &costs).into_bytes(),
            ));
            files.push((path.join(format!("{name}.png")), picture(&example(entry))?));
        }
    }
    files.push((PathBuf::from(SUMMARY), summary.into_bytes()));
    Ok(files)
}

/// Writes a text into a page, between two lines that are kept.
pub(crate) fn between(page: &str, [begin, end]: [&str; 2], text: &str) -> Result<(), Failure> {
    let old = std::fs::read_to_string(page).map_err(Failure::environment)?;
    let (Some(from), Some(to)) = (old.find(begin), old.find(end)) else {
        return Err(Failure::usage(format!(
            "{page}: the marker comments {begin} and {end} are missing"
        )));
    };
    let new = format!("{}{begin}\n\n{text}\n\n{}", &old[..from], &old[to..]);
    atomic::write_bytes(Path::new(page), new.as_bytes()).map_err(Failure::environment)?;
    println!("{page}: written");
    Ok(())
}

/// Title and file of the documents in a folder itself, the named one first.
fn documents(folder: &str, first: &str) -> Vec<(String, String)> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut documents: Vec<(String, String)> = files
        .filter_map(|file| {
            let name = file.file_name().into_string().ok()?;
            let text = std::fs::read_to_string(file.path())
                .ok()
                .filter(|_| name.ends_with(".md"))?;
            let title = text.lines().next()?.strip_prefix("# ")?.to_owned();
            (Path::new(SUMMARY) != file.path()).then_some((title, name))
        })
        .collect();
    documents.sort_by_key(|(_, file)| (file != first, file.clone()));
    documents
}

fn example(entry: &Entry) -> String {
    format!("scenes/{}/{}.toml", entry.family.plural(), entry.name)
}

fn page(entry: &Entry, cases: &Cases<'_>, costs: &Costs) -> String {
    let (family, name) = (entry.family, entry.name);
    let plural = family.plural();
    let file = format!("crates/{plural}/src/{name}.rs");
    let source = std::fs::read_to_string(&file).unwrap_or_default();
    let schema = table_schema(entry);
    let mut text = format!(
        "# {name}\n\n<!-- written by `cargo xtask readme` -->\n\n{}\n\n![{name}]({name}.png)\n\n",
        schema["description"].as_str().unwrap_or_default()
    );
    let up = "../../..";
    let article = if family.singular().starts_with(['a', 'e', 'i', 'o', 'u']) {
        "An"
    } else {
        "A"
    };
    let example = example(entry);
    let _ = writeln!(
        text,
        "{article} {} of [`{file}`]({up}/{file}), feature `{name}` of `{}`. The picture is its example, [`{example}`]({up}/{example}).\n",
        family.singular(),
        entry.crate_name
    );
    text += "## Parameters\n\n";
    parameters::write(&schema, &mut text);
    let method = plugins::method(&source);
    if !method.is_empty() {
        let _ = writeln!(text, "\n## Method\n\n{method}");
    }
    text += "\n## Validation\n\n";
    if let Some(twin) = plugins::note(&source, "Twin") {
        let _ = writeln!(text, "- Twin: {}", twin.trim_end_matches('.'));
    }
    let laws = plugins::laws(&source);
    if !laws.is_empty() {
        let _ = writeln!(text, "- Property tests: `{}`", laws.join("`, `"));
    }
    let scene = format!("{plural}/{name}");
    let cases = cases
        .iter()
        .flat_map(|(renderer, cases)| cases.iter().map(move |case| (renderer, case)));
    for (renderer, case) in cases.filter(|(_, case)| case.scene == scene) {
        let Some(error) = case.rel_rmse_interior else {
            continue;
        };
        let _ = writeln!(
            text,
            "- Error of the example against {renderer}: {error:.0e} (limit {:.0e}); {} pixels over tolerance, {} unexplained",
            case.limit, case.pixels_over_tolerance, case.unexplained
        );
    }
    let _ = match costs.get(plural).and_then(|costs| costs.get(name)) {
        Some(cost) => writeln!(
            text,
            "- Cost of the example: {cost} ns per ray on one thread, including shading and shadow rays (`cargo xtask bench plugins`)"
        ),
        None => writeln!(text, "- Cost: not measured yet (`cargo xtask bench plugins`)"),
    };
    text
}
