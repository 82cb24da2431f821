//! Prints the rays of one pixel, alone or next to those of a live reference: part of `explain`.

use super::names::Names;
use super::{Drivers, SceneArguments};
use crate::terminal::Failure;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use std::time::Duration;
use whitstone_core::{InstanceId, Registry, Rgb, Scratch, TreeNode};
use whitstone_render::{FilmError, Pipeline};
use whitstone_validate::driver::SceneText;
use whitstone_validate::environment::Environment;
use whitstone_validate::tree::{self, Node, Pair};
use whitstone_validate::{Live, Renderer, counted, decode_textures, flatten};

/// Time limit for one answer of the driver.
const TIME_LIMIT: Duration = Duration::from_secs(300);
/// Width of the column with our rays.
const COLUMN: usize = 48;

/// Selects the pixel.
#[derive(Args, Clone, Debug)]
pub(super) struct PixelArguments {
    /// Print the ray tree of this pixel, next to Mitsuba's up to the first difference; X is the
    /// column from the left and Y the row from the top, both from 0
    #[arg(long, value_name = "X,Y", value_parser = parse)]
    pixel: Option<[usize; 2]>,
    /// Sample of the pixel, from 0
    #[arg(long, value_name = "N", default_value_t = 0, requires = "pixel")]
    sample: u32,
    /// Maximum number of rays of the tree to print
    #[arg(long, value_name = "N", default_value_t = 200, requires = "pixel")]
    max_rays: usize,
    /// Whether to trace the pixel with Mitsuba too
    #[arg(long, value_enum, default_value_t = LiveReference::Auto, requires = "pixel")]
    reference: LiveReference,
    #[command(flatten)]
    drivers: Drivers,
}

/// Whether the reference takes part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LiveReference {
    /// If its environment already exists
    Auto,
    /// Create its environment if needed; exit code 3 if it cannot answer
    Live,
    /// Print only our rays
    None,
}

fn parse(text: &str) -> Result<[usize; 2], String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "expected column,row, for example 10,20".to_owned())
}

/// The rays of one pixel.
pub(super) struct PixelTree {
    pixel: [usize; 2],
    sample: u32,
    value: Rgb,
    nodes: Vec<TreeNode>,
    most: usize,
    /// The rays of the reference, or why there are none.
    theirs: Result<Theirs, String>,
}

/// The reference's side.
struct Theirs {
    name: String,
    nodes: Vec<Node>,
}

impl PixelArguments {
    /// Traces the rays of the pixel, if one is selected.
    pub(super) fn trace(
        &self,
        pipeline: &Pipeline,
        scene: &SceneArguments,
        registry: &Registry,
    ) -> Result<Option<PixelTree>, Failure> {
        let Some(pixel) = self.pixel else {
            return Ok(None);
        };
        let size = pipeline.film.size;
        let [width, height] = [size.width as usize, size.height as usize];
        if pixel[0] >= width || pixel[1] >= height {
            let [x, y] = pixel;
            return Err(Failure::usage(format!(
                "pixel {x},{y} is outside the image of {width} x {height} pixels; columns and rows start at 0"
            )));
        }
        let (count, sample) = (pipeline.samples(), self.sample);
        if sample >= count {
            return Err(Failure::usage(format!(
                "sample {sample} does not exist: a pixel has {count} samples, numbered from 0"
            )));
        }
        let theirs = self.theirs(scene, registry, pixel);
        if let (Err(problem), LiveReference::Live) = (&theirs, self.reference) {
            return Err(Failure::environment(problem));
        }
        let at = pixel.map(|p| p as u32);
        let mut scratch = Scratch::within(pipeline.tree_limits(1));
        let value = pipeline.pixel(at, &mut scratch);
        if let Some(tree) = scratch.too_large {
            return Err(Failure::usage(FilmError::TooLarge { pixel: at, tree }));
        }
        Ok(Some(PixelTree {
            pixel,
            sample,
            value,
            nodes: tree::ours(pipeline, pixel, sample),
            most: self.max_rays,
            theirs,
        }))
    }

