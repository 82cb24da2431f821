//! Renders a scene with a subject: exports it, runs the command, and reads the image.

use super::process::{self, RunError, RunLimits};
use super::{Output, Subject};
use crate::result::{SubjectRun, counted};
use crate::stop::Stop;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};
use whitstone_core::{ExportScene, FormatErrors, Note, Registry, Treatment};
use whitstone_image::planes::RGB;
use whitstone_image::{Codes, Image, Limits, Placement, atomic, picture};
use whitstone_scene::Flattened;

/// Maximum length of an image file in bytes. Larger files cannot be read.
const MAX_FILE: u64 = 8 << 30;
/// The exit code of a command that cannot render this scene, as for tests in Automake.
const SKIPPED: i32 = 77;
/// Resolution of the times of files, with a margin.
const TIME_RESOLUTION: Duration = Duration::from_secs(2);

/// Why there is no image of a subject.
#[derive(Debug, thiserror::Error)]
pub enum SubjectError {
    /// Its format cannot express the scene.
    #[error("{0}")]
    NotExpressible(String),
    /// The command cannot be started, or a file cannot be written.
    #[error("{0}")]
    Environment(String),
    /// The command ran, and gave no image of the scene.
    #[error("{0}")]
    Failed(String),
}

impl SubjectError {
    fn environment(problem: impl ToString) -> Self {
        Self::Environment(problem.to_string())
    }
}

impl From<RunError> for SubjectError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::NotStarted { .. } | RunError::Wait(_) => Self::environment(error),
            RunError::Failed { status, output } if status.code() == Some(SKIPPED) => {
                let why = output
                    .last_line()
                    .map_or(String::new(), |line| format!(": {line}"));
                Self::NotExpressible(format!("the command cannot render this scene{why}"))
            }
            _ => Self::Failed(error.to_string()),
        }
    }
}

/// A scene for a subject.
pub(crate) struct Job<'a> {
    pub(crate) registry: &'a Registry,
    /// The folder of all results.
    pub(crate) target: &'a Path,
    /// The folder of the scene's files, relative to that of the subject.
    pub(crate) folder: &'a Path,
    pub(crate) scene: &'a Flattened,
    pub(crate) size: [usize; 2],
    pub(crate) threads: usize,
    pub(crate) stage: &'a dyn Fn(&str),
    pub(crate) stop: &'a Stop,
}

/// The image of a subject.
pub(crate) struct Rendered {
    pub(crate) image: Image,
    /// The smallest and the largest values that the rounded numbers of a file can stand for.
    pub(crate) bounds: Option<[Image; 2]>,
    pub(crate) run: SubjectRun,
}

/// Exports a scene, runs the command of the subject and reads its image.
pub(crate) fn render(subject: &Subject, job: &Job<'_>) -> Result<Rendered, SubjectError> {
    let all = job.target.join("subjects").join(&subject.name);
    fs::create_dir_all(&all).map_err(|error| folder_problem(&all, &error))?;
    // Two runs must not share the folder of a scene.
    let lock = all.join(".lock");
    let lock = fs::File::create(&lock).map_err(|error| folder_problem(&lock, &error))?;
    lock.lock().map_err(SubjectError::environment)?;
    let folder = all.join(job.folder);
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|error| folder_problem(&folder, &error))?;
    }
    fs::create_dir_all(&folder).map_err(|error| folder_problem(&folder, &error))?;
    // The command has another working folder.
    let folder = std::path::absolute(&folder).map_err(|error| folder_problem(&folder, &error))?;
    (job.stage)(&format!("exporting for {}", subject.name));
    let scene = folder.join(format!("scene.{}", subject.extension));
    let mut run = SubjectRun {
        name: subject.name.clone(),
        scene_file: scene.display().to_string(),
        runs: subject.runs,
        approximated: export(subject, job, &scene)?,
        ..SubjectRun::default()
    };
    let mut mean = Mean::default();
    let mut single = None;
    for index in 0..subject.runs {
        (job.stage)(&match subject.runs {
            1 => subject.name.clone(),
            runs => format!("{}, run {} of {runs}", subject.name, index + 1),
        });
        let file = folder.join(format!("image.{}", subject.output.extension()));
        let (image, bounds) = run_once(subject, job, &scene, &file, index, &mut run)?;
        if subject.is_noisy() {
            mean.add(&image, bounds.as_ref())?;
        }
        single = Some((image, bounds));
    }
    if subject.is_noisy() && mean.is_constant() {
        run.remarks.push(format!(
            "all {} runs gave the same image, which is judged as one without noise: the command ignores {{seed}}, or \
             the subject is deterministic",
            subject.runs
        ));
    }
    match single {
        Some((image, bounds)) if !subject.is_noisy() || mean.is_constant() => {
            Ok(Rendered { image, bounds, run })
        }
        _ => Ok(Rendered {
            image: mean.image()?,
            bounds: mean.bounds()?,
            run,
        }),
    }
}

