use crate::document;
use crate::import;
use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use thiserror::Error;
use whitstone_core::config::FilePath;
use whitstone_core::{ImportOptions, Note, Registry, SceneError, SceneErrors, SourceSpan};

/// Maximum size of a scene file in bytes. Scenes are written by hand or by small programs; data
/// belongs into the files that they name.
const MAX_FILE_BYTES: u64 = 16 << 20;
/// Maximum number of files that a scene may include.
const MAX_FILES: usize = 256;
/// Maximum size of all texts together in bytes, including the spaces before them: see [`Sources`].
const MAX_PADDED_BYTES: usize = 256 << 20;
/// Memory for each byte of text, while the scene is read: measured with 100,000 lights.
const TEXT_BYTES: u64 = 44;
/// Maximum number of errors in a report.
const MAX_REPORTED: usize = 50;
/// Maximum nesting of includes.
const MAX_DEPTH: usize = 32;

/// The text of a scene: the file, its includes, and the overrides of the command line.
///
/// Positions are byte ranges in the concatenation of all texts. To get such positions from the TOML
/// parser, each text is padded with as many spaces as the texts before it have bytes.
#[derive(Debug, Default)]
pub struct Sources {
    /// In merge order: a file comes after its includes, and overrides come last.
    files: Vec<Source>,
    /// Folder of the scene file; paths in the flattened document are relative to it.
    base: PathBuf,
    /// What the importers of other formats report, by file.
    notes: Vec<(PathBuf, Vec<Note>)>,
    /// Files that imported files refer to.
    companions: Vec<PathBuf>,
    /// The folder that must contain all files, without links.
    root: Option<PathBuf>,
    /// Memory limit for all texts, in bytes.
    max_memory: Option<u64>,
    end: usize,
}

#[derive(Debug)]
struct Source {
    /// The name for messages.
    name: String,
    /// Folder of its paths, relative to the base; empty for the base itself.
    folder: PathBuf,
    /// Start of its text.
    start: usize,
    /// The text after `start` spaces.
    padded: String,
    /// For an override, the same text with its path replaced by `v`: a document with one value.
    padded_value: String,
    kind: SourceKind,
    /// Start of each line, found on first use.
    line_starts: OnceLock<Vec<usize>>,
}

#[derive(Debug, PartialEq, Eq)]
enum SourceKind {
    File,
    /// The translation of a file of another format.
    Import,
    Override,
}

/// Why a scene could not be read, with the texts that were read, so that positions can be shown.
#[derive(Debug, Error)]
#[error("{errors}")]
pub struct LoadError {
    /// For [`Sources::report`].
    pub sources: Sources,
    /// What is wrong.
    pub errors: SceneErrors,
}

/// A position for messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Position {
    /// Path of the file, or the override.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, in characters.
    pub column: usize,
}

impl Sources {
    /// Reads a scene file and, recursively, its includes and imports. A file whose extension
    /// belongs to a format of the registry is imported. `overrides` are `path=value`, as given to
    /// `--set`.
    pub fn load(path: &Path, overrides: &[String], registry: &Registry) -> Result<Self, Box<LoadError>> {
        Self::load_with(path, overrides, registry, &ImportOptions::all())
    }

    /// [`Self::load`], with options for a file that is imported. The format "toml" stands for this
    /// crate's own.
    pub fn load_with(
        path: &Path,
        overrides: &[String],
        registry: &Registry,
        options: &ImportOptions,
    ) -> Result<Self, Box<LoadError>> {
        let base = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut loader = Loader::new(base, registry);
        let name = path.display().to_string();
        loader.sources.max_memory = options.max_memory;
        match options.root.as_ref().map(|root| (root, root.canonicalize())) {
            None => {}
            Some((_, Ok(root))) => loader.sources.root = Some(root),
            Some((root, Err(error))) => {
                loader.fail(None, format!("cannot read the root {}: {error}", root.display()));
                return loader.finish(&[]);
            }
        }
        let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
        if options.format.is_none()
            && registry.format_of(path).is_none()
            && extension.is_some_and(|extension| extension != "toml")
        {
            let known = import::extensions(registry, &[".toml"]);
            let message = format!("{name}: unknown format; expected a file that ends in {known}");
            loader.fail(None, message);
            return loader.finish(&[]);
        }
        // TOML scenes are read here, though they may have a format for export.
        let is_toml = match &options.format {
            Some(name) => name == "toml",
            None => registry
                .format_of(path)
                .is_none_or(|format| format.name() == "toml"),
        };
        if !is_toml {
            loader.import(path, options, PathBuf::new(), name, None);
        } else {
            loader.file(path.to_owned(), PathBuf::new(), name, None);
        }
        loader.finish(overrides)
    }

