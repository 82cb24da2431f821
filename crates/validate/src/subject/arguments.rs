//! The command of a subject: words with placeholders, without a shell.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use whitstone_core::nearest;

/// The placeholders of a command.
pub(crate) const PLACEHOLDERS: [&str; 7] =
    ["scene", "output", "width", "height", "samples", "seed", "threads"];
/// The placeholders that every command has.
const REQUIRED: [&str; 2] = ["scene", "output"];

/// A program and its arguments.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Arguments(Vec<Vec<Part>>);

/// A part of a word.
#[derive(Clone, Debug, PartialEq)]
enum Part {
    Text(String),
    Placeholder(&'static str),
}

/// What is wrong with a command.
#[derive(Debug, PartialEq)]
pub(crate) struct Problem {
    pub(crate) message: String,
    pub(crate) help: Option<String>,
}

impl Problem {
    fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            help: None,
        }
    }
}

impl Arguments {
    /// Splits a line into words, with the quotes and backslashes of a POSIX shell and nothing else
    /// of it. In a word, `{name}` is a placeholder; `{{` and `}}` are braces.
    pub(crate) fn parse(line: &str, needs_seed: bool) -> Result<Self, Problem> {
        let words =
            shlex::split(line).ok_or_else(|| Problem::new("a quote or a backslash at the end is open"))?;
        if words.is_empty() {
            return Err(Problem::new("expected a program and its arguments"));
        }
        let found = Self(words.iter().map(|word| parts(word)).collect::<Result<_, _>>()?);
        for name in REQUIRED {
            if !found.has(name) {
                return Err(Problem::new(format!("the command lacks {{{name}}}")));
            }
        }
        if needs_seed && !found.has("seed") {
            let message = "the runs of a noisy subject differ by their seed, and the command lacks {seed}";
            return Err(Problem::new(message));
        }
        Ok(found)
    }

    /// Whether a placeholder occurs.
    pub(crate) fn has(&self, name: &str) -> bool {
        let is_it = |part: &Part| matches!(part, Part::Placeholder(found) if *found == name);
        self.0.iter().flatten().any(is_it)
    }

    /// The program and its arguments. A relative program with a folder in its name is looked up in
    /// `folder`.
    pub(crate) fn fill(&self, values: &BTreeMap<&str, String>, folder: &Path) -> (PathBuf, Vec<String>) {
        let word = |parts: &Vec<Part>| -> String {
            let texts = parts.iter().map(|part| match part {
                Part::Text(text) => text.as_str(),
                Part::Placeholder(name) => values.get(name).map_or("", String::as_str),
            });
            texts.collect()
        };
        let mut words = self.0.iter().map(word);
        let program = PathBuf::from(words.next().unwrap_or_default());
        let program = match program.components().count() {
            0 | 1 => program,
            _ => folder.join(program),
        };
        (program, words.collect())
    }
}

fn parts(word: &str) -> Result<Vec<Part>, Problem> {
    let mut parts = Vec::new();
    let mut text = String::new();
    let mut rest = word;
    while let Some(at) = rest.find(['{', '}']) {
        text.push_str(&rest[..at]);
        let brace = &rest[at..=at];
        rest = &rest[at + 1..];
        if let Some(after) = rest.strip_prefix(brace) {
            text.push_str(brace);
            rest = after;
            continue;
        }
        let end = rest.find('}').filter(|_| brace == "{").ok_or_else(|| Problem {
            message: format!("a single {brace} in \"{word}\""),
            help: Some(format!("write {brace}{brace} for the character {brace}")),
        })?;
        let name = &rest[..end];
        rest = &rest[end + 1..];
        let Some(known) = PLACEHOLDERS.into_iter().find(|known| *known == name) else {
            let all: Vec<String> = PLACEHOLDERS.iter().map(|name| format!("{{{name}}}")).collect();
            return Err(Problem {
                message: format!(
                    "unknown placeholder {{{name}}}, expected one of {}",
                    all.join(", ")
                ),
                help: nearest(name, PLACEHOLDERS).map(|near| format!("did you mean {{{near}}}?")),
            });
        };
        if !text.is_empty() {
            parts.push(Part::Text(std::mem::take(&mut text)));
        }
        parts.push(Part::Placeholder(known));
    }
    text.push_str(rest);
    if !text.is_empty() || parts.is_empty() {
        parts.push(Part::Text(text));
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(line: &str) -> (PathBuf, Vec<String>) {
        let values = [("scene", "/a b/s.gltf"), ("output", "$(x).exr"), ("seed", "7")];
        let values = values.map(|(name, value)| (name, value.to_owned()));
        Arguments::parse(line, false)
            .unwrap()
            .fill(&BTreeMap::from(values), Path::new("/c"))
    }

    /// A value is never split or interpreted, and nothing of a shell has a meaning.
    #[test]
    fn words_are_split_before_placeholders_are_filled() {
        let (program, arguments) =
            filled("./t --in={scene} '-o {output}' {{seed}} \"\" $HOME;ls {seed}{seed}");
        assert_eq!(program, Path::new("/c/./t"));
        assert_eq!(
            arguments,
            ["--in=/a b/s.gltf", "-o $(x).exr", "{seed}", "", "$HOME;ls", "77"]
        );
        assert_eq!(filled("t {scene} {output}").0, Path::new("t"));
    }

    #[test]
    fn wrong_commands_are_reported() {
        let problem = |line: &str, seed| Arguments::parse(line, seed).unwrap_err();
        assert!(problem("", false).message.contains("expected a program"));
        assert!(problem("t 'x", false).message.contains("open"));
        assert_eq!(problem("t {scene}", false).message, "the command lacks {output}");
        assert!(problem("t {scene} {output}", true).message.contains("{seed}"));
        assert!(problem("t {scene} {output", false).message.contains("a single {"));
        assert!(problem("t {scene} output}", false).message.contains("a single }"));
        let near = problem("t {scene} {outptu}", false).help.unwrap();
        assert_eq!(near, "did you mean {output}?");
    }
}