fn folder_problem(path: &Path, error: &std::io::Error) -> SubjectError {
    SubjectError::Environment(format!("{}: {error}", path.display()))
}

/// Exports the scene. Returns what the format approximates.
fn export(subject: &Subject, job: &Job<'_>, path: &Path) -> Result<Vec<String>, SubjectError> {
    let cannot = |why: &str| {
        SubjectError::NotExpressible(format!(
            "the format {} of subject {} cannot express the scene: {why}",
            subject.scene, subject.name
        ))
    };
    let mut document: toml::Table =
        (job.scene.text.parse()).map_err(|error: toml::de::Error| SubjectError::environment(error))?;
    // Only the colours of a subject are compared.
    if let Some(film) = document.get_mut("film").and_then(toml::Value::as_table_mut) {
        film.remove("aovs");
        film.remove("paths");
    }
    let scene = ExportScene {
        document: &document,
        base: &job.scene.base,
    };
    let format = (job.registry.formats()).find(|format| format.name() == subject.scene);
    let exported = format.and_then(|format| format.export(&scene, path));
    let notes = match exported {
        None => return Err(cannot("it is only read")),
        Some(Err(FormatErrors(errors))) => {
            let errors = errors.iter().map(|error| {
                let place = match error.place.as_str() {
                    "" => String::new(),
                    place => format!("{place}: "),
                };
                let help = error.help.iter().map(|help| format!(" ({help})"));
                format!("{place}{}{}", error.message, help.collect::<String>())
            });
            return Err(cannot(&errors.collect::<Vec<_>>().join("; ")));
        }
        Some(Ok(notes)) => notes,
    };
    let of = |treatment| {
        let notes = notes
            .iter()
            .filter(move |note| note.feature.treatment == treatment);
        notes.map(told).collect::<Vec<String>>()
    };
    let dropped = of(Treatment::Dropped);
    if !dropped.is_empty() {
        return Err(cannot(&dropped.join("; ")));
    }
    let approximated = of(Treatment::Approximated);
    if !path.is_file() {
        let how = approximated.join("; ");
        return Err(cannot(&format!("it takes more than one file: {how}")));
    }
    Ok(approximated)
}

fn told(note: &Note) -> String {
    let place = note
        .places
        .first()
        .map_or(String::new(), |place| format!(" ({place})"));
    format!(
        "{}{place}: {}",
        note.feature.name,
        note.feature.how.trim_end_matches('.')
    )
}