    /// A scene from memory. `name` stands for the file in messages; its paths are relative to
    /// `base`. It can include TOML files, but not import other formats.
    pub fn from_text(
        name: &str,
        text: &str,
        base: &Path,
        overrides: &[String],
    ) -> Result<Self, Box<LoadError>> {
        let registry = Registry::default();
        let mut loader = Loader::new(base.to_owned(), &registry);
        loader.text(text, name.to_owned(), PathBuf::new(), SourceKind::File);
        loader.finish(overrides)
    }

    /// What the importers of other formats report, by file.
    pub fn notes(&self) -> &[(PathBuf, Vec<Note>)] {
        &self.notes
    }

    /// Files that imported files refer to and the scene does not name.
    pub(crate) fn companions(&self) -> &[PathBuf] {
        &self.companions
    }

    /// An error if a file is not in the root. A file that does not exist is none here.
    pub(crate) fn check_root(&self, path: &Path) -> Result<(), String> {
        let Some(root) = &self.root else {
            return Ok(());
        };
        match path.canonicalize() {
            Ok(real) if !real.starts_with(root) => Err(format!(
                "\"{}\" is not in the root {} (`--root`)",
                path.display(),
                root.display()
            )),
            _ => Ok(()),
        }
    }

    /// Folder of the scene file.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// Name of the scene file.
    pub fn name(&self) -> &str {
        self.main().map_or("scene", |source| &source.name)
    }

    /// The scene file; none if it could not be read.
    fn main(&self) -> Option<&Source> {
        self.files
            .iter()
            .rev()
            .find(|source| source.kind != SourceKind::Override)
    }

    /// The scene files that were read.
    pub fn scene_files(&self) -> impl Iterator<Item = &Path> {
        let files = self.files.iter();
        files
            .filter(|source| source.kind != SourceKind::Override)
            .map(|source| Path::new(&source.name))
    }

    /// The padded files for the parser, each after its includes.
    pub(crate) fn padded_files(&self) -> impl Iterator<Item = &str> {
        self.files
            .iter()
            .filter(|source| source.kind != SourceKind::Override)
            .map(|source| source.padded.as_str())
    }

    /// The overrides in the given order, each as (start, padded text, padded value).
    pub(crate) fn overrides(&self) -> impl Iterator<Item = (usize, &str, &str)> {
        self.files
            .iter()
            .filter(|source| source.kind == SourceKind::Override)
            .map(|source| (source.start, source.padded.as_str(), source.padded_value.as_str()))
    }

    /// A path that is written at a position, relative to the base.
    pub fn relative_to_base(&self, span: &SourceSpan, path: &str) -> PathBuf {
        match self.source_at(span.start) {
            Some(source) => source.folder.join(path),
            None => PathBuf::from(path),
        }
    }

    /// The path of a file that the scene names: relative to the file that names it.
    pub fn path_of(&self, file: &FilePath) -> PathBuf {
        self.base().join(self.relative_to_base(&file.span, &file.path))
    }

    fn source_at(&self, offset: usize) -> Option<&Source> {
        self.files
            .iter()
            .filter(|source| source.start <= offset)
            .max_by_key(|source| source.start)
    }

    /// File, line and column of the start of a span.
    pub fn position(&self, span: &SourceSpan) -> Option<Position> {
        let source = self.source_at(span.start)?;
        let (line, line_start) = source.line(span.start);
        let before = source.padded.get(line_start..span.start)?;
        Some(Position {
            file: source.shown_name(),
            line,
            column: before.chars().count() + 1,
        })
    }

    /// A readable report of the errors, each with its position, the line, and advice; `color`
    /// enables ANSI colours.
    pub fn report(&self, errors: &SceneErrors, color: bool) -> String {
        self.report_at(Level::ERROR, errors.0.iter(), color)
    }

    /// A report of warnings, in the same form.
    pub fn report_warnings(&self, warnings: &[SceneError], color: bool) -> String {
        self.report_at(Level::WARNING, warnings.iter(), color)
    }

