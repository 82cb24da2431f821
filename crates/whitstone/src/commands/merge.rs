//! `merge`: makes images, or the report of a validation, of the results of jobs.

use crate::jobs::{self, Inputs, Job, Picture, Rendered, Results, Task, Tile};
use crate::terminal::{self, Exit, Failure, write_json};
use clap::Args;
use serde_json::json;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use whitstone_image::{Image, exr_io};

/// Merge the results of jobs into the images of their scenes, or into the report of their
/// validation
///
/// An image has the bytes that `render` writes of the same scene with the same options, for any
/// tile size and any number of workers. Results are checked by their hashes. Only the tiles of some
/// rows are in memory at a time.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone merge jobs.jsonl -o classic.exr\n  whitstone merge jobs.jsonl --results /shared/results -o images"
)]
pub struct Arguments {
    /// File of jobs
    jobs: PathBuf,
    /// Folder of the results [default: the name of the file of jobs with .results]
    #[arg(long, value_name = "DIR")]
    results: Option<PathBuf>,
    /// The image to write (.exr); with jobs of several scenes, a folder of images; with jobs of
    /// `plan --validate`, the folder of the report
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
    /// Write the paths, sizes and sums of all jobs to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let jobs = Job::read(&arguments.jobs, |_, _| true)?;
    let folder = arguments.results.clone();
    let results = Results(folder.unwrap_or_else(|| super::run_job::default_results(&arguments.jobs)));
    if jobs.iter().all(|job| tile(job).is_none()) {
        missing(jobs.iter(), &results)?;
        let json = arguments.json.as_deref();
        return super::validate::parts::merge(&jobs, &results, &arguments.output, json);
    }
    let mut images: Vec<((Inputs, Picture), Vec<Job>)> = Vec::new();
    for job in jobs {
        let (_, picture) = tile(&job)
            .ok_or_else(|| Failure::usage(format!("job {}: {} has no image", job.id, job.what())))?;
        let of = (job.depends_on(), picture.clone());
        match images.iter_mut().find(|(known, _)| *known == of) {
            Some((_, tiles)) => tiles.push(job),
            None => images.push((of, vec![job])),
        }
    }
    let is_file = arguments
        .output
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
    if is_file && images.len() > 1 {
        return Err(Failure::usage(format!(
            "{}: the jobs are of {} images; expected a folder",
            arguments.output.display(),
            images.len()
        )));
    }
    let path_of = |picture: &Picture| match is_file {
        true => arguments.output.clone(),
        false => arguments.output.join(&picture.scene).with_extension("exr"),
    };
    for (k, ((_, picture), _)) in images.iter().enumerate() {
        if images[..k]
            .iter()
            .any(|((_, other), _)| path_of(other) == path_of(picture))
        {
            return Err(Failure::usage(format!(
                "two images would be written to {}; merge them apart",
                path_of(picture).display()
            )));
        }
    }
    for ((_, picture), tiles) in &images {
        super::render::check_apart(&[&path_of(picture)], &jobs::input_paths(tiles))?;
    }
    missing(images.iter().flat_map(|(_, tiles)| tiles), &results)?;
    let mut told = Vec::new();
    for ((_, picture), tiles) in &images {
        let output = path_of(picture);
        if let Some(folder) = output.parent().filter(|_| !is_file) {
            terminal::make_folder(folder)?;
        }
        let (sums, _) = merge(tiles, &results, &output)?;
        println!("{}", sums.line(&output, picture));
        told.push(sums.json(&output, picture));
    }
    if let Some(path) = &arguments.json {
        write_json(path, &json!(told))?;
    }
    Ok(Exit::Pass)
}

/// An error that names the jobs without a complete result.
fn missing<'j>(jobs: impl Iterator<Item = &'j Job>, results: &Results) -> Result<(), Failure> {
    /// Number of jobs that are named.
    const NAMED: usize = 10;
    let (mut all, mut found) = (0, Vec::new());
    for job in jobs {
        all += 1;
        if results.find(job).is_none() {
            found.push(format!("{} ({})", job.id, job.what()));
        }
    }
    if found.is_empty() {
        return Ok(());
    }
    let more = found.len().saturating_sub(NAMED);
    let named = found[..found.len().min(NAMED)].join("\n  ");
    let more = if more > 0 {
        format!("\n  and {more} more")
    } else {
        String::new()
    };
    Err(Failure::environment(format!(
        "{} of {all} jobs have no complete result in {}:\n  {named}{more}",
        found.len(),
        results.0.display()
    )))
}

/// Sums over the jobs of an image.
#[derive(Default)]
pub(super) struct Sums {
    jobs: usize,
    rays: u64,
    render_s: f64,
    build_s: f64,
    not_finite: usize,
}