/// Runs the command once. Returns its image, and the smallest and largest values that the numbers
/// of its file can stand for, if they are rounded.
fn run_once(
    subject: &Subject,
    job: &Job<'_>,
    scene: &Path,
    file: &Path,
    seed: u32,
    told: &mut SubjectRun,
) -> Result<(Image, Option<[Image; 2]>), SubjectError> {
    let _ = fs::remove_file(file);
    let values = BTreeMap::from([
        ("scene", scene.display().to_string()),
        ("output", file.display().to_string()),
        ("width", job.size[0].to_string()),
        ("height", job.size[1].to_string()),
        ("samples", subject.samples.to_string()),
        ("seed", seed.to_string()),
        ("threads", job.threads.to_string()),
    ]);
    let (program, arguments) = subject.arguments.fill(&values, &subject.folder);
    told.command = std::iter::once(program.display().to_string())
        .chain(arguments.iter().cloned())
        .collect();
    let limits = RunLimits {
        time: subject.time_limit,
        memory: subject.memory_limit,
        file: (file.to_owned(), MAX_FILE),
        stop: job.stop.clone(),
    };
    let start = SystemTime::now();
    let run = process::run(&program, &arguments, &subject.folder, &limits)?;
    told.seconds += run.seconds;
    let log = file.with_file_name("output.txt");
    atomic::write_bytes(&log, run.output.log().as_bytes()).map_err(SubjectError::environment)?;
    told.log = log.display().to_string();
    if run.left_over > 0 {
        let remark = format!(
            "the command ended before {}, which were stopped",
            counted(run.left_over, "process it had started")
        );
        if !told.remarks.contains(&remark) {
            told.remarks.push(remark);
        }
    }
    let failed = |problem: String| SubjectError::Failed(format!("{problem}{}", run.output));
    let metadata = match fs::metadata(file) {
        Ok(metadata) => metadata,
        Err(_) => {
            return Err(failed(format!(
                "the command wrote no image to {}{}",
                file.display(),
                other_files(file, scene)
            )));
        }
    };
    if !metadata.is_file() {
        return Err(failed(format!("{} is not a regular file", file.display())));
    }
    if let Ok(written) = metadata.modified()
        && start
            .duration_since(written)
            .is_ok_and(|before| before > TIME_RESOLUTION)
    {
        return Err(failed(format!("{} is older than the run", file.display())));
    }
    if metadata.len() == 0 {
        return Err(failed(format!("{} is empty", file.display())));
    }
    let read = picture::read(file, Limits::IMAGE).map_err(|error| failed(error.to_string()))?;
    let [width, height] = job.size;
    let place = read.image.placement();
    if [place.frame_width, place.frame_height] != job.size {
        return Err(failed(format!(
            "the image has {} x {} pixels, expected {width} x {height}",
            place.frame_width, place.frame_height
        )));
    }
    if !read.codes.is_float() && subject.output != Output::Png {
        return Err(failed(format!(
            "the image has {}, expected a file of the kind {}",
            read.codes,
            subject.output.extension()
        )));
    }
    let planes = colors(&read.image, &subject.layer).map_err(failed)?;
    let planes = planes.map(|plane| framed(plane, read.image.width(), place));
    let largest = |index: usize| planes.iter().fold(0.0_f32, |most, plane| most.max(plane[index]));
    let values = |change: &dyn Fn(f64, f64) -> f64| -> Result<Image, SubjectError> {
        let mut image = Image::new(width, height).map_err(SubjectError::environment)?;
        for (name, plane) in RGB.into_iter().zip(&planes) {
            let value = |(index, code): (usize, &f32)| {
                (subject.scale * change(f64::from(*code), f64::from(largest(index)))) as f32
            };
            let plane: Vec<f32> = plane.iter().enumerate().map(value).collect();
            let plane = flipped(&plane, width, subject.flip).collect();
            image
                .add_channel(name, plane)
                .map_err(SubjectError::environment)?;
        }
        Ok(image)
    };
    let decode = |code: f64| match code.is_finite() {
        true => subject.transfer.decode(code),
        false => code,
    };
    let bound =
        |index: usize| move |code: f64, largest: f64| decode(read.codes.rounded_from(code, largest)[index]);
    let image = values(&|code, _| decode(code))?;
    let bounds = match read.codes {
        Codes::Float => None,
        _ => Some([values(&bound(0))?, values(&bound(1))?]),
    };
    Ok((image, bounds))
}

/// The samples of a plane in its whole frame, black where the image has no pixels: an EXR file may
/// hold a part of the frame, and what lies outside.
fn framed(plane: &[f32], width: usize, place: Placement) -> Vec<f32> {
    let mut frame = vec![0.0; place.frame_width * place.frame_height];
    for (y, row) in (i64::from(place.y)..).zip(plane.chunks_exact(width)) {
        let Ok(y) = usize::try_from(y) else { continue };
        if y >= place.frame_height {
            break;
        }
        for (x, value) in (i64::from(place.x)..).zip(row) {
            if let Ok(x) = usize::try_from(x)
                && x < place.frame_width
            {
                frame[y * place.frame_width + x] = *value;
            }
        }
    }
    frame
}