    fn report_at<'a>(
        &self,
        level: Level<'static>,
        items: impl Iterator<Item = &'a SceneError>,
        color: bool,
    ) -> String {
        let renderer = if color {
            Renderer::styled()
        } else {
            Renderer::plain()
        };
        let mut sorted: Vec<&SceneError> = items.collect();
        sorted.sort_by_key(|error| error.span.as_ref().map_or(usize::MAX, |span| span.start));
        let more = sorted.len().saturating_sub(MAX_REPORTED);
        let mut reports: Vec<String> = sorted
            .into_iter()
            .take(MAX_REPORTED)
            .map(|error| {
                let mut group = Group::with_title(level.clone().primary_title(printable(&error.message)));
                if let Some(span) = &error.span
                    && let Some(source) = self.source_at(span.start)
                {
                    let end = span.end.min(source.padded.len());
                    let start = span.start.min(end);
                    // Only the lines of the span: the renderer looks at all that it is given.
                    let (line, from) = source.line(start);
                    let text = source.lines_to(from, end);
                    let snippet = Snippet::source(text)
                        .line_start(line)
                        .path(source.shown_name())
                        .annotation(AnnotationKind::Primary.span(start - from..end - from));
                    group = group.element(snippet);
                } else if let Some(source) = self.main() {
                    group = group.element(Origin::path(&source.name));
                }
                if let Some(help) = &error.help {
                    group = group.element(Level::HELP.message(printable(help)));
                }
                renderer.render(&[group])
            })
            .collect();
        if more > 0 {
            reports.push(format!("... and {more} more"));
        }
        reports.join("\n\n")
    }
}

/// Text of a scene for use in a message, without terminal control characters.
fn printable(text: &str) -> String {
    let shown = |c: char| {
        let plain = !c.is_control() || c == '\n';
        if plain {
            c.to_string()
        } else {
            c.escape_default().to_string()
        }
    };
    text.chars().map(shown).collect()
}

impl Source {
    /// The line of a position, numbered from 1, and its start.
    fn line(&self, position: usize) -> (usize, usize) {
        let starts = self.line_starts.get_or_init(|| {
            let text = &self.padded[self.start..];
            let later = text.match_indices('\n').map(|(at, _)| self.start + at + 1);
            std::iter::once(self.start).chain(later).collect()
        });
        let line = starts.partition_point(|start| *start <= position).max(1);
        (line, starts[line - 1])
    }

    /// The text from a position to the end of the line of another one.
    fn lines_to(&self, from: usize, position: usize) -> &str {
        let rest = self.padded.get(position..).unwrap_or_default();
        let end = rest.find('\n').map_or(self.padded.len(), |at| position + at + 1);
        self.padded.get(from..end).unwrap_or_default()
    }

    /// The name for messages with a line number.
    fn shown_name(&self) -> String {
        match self.kind {
            SourceKind::Import => format!("{} (converted to TOML)", self.name),
            SourceKind::File | SourceKind::Override => self.name.clone(),
        }
    }
}

struct Loader<'r> {
    registry: &'r Registry,
    sources: Sources,
    errors: SceneErrors,
    /// Files that are being read. Including one of them again is a cycle.
    open: Vec<PathBuf>,
    /// Files that have been read. Including one of them again has no effect.
    done: Vec<PathBuf>,
}

impl<'r> Loader<'r> {
    fn new(base: PathBuf, registry: &'r Registry) -> Self {
        Self {
            registry,
            sources: Sources {
                base,
                ..Sources::default()
            },
            errors: SceneErrors::default(),
            open: Vec::new(),
            done: Vec::new(),
        }
    }

    fn finish(mut self, overrides: &[String]) -> Result<Sources, Box<LoadError>> {
        for text in overrides {
            let name = format!("--set {text}");
            self.push(text, name, PathBuf::new(), SourceKind::Override);
        }
        if self.errors.0.is_empty() {
            Ok(self.sources)
        } else {
            Err(Box::new(LoadError {
                sources: self.sources,
                errors: self.errors,
            }))
        }
    }

    fn fail(&mut self, at: Option<&SourceSpan>, message: String) {
        self.errors.0.push(SceneError {
            span: at.cloned(),
            message,
            help: None,
        });
    }

    fn file(&mut self, path: PathBuf, folder: PathBuf, name: String, at: Option<&SourceSpan>) {
        if let Err(problem) = self.sources.check_root(&path) {
            return self.fail(at, problem);
        }
        let identity = path.canonicalize().unwrap_or_else(|_| path.clone());
        if self.done.contains(&identity) {
            return;
        }
        if self.open.contains(&identity) {
            return self.fail(at, format!("\"{name}\" includes itself"));
        }
        if self.open.len() >= MAX_DEPTH || self.sources.files.len() >= MAX_FILES {
            return self.fail(
                at,
                format!("too many includes: expected at most {MAX_DEPTH} levels and {MAX_FILES} files"),
            );
        }
        match read_text(&path) {
            Err(problem) => self.fail(at, format!("cannot read scene \"{name}\": {problem}")),
            Ok(text) => {
                self.open.push(identity);
                self.text(&text, name, folder, SourceKind::File);
                self.done.extend(self.open.pop());
            }
        }
    }