    fn theirs(
        &self,
        scene: &SceneArguments,
        registry: &Registry,
        pixel: [usize; 2],
    ) -> Result<Theirs, String> {
        let installation = self.drivers.installation(&scene.target);
        let target = scene.target.folder();
        let environment = match self.reference {
            LiveReference::None => return Err("--reference none is set".to_owned()),
            LiveReference::Live => Environment::ensure(&installation, &|text| eprintln!("{text}"))
                .map_err(|error| error.to_string())?,
            LiveReference::Auto => Environment::existing(&installation)
                .ok_or("the Python environment of Mitsuba does not exist; create it with --reference live")?,
        };
        let environment = environment
            .with_twins(registry, target)
            .map_err(|error| error.to_string())?;
        let cache = target.join("live");
        let mut live = Live::start(Renderer::MITSUBA, environment, cache, !scene.fresh, TIME_LIMIT)
            .map_err(|error| error.to_string())?;
        let mut flattened = flatten(&scene.scene, &scene.overrides, registry)?;
        decode_textures(&mut flattened, &target.join("decoded"))?;
        let text = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        let nodes = live
            .tree(text, pixel, self.sample)
            .map_err(|error| error.to_string())?;
        Ok(Theirs {
            name: live.renderer().to_string(),
            nodes,
        })
    }
}

impl PixelTree {
    /// Prints the tree for people.
    pub(super) fn print(&self, pipeline: &Pipeline, names: &Names) {
        let [x, y] = self.pixel;
        println!("pixel ({x}, {y}): {}", colour(self.value));
        match &self.theirs {
            Ok(theirs) => self.print_side_by_side(theirs, names),
            Err(why) => {
                println!(
                    "rays of sample {} (R: reflected, numbered if there are several directions; T: transmitted):",
                    self.sample
                );
                for node in in_order(&self.nodes).into_iter().take(self.most) {
                    print_node(pipeline, node, names);
                }
                self.print_rest(self.nodes.len());
                println!("Mitsuba's rays are not shown: {why}");
            }
        }
    }

    fn print_rest(&self, all: usize) {
        if all > self.most {
            println!(
                "... and {} more; increase --max-rays to print them",
                all - self.most
            );
        }
    }

    /// Prints both trees up to the first ray in which they differ; later rays cannot agree.
    fn print_side_by_side(&self, theirs: &Theirs, names: &Names) {
        let pairs = tree::pairs(&self.nodes, &theirs.nodes);
        let first_difference = pairs.iter().position(|pair| pair.difference.is_some());
        let shown = first_difference.map_or(pairs.len(), |place| place + 1);
        println!(
            "rays of sample {} by depth (R: reflected, numbered if there are several directions; T: transmitted), numbers in single precision:",
            self.sample
        );
        println!("{:13}{:COLUMN$}  {}", "", "ours", theirs.name);
        // The ray that differs is always printed.
        let hidden = shown.saturating_sub(self.most);
        for pair in pairs[..shown].iter().take(self.most.saturating_sub(1)) {
            print_pair(pair, names);
        }
        if hidden > 0 {
            println!("... {hidden} more that agree; increase --max-rays to print them");
        }
        if let Some(last) = pairs[..shown].last().filter(|_| shown >= self.most.max(1)) {
            print_pair(last, names);
        }
        match first_difference.map(|place| &pairs[place]) {
            None => println!("the ray trees agree: {}", counted(pairs.len(), "ray")),
            Some(pair) => {
                let difference = pair.difference.as_deref().unwrap_or_default();
                println!("the ray trees first differ at {}: {difference}", pair.name());
                let behind = pairs.len() - shown;
                if behind > 0 {
                    println!("{behind} more rays are not shown; --json writes all");
                }
            }
        }
    }

    /// The tree as JSON.
    pub(super) fn report(&self) -> Value {
        let node = |node: &&TreeNode| {
            json!({
                "path": node.path,
                "shape": node.shape,
                "primitive": node.primitive,
                "instance": node.instance,
                // Null for a miss: JSON has no infinity.
                "t": node.t,
                "position": node.position.to_array(),
                "n_s": node.n_s.to_array(),
                "throughput": node.throughput.to_array(),
                "local": node.local.to_array(),
                "limit": node.limit,
            })
        };
        let reference = self.theirs.as_ref().ok().map(|theirs| {
            json!({
                "name": theirs.name,
                "rays": theirs.nodes,
                "first_difference": tree::first_difference(&self.nodes, &theirs.nodes),
            })
        });
        json!({
            "x": self.pixel[0],
            "y": self.pixel[1],
            "sample": self.sample,
            "value": self.value.to_array(),
            "rays": in_order(&self.nodes).iter().map(node).collect::<Vec<_>>(),
            "reference": reference,
        })
    }
}