/// Files next to an image that was not written: a command may have appended an extension.
fn other_files(file: &Path, scene: &Path) -> String {
    let entries = file.parent().and_then(|folder| fs::read_dir(folder).ok());
    let is_other = |path: &Path| {
        let stem = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        path != scene && path.is_file() && stem.starts_with("image")
    };
    let found = entries.into_iter().flatten().flatten().map(|entry| entry.path());
    let mut names: Vec<String> = found
        .filter(|path| is_other(path))
        .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    match names.is_empty() {
        true => String::new(),
        false => format!("; in the same folder it wrote {}", names.join(", ")),
    }
}

/// The planes of the colours of an image.
fn colors<'a>(image: &'a Image, layer: &str) -> Result<[&'a [f32]; 3], String> {
    let of = |prefix: &str| -> Option<[&'a [f32]; 3]> {
        let [r, g, b] = RGB.map(|name| image.channel(&format!("{prefix}{name}")));
        Some([r?, g?, b?])
    };
    let prefix = match layer {
        "" => String::new(),
        layer => format!("{}.", layer.trim_end_matches('.')),
    };
    if let Some(found) = of(&prefix) {
        return Ok(found);
    }
    let names: Vec<&str> = image.channels().map(|(name, _)| name).collect();
    let prefixes: Vec<&str> = names.iter().filter_map(|name| name.strip_suffix('R')).collect();
    let layers: Vec<&str> = (prefixes.into_iter())
        .filter(|prefix| of(prefix).is_some())
        .collect();
    match (layer, layers.as_slice()) {
        ("", [only]) => of(only).ok_or_else(String::new),
        ("", []) => Err(format!(
            "the image has no colours; its channels are {}",
            names.join(", ")
        )),
        _ => Err(format!(
            "the image has no colours {prefix}R, {prefix}G, {prefix}B; expected `layer` to be one of: {}",
            layers
                .iter()
                .map(|layer| layer.trim_end_matches('.'))
                .collect::<Vec<_>>()
                .join(", ")
        )),
    }
}

/// The samples of a plane with reversed columns and rows.
fn flipped(plane: &[f32], width: usize, [columns, rows]: [bool; 2]) -> impl Iterator<Item = f32> {
    let height = plane.len() / width;
    (0..plane.len()).map(move |index| {
        let (x, y) = (index % width, index / width);
        let x = if columns { width - 1 - x } else { x };
        let y = if rows { height - 1 - y } else { y };
        plane[y * width + x]
    })
}

/// The mean and the variance of several images.
#[derive(Default)]
struct Mean {
    count: u32,
    size: [usize; 2],
    /// The mean and the sum of the squared deviations of each value.
    channels: [Vec<[f64; 2]>; 3],
    /// The sums of the smallest and of the largest values that the files can stand for.
    bounds: [[Vec<f64>; 3]; 2],
}

impl Mean {
    fn add(&mut self, image: &Image, bounds: Option<&[Image; 2]>) -> Result<(), SubjectError> {
        let planes = image.rgb().map_err(SubjectError::environment)?;
        for (sums, image) in self.bounds.iter_mut().zip(bounds.into_iter().flatten()) {
            let planes = image.rgb().map_err(SubjectError::environment)?;
            for (sums, plane) in sums.iter_mut().zip(planes) {
                sums.resize(plane.len(), 0.0);
                for (sum, &value) in sums.iter_mut().zip(plane) {
                    // Radiance is not negative: a black run does not leave the mean without a
                    // bound.
                    *sum += f64::from(value.max(0.0));
                }
            }
        }
        self.count += 1;
        self.size = [image.width(), image.height()];
        for (channel, plane) in self.channels.iter_mut().zip(planes) {
            channel.resize(plane.len(), [0.0; 2]);
            for ([mean, squares], &value) in channel.iter_mut().zip(plane) {
                // Welford 1962, "Note on a method for calculating corrected sums of squares".
                let deviation = f64::from(value) - *mean;
                *mean += deviation / f64::from(self.count);
                *squares += deviation * (f64::from(value) - *mean);
            }
        }
        Ok(())
    }