impl Sums {
    fn add(&mut self, record: &Rendered) {
        self.jobs += 1;
        self.rays += record.rays;
        self.render_s += record.render_s;
        self.build_s += record.build_s;
        self.not_finite += record.not_finite;
    }

    /// What is known of an image.
    pub(super) fn json(&self, output: &Path, picture: &Picture) -> serde_json::Value {
        json!({
            "output": output, "scene": picture.scene, "width": picture.width, "height": picture.height,
            "jobs": self.jobs, "rays": self.rays, "render_s": self.render_s, "build_s": self.build_s,
            "not_finite": self.not_finite,
        })
    }

    /// One line about an image.
    pub(super) fn line(&self, output: &Path, picture: &Picture) -> String {
        format!(
            "{}: {} x {}, {} rays in {}; all jobs together rendered {:.3} s and built {:.3} s{}",
            output.display(),
            picture.width,
            picture.height,
            self.rays,
            whitstone_validate::counted(self.jobs, "job"),
            self.render_s,
            self.build_s,
            match self.not_finite {
                0 => String::new(),
                count => format!("; warning: {count} pixels are not finite"),
            }
        )
    }
}

/// The tile that a job renders.
fn tile(job: &Job) -> Option<(Tile, &Picture)> {
    match &job.task {
        Task::Render { tile, picture } => Some((*tile, picture)),
        Task::Run { .. } => None,
    }
}

/// Writes the image of some jobs, all of which render tiles of it.
pub(super) fn merge<'j>(
    jobs: &'j [Job],
    results: &Results,
    output: &Path,
) -> Result<(Sums, &'j Picture), Failure> {
    let mut sorted: Vec<(Tile, &Job)> = jobs.iter().filter_map(|job| Some((tile(job)?.0, job))).collect();
    let Some((picture, first)) = sorted.first().and_then(|(_, job)| Some((tile(job)?.1, *job))) else {
        return Err(Failure::usage("no jobs to merge"));
    };
    let size = [picture.width, picture.height].map(|pixels| pixels as usize);
    sorted.sort_by_key(|([x, y, ..], _)| (*y, *x));
    sorted.dedup_by_key(|(_, job)| &job.id);
    let mut waiting = sorted.into_iter().peekable();
    let mut open: Vec<(Range<usize>, usize, Image)> = Vec::new();
    let mut sums = Sums::default();
    let (_, like) = results.image(first).map_err(Failure::environment)?;
    let rows = |range: Range<usize>| {
        while let Some((tile, job)) = waiting.next_if(|([_, y, ..], _)| (*y as usize) < range.end) {
            let (record, image) = results.image(job).map_err(io::Error::other)?;
            if image.attributes() != like.attributes() {
                let problem = format!(
                    "job {}: the result has other attributes than that of {}",
                    job.id, first.id
                );
                return Err(io::Error::other(problem));
            }
            sums.add(&record);
            let [x, y, _, height] = tile.map(|pixels| pixels as usize);
            open.push((y..y + height, x, image));
        }
        let band = band(range.clone(), size[0], &like, &open)?;
        open.retain(|(rows, ..)| rows.end > range.end);
        Ok(band)
    };
    exr_io::write_rows(output, &like, size, rows).map_err(Failure::environment)?;
    Ok((sums, picture))
}

/// Some rows of the image, from the tiles that they cross.
fn band(
    range: Range<usize>,
    width: usize,
    like: &Image,
    tiles: &[(Range<usize>, usize, Image)],
) -> io::Result<Image> {
    // Each row of each tile: its place in the tile and in the band.
    let pieces = || {
        tiles.iter().flat_map(|(rows, x, image)| {
            let common = rows.start.max(range.start)..rows.end.min(range.end);
            let (top, start) = (rows.start, range.start);
            common.map(move |y| (image, (y - top) * image.width(), (y - start) * width + x))
        })
    };
    let mut times = vec![0_u8; width * range.len()];
    for (image, _, to) in pieces() {
        let row = times[to..][..image.width()].iter_mut();
        row.for_each(|times| *times = times.saturating_add(1));
    }
    if times.iter().any(|times| *times != 1) {
        let problem = format!(
            "the tiles of rows {} to {} overlap or leave gaps: the jobs are not those of one plan",
            range.start,
            range.end - 1
        );
        return Err(io::Error::other(problem));
    }
    let mut band = Image::new(width, range.len()).map_err(io::Error::other)?;
    for (name, _) in like.channels() {
        let mut plane = vec![0.0; width * range.len()];
        for (image, from, to) in pieces() {
            let channel = image.require_channel(name).map_err(io::Error::other)?;
            plane[to..][..image.width()].copy_from_slice(&channel[from..][..image.width()]);
        }
        band.add_channel(name, plane).map_err(io::Error::other)?;
    }
    Ok(band)
}