    /// Translates a file of another format and adds the result.
    fn import(
        &mut self,
        path: &Path,
        options: &ImportOptions,
        folder: PathBuf,
        name: String,
        at: Option<&SourceSpan>,
    ) {
        if self.sources.files.len() >= MAX_FILES {
            return self.fail(at, format!("too many files: expected at most {MAX_FILES}"));
        }
        if let Err(problem) = self.sources.check_root(path) {
            return self.fail(at, problem);
        }
        let options = &ImportOptions {
            root: self.sources.root.clone(),
            ..options.clone()
        };
        let format = match &options.format {
            Some(name) => self.registry.formats().find(|format| format.name() == name),
            None => self.registry.format_of(path),
        };
        let imported = format.and_then(|format| format.import(path, options));
        match imported {
            None => {
                let known = import::extensions(self.registry, &[]);
                self.fail(
                    at,
                    format!("cannot read \"{name}\": expected a file that ends in {known}"),
                );
            }
            Some(Err(errors)) => {
                let errors = errors
                    .0
                    .into_iter()
                    .map(|error| import::located(error, &name, at));
                self.errors.0.extend(errors);
            }
            Some(Ok(imported)) => {
                for file in &imported.files {
                    if let Err(problem) = self.sources.check_root(file) {
                        return self.fail(at, problem);
                    }
                }
                self.sources.notes.push((path.to_owned(), imported.notes));
                self.sources.companions.extend(imported.files);
                self.text(&imported.text, name, folder, SourceKind::Import);
            }
        }
    }

    fn text(&mut self, text: &str, name: String, folder: PathBuf, kind: SourceKind) {
        let index = self.push(text, name, folder.clone(), kind);
        if !document::may_refer(text) {
            // Syntax errors are found when the scene is parsed.
            return;
        }
        let (mut table, errors) = document::parse(&self.sources.files[index].padded);
        self.errors.0.extend(errors.0);
        let (includes, errors) = document::includes(&table);
        self.errors.0.extend(errors.0);
        let (imports, errors) = import::imports(&mut table);
        self.errors.0.extend(errors.0);
        for found in imports {
            let relative = folder.join(&found.file);
            let path = self.sources.base.join(&relative);
            let folder = relative.parent().unwrap_or(Path::new("")).to_owned();
            let name = path.display().to_string();
            self.import(&path, &found.options, folder, name, Some(&found.span));
        }
        for (span, include) in includes {
            let relative = folder.join(&include);
            let path = self.sources.base.join(&relative);
            let folder = relative.parent().unwrap_or(Path::new("")).to_owned();
            self.file(path.clone(), folder, path.display().to_string(), Some(&span));
        }
        // Merging goes from first to last, and a file overrides its includes.
        let file = self.sources.files.remove(index);
        self.sources.files.push(file);
    }

    fn push(&mut self, text: &str, name: String, folder: PathBuf, kind: SourceKind) -> usize {
        // A byte order mark is not part of the text.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let start = self.sources.end;
        let so_far: usize = self.sources.files.iter().map(|source| source.padded.len()).sum();
        let text = if so_far + start + text.len() > MAX_PADDED_BYTES {
            let problem = format!(
                "\"{name}\": the files of this scene are too large in total; the limit is {} MiB, each file counted with all files before it",
                MAX_PADDED_BYTES >> 20
            );
            self.fail(None, problem);
            ""
        } else if let Some(limit) = self.sources.max_memory
            && (so_far + text.len()) as u64 * TEXT_BYTES > limit
        {
            let gib = |bytes: u64| bytes as f64 / (1_u64 << 30) as f64;
            let problem = format!(
                "\"{name}\": reading the text of this scene needs about {:.3} GiB of memory, more than the limit: {:.3} GiB",
                gib((so_far + text.len()) as u64 * TEXT_BYTES),
                gib(limit)
            );
            self.errors.0.push(
                SceneError::anywhere(problem).with_help("set another limit with `--max-memory`, in GiB"),
            );
            ""
        } else {
            text
        };
        let padded_value = match text.split_once('=') {
            Some((path, value)) if kind == SourceKind::Override => {
                " ".repeat((start + path.len()).saturating_sub(1)) + "v=" + value
            }
            _ => String::new(),
        };
        self.sources.files.push(Source {
            name,
            folder,
            start,
            padded: " ".repeat(start) + text,
            padded_value,
            kind,
            line_starts: OnceLock::new(),
        });
        // One byte separates texts, so that the end of one is not the start of the next.
        self.sources.end = start + text.len() + 1;
        self.sources.files.len() - 1
    }
}

fn read_text(path: &Path) -> Result<String, String> {
    let metadata = fs::metadata(path).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("not a regular file".into());
    }
    let file = fs::File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(format!("larger than {} MiB", MAX_FILE_BYTES >> 20));
    }
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = valid.iter().filter(|byte| **byte == b'\n').count() + 1;
        format!("not UTF-8 text (line {line})")
    })
}