    /// Whether all images were the same.
    fn is_constant(&self) -> bool {
        self.channels.iter().flatten().all(|[_, squares]| *squares == 0.0)
    }

    /// The means of the bounds, if the files have rounded numbers.
    fn bounds(&self) -> Result<Option<[Image; 2]>, SubjectError> {
        let [width, height] = self.size;
        let of = |sums: &[Vec<f64>; 3]| -> Result<Image, SubjectError> {
            let mut image = Image::new(width, height).map_err(SubjectError::environment)?;
            for (name, sums) in RGB.into_iter().zip(sums) {
                let means = sums.iter().map(|sum| (sum / f64::from(self.count)) as f32);
                (image.add_channel(name, means.collect())).map_err(SubjectError::environment)?;
            }
            Ok(image)
        };
        if self.bounds[0][0].is_empty() {
            return Ok(None);
        }
        Ok(Some([of(&self.bounds[0])?, of(&self.bounds[1])?]))
    }

    /// The mean, with layers of the variance of one run.
    fn image(&self) -> Result<Image, SubjectError> {
        let [width, height] = self.size;
        let mut image = Image::new(width, height).map_err(SubjectError::environment)?;
        let runs = f64::from(self.count);
        for (name, channel) in RGB.into_iter().zip(&self.channels) {
            let means = channel.iter().map(|[mean, _]| *mean as f32).collect();
            let variances = channel.iter().map(|[_, squares]| (squares / (runs - 1.0)) as f32);
            (image.add_channel(name, means)).map_err(SubjectError::environment)?;
            (image.add_channel(format!("variance.{name}"), variances.collect()))
                .map_err(SubjectError::environment)?;
        }
        let counts = vec![runs as f32; width * height];
        (image.add_channel("samples.N", counts)).map_err(SubjectError::environment)?;
        Ok(image)
    }
}