/// Parents before their children, reflections before transmissions.
fn in_order(nodes: &[TreeNode]) -> Vec<&TreeNode> {
    let mut sorted: Vec<&TreeNode> = nodes.iter().collect();
    sorted.sort_by(|a, b| a.path.cmp(&b.path));
    sorted
}

/// Prints one ray of both renderers, with one line for each compared quantity.
fn print_pair(pair: &Pair<'_>, names: &Names) {
    println!("{}", pair.name());
    let hit = |shape: i64, primitive: i64, limit: bool| match (limit, shape < 0) {
        (true, _) => "at the depth limit".to_owned(),
        (false, true) => "nothing".to_owned(),
        (false, false) => format!("shape {shape} ({}), primitive {primitive}", names.shape(shape)),
    };
    let mine = pair.ours.map(|node| {
        [
            hit(node.shape, node.primitive, node.limit),
            single(node.t),
            vector(node.n_s.to_array()),
            vector(node.throughput.to_array()),
            vector(node.local.to_array()),
        ]
    });
    let other = pair.theirs.map(|node| {
        [
            hit(node.shape, node.primitive, node.limit),
            single(node.t),
            vector(node.n_s),
            vector(node.throughput),
            vector(node.local),
        ]
    });
    let is_hit =
        pair.ours.is_some_and(|node| node.shape >= 0) || pair.theirs.is_some_and(|node| node.shape >= 0);
    for (line, name) in ["hits", "distance", "normal", "throughput", "local"]
        .into_iter()
        .enumerate()
    {
        // A miss has neither.
        if !is_hit && (name == "distance" || name == "normal") {
            continue;
        }
        let of =
            |lines: &Option<[String; 5]>| lines.as_ref().map_or_else(|| "-".to_owned(), |l| l[line].clone());
        println!("  {name:<11}{:COLUMN$}  {}", of(&mine), of(&other));
    }
}

/// A number with the digits of single precision.
fn single(value: f64) -> String {
    format!("{:?}", value as f32)
}

fn vector(values: [f64; 3]) -> String {
    format!("[{}]", values.map(single).join(", "))
}

/// The chain of instances that leads to an object, outermost first.
fn placed_by(pipeline: &Pipeline, instance: u32) -> Vec<u32> {
    pipeline.scene.geometry.placed_by(InstanceId(instance))
}

fn print_node(pipeline: &Pipeline, node: &TreeNode, names: &Names) {
    // Deeper indentation would only fill the lines.
    let depth = tree::depth(&node.path);
    let indent = "  ".repeat(1 + depth.min(20));
    let name = match depth {
        0 => "camera ray".to_owned(),
        1..=20 => node.path.clone(),
        depth => {
            let last = node.path.rfind(char::is_alphabetic).unwrap_or_default();
            format!("depth {depth} {}", &node.path[last..])
        }
    };
    if node.shape < 0 {
        let what = if node.limit {
            "beyond the depth limit"
        } else {
            "nothing"
        };
        println!(
            "{indent}{name}: {what}, throughput {}, background {}",
            colour(node.throughput),
            colour(node.local)
        );
        return;
    }
    let instances = placed_by(pipeline, node.instance).into_iter().map(|place| {
        let place = i64::from(place);
        format!(" in shape {place} ({})", names.shape(place))
    });
    let instances: String = instances.rev().collect();
    println!(
        "{indent}{name}: shape {} ({}){instances}, primitive {}, t {}, normal {:?}, throughput {}, local {}",
        node.shape,
        names.shape(node.shape),
        node.primitive,
        node.t,
        node.n_s.to_array(),
        colour(node.throughput),
        colour(node.local)
    );
}

fn colour(value: Rgb) -> String {
    let [r, g, b] = value.to_array();
    if r == g && g == b {
        format!("{r}")
    } else {
        format!("[{r}, {g}, {b}]")
    }
}