/// Takes each value of an image with rounded numbers to the value nearest to the reference's that
/// the number can stand for. Returns whether the image says anything: one that is black or white
/// all over, and equals the reference then, could stand for any dark or bright image.
pub(crate) fn nearest_to(reference: &Image, bounds: &[Image; 2], image: &mut Image) -> bool {
    let [low, high] = bounds;
    let all = |image: &Image, is: fn(f32) -> bool| {
        let plane_is = |name| {
            image
                .channel(name)
                .is_some_and(|plane| plane.iter().all(|value| is(*value)))
        };
        RGB.into_iter().all(plane_is)
    };
    let is_open = all(low, |value| value < 0.0) || all(high, |value| value == f32::INFINITY);
    for name in RGB {
        let (Some(plane), Some(low), Some(high), Some(reference)) = (
            image.channel_mut(name),
            low.channel(name),
            high.channel(name),
            reference.channel(name),
        ) else {
            continue;
        };
        for (index, value) in plane.iter_mut().enumerate() {
            if !value.is_finite() {
                continue;
            }
            // `clamp` panics if a bound is NaN.
            let near = reference
                .get(index)
                .map_or(*value, |near| near.max(low[index]).min(high[index]));
            *value = if near.is_finite() { near } else { *value };
        }
    }
    // An image that cannot stand for the reference is wrong.
    !is_open
        || RGB
            .iter()
            .any(|name| image.channel(name) != reference.channel(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_variance_of_runs() {
        let mut mean = Mean::default();
        for value in [1.0, 2.0, 6.0] {
            let image = Image::from_rgb(1, 1, &[[value, 1.0, -value]]).unwrap();
            mean.add(&image, None).unwrap();
        }
        assert!(!mean.is_constant());
        let image = mean.image().unwrap();
        let at = |name: &str| image.channel(name).unwrap()[0];
        assert_eq!([at("R"), at("G"), at("B")], [3.0, 1.0, -3.0]);
        assert_eq!(
            [at("variance.R"), at("variance.G"), at("samples.N")],
            [7.0, 0.0, 3.0]
        );
    }

    #[test]
    fn a_value_is_any_that_its_number_stands_for() {
        let image = |values: [f32; 3]| Image::from_rgb(1, 1, &[values]).unwrap();
        let reference = image([1.0, 2.0, 3.0]);
        let bounds = [image([0.9, 2.1, 2.9]), image([1.1, 2.2, 3.1])];
        let mut ours = image([1.05, 2.15, f32::NAN]);
        assert!(nearest_to(&reference, &bounds, &mut ours));
        let found = ours.rgb().unwrap().map(|plane| plane[0]);
        assert_eq!(found[..2], [1.0, 2.1]);
        assert!(found[2].is_nan());
        // White all over: it could stand for this reference, and not for a darker one.
        let bounds = [image([0.9; 3]), image([f32::INFINITY; 3])];
        assert!(!nearest_to(&reference, &bounds, &mut image([1.0; 3])));
        assert!(nearest_to(&image([0.5; 3]), &bounds, &mut image([1.0; 3])));
    }

    #[test]
    fn bounds_of_runs_are_averaged() {
        let image = |value: f32| Image::from_rgb(1, 1, &[[value; 3]]).unwrap();
        let mut mean = Mean::default();
        assert!(mean.bounds().is_ok_and(|bounds| bounds.is_none()));
        for (low, high) in [(f32::NEG_INFINITY, 2.0), (4.0, f32::INFINITY)] {
            mean.add(&image(1.0), Some(&[image(low), image(high)])).unwrap();
        }
        let [low, high] = mean.bounds().unwrap().unwrap();
        assert_eq!(low.rgb().unwrap()[0], [2.0]);
        assert_eq!(high.rgb().unwrap()[0], [f32::INFINITY]);
    }

    #[test]
    fn an_image_is_placed_in_its_frame() {
        let place = |x, y| Placement {
            x,
            y,
            frame_width: 3,
            frame_height: 2,
        };
        let plane = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(framed(&plane, 2, place(1, 0)), [0.0, 1.0, 2.0, 0.0, 3.0, 4.0]);
        assert_eq!(framed(&plane, 2, place(-1, 1)), [0.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
        assert_eq!(framed(&plane, 2, place(2, -1)), [0.0, 0.0, 3.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn rows_and_columns_are_reversed() {
        let plane = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let flip = |flip| flipped(&plane, 3, flip).collect::<Vec<f32>>();
        assert_eq!(flip([false, false]), plane);
        assert_eq!(flip([true, false]), [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]);
        assert_eq!(flip([false, true]), [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_layer_is_found_or_named() {
        let image = |names: &[&str]| {
            let mut image = Image::new(1, 1).unwrap();
            for (index, name) in names.iter().enumerate() {
                image.add_channel(*name, vec![index as f32]).unwrap();
            }
            image
        };
        let one = image(&[
            "View.Combined.R",
            "View.Combined.G",
            "View.Combined.B",
            "View.Depth.Z",
        ]);
        assert_eq!(colors(&one, "").unwrap()[1], [1.0]);
        let two = image(&["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"]);
        assert_eq!(colors(&two, "b").unwrap()[0], [3.0]);
        assert!(colors(&two, "").unwrap_err().contains("a, b"));
        assert!(colors(&two, "c").unwrap_err().contains("a, b"));
        assert!(colors(&image(&["Z"]), "").unwrap_err().contains("no colours"));
    }

    /// A code is as good as any value that is rounded to it, and no better.
    #[test]
    fn a_code_stands_for_an_interval() {
        let one = |value: f32| Image::from_rgb(1, 1, &[[value; 3]]).unwrap();
        let nearest = |reference: f32, low: f32, high: f32| {
            let mut image = one(0.5);
            nearest_to(&one(reference), &[one(low), one(high)], &mut image);
            image.channel("R").unwrap()[0]
        };
        assert_eq!(nearest(0.501, 0.49, 0.51), 0.501);
        assert_eq!(nearest(0.6, 0.49, 0.51), 0.51);
        assert_eq!(nearest(7.0, 0.99, f32::INFINITY), 7.0);
        assert_eq!(nearest(f32::INFINITY, 0.99, f32::INFINITY), 0.5);
    }
}
