//! The probe scenes, as texts, and their images: by the model under a hypothesis, and by the
//! subject.

use super::image::{Filter, Guess, SIZE, SUPER, Samples};
use crate::stop::Stop;
use crate::subject::render::{Job, SubjectError, render};
use crate::subject::{Subject, shifted};
use crate::validator::flatten_sources;
use std::fmt::Write as _;
use std::path::Path;
use whitstone_core::Registry;
use whitstone_image::{Image, Raster, atomic};
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::Sources;

/// What an angle of view can mean.
pub(super) struct View {
    /// What the subject does.
    pub(super) sentence: &'static str,
    /// Half the width and half the height of the window at distance 1, by the angle in radians and
    /// the width over the height.
    window: fn(f64, f64) -> [f64; 2],
}

/// The meanings that are tried; the first one is the model's.
pub(super) const VIEWS: [View; 6] = [
    View {
        sentence: "the field of view is along x",
        window: |angle, aspect| [half(angle), half(angle) / aspect],
    },
    View {
        sentence: "the field of view is along y instead of x",
        window: |angle, aspect| [half(angle) * aspect, half(angle)],
    },
    View {
        sentence: "the field of view is along the diagonal instead of x",
        window: |angle, aspect| {
            let diagonal = aspect.hypot(1.0);
            [half(angle) * aspect / diagonal, half(angle) / diagonal]
        },
    },
    View {
        sentence: "the field of view is taken as the angle from the centre to the edge, along x",
        window: |angle, aspect| [angle.tan(), angle.tan() / aspect],
    },
    View {
        sentence: "the field of view is taken as the angle from the centre to the edge, along y",
        window: |angle, aspect| [angle.tan() * aspect, angle.tan()],
    },
    View {
        sentence: "the field of view is along x and along y: pixels are not square",
        window: |angle, _| [half(angle), half(angle)],
    },
];

/// The tangent of half an angle.
fn half(angle: f64) -> f64 {
    (0.5 * angle).tan()
}

/// The camera of a probe.
#[derive(Clone, Copy)]
pub(super) struct Camera {
    pub(super) origin: [f64; 3],
    pub(super) target: [f64; 3],
    pub(super) up: [f64; 3],
    /// In degrees.
    pub(super) fov: f64,
}

impl Camera {
    fn look_at(&self) -> String {
        format!(
            "look_at={{origin={:?},target={:?},up={:?}}}",
            self.origin, self.target, self.up
        )
    }

    /// The change of a scene, as for `--set`, to another meaning of the angle.
    fn seen(&self, view: usize) -> Option<String> {
        let aspect = SIZE[0] as f64 / SIZE[1] as f64;
        let [x, y] = (VIEWS[view].window)(self.fov.to_radians(), aspect);
        (view > 0).then(|| {
            format!(
                "camera={{type=\"perspective\",{},window={{l={:?},r={x:?},b={:?},t={y:?}}}}}",
                self.look_at(),
                -x,
                -y
            )
        })
    }
}

/// A scene that a subject renders.
#[derive(Clone)]
pub(super) struct Probe {
    /// With what it is a probe, in a sentence; the name of its folder.
    pub(super) name: &'static str,
    pub(super) folder: &'static str,
    pub(super) camera: Camera,
    /// Everything else but the film and the lights.
    pub(super) body: String,
    pub(super) lights: String,
    /// A word of the notes of a format that approximates what the probe is about.
    pub(super) exactly: Option<&'static str>,
}

impl Probe {
    fn text(&self, lights: &str) -> String {
        let [width, height] = SIZE;
        format!(
            "film = {{ width = {width}, height = {height} }}\n{}\n{lights}\n[camera]\ntype = \"perspective\"\n{}\nfov = {:?}\n",
            self.body,
            self.camera.look_at(),
            self.camera.fov
        )
    }
}

/// Name and texels of the image of the probe with a texture; columns and rows.
pub(super) const TEXELS: (&str, usize) = ("texels.png", 8);
/// Name of the mesh of a ball.
pub(super) const BALL: &str = "ball.obj";

/// Writes the files that probes name.
pub(super) fn write_files(folder: &Path) -> Result<(), String> {
    let told = |error: &dyn std::fmt::Display| format!("{}: {error}", folder.display());
    std::fs::create_dir_all(folder).map_err(|error| told(&error))?;
    // Without any symmetry; the multiplier is the golden ratio as a fraction of 2^32.
    let code = |x: usize, y: usize, channel: usize| {
        let index = ((y * TEXELS.1 + x) * 3 + channel + 1) as u32;
        40 + (index.wrapping_mul(0x9e37_79b9) >> 24) as u8 % 200
    };
    let raster = Raster::from_fn(TEXELS.1, TEXELS.1, |x, y| {
        [0, 1, 2].map(|channel| code(x, y, channel))
    });
    raster
        .write_png(folder.join(TEXELS.0))
        .map_err(|error| told(&error))?;
    atomic::write_bytes(folder.join(BALL), ball().as_bytes()).map_err(|error| told(&error))
}

/// An icosahedron of radius 1 whose triangles are divided once, as OBJ.
fn ball() -> String {
    let long = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    for axis in 0..3 {
        for [a, b] in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            let mut vertex = [0.0; 3];
            vertex[(axis + 1) % 3] = a;
            vertex[(axis + 2) % 3] = b * long;
            vertices.push(vertex);
        }
    }
    let distance = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>();
    let near = |a: [f64; 3], b: [f64; 3]| (distance(a, b) - 4.0).abs() < 1e-9;
    let unit = |v: [f64; 3]| v.map(|x| x / v.iter().map(|x| x * x).sum::<f64>().sqrt());
    let middle = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
    let mut triangles = Vec::new();
    for (i, &a) in vertices.iter().enumerate() {
        for (j, &b) in vertices.iter().enumerate().skip(i + 1) {
            for &c in vertices.iter().skip(j + 1) {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outside = {
                        let [u, v] = [[0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k])];
                        let normal = [
                            u[1] * v[2] - u[2] * v[1],
                            u[2] * v[0] - u[0] * v[2],
                            u[0] * v[1] - u[1] * v[0],
                        ];
                        (0..3).map(|k| normal[k] * a[k]).sum::<f64>() > 0.0
                    };
                    let [b, c] = if outside { [b, c] } else { [c, b] };
                    let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                    triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
                }
            }
        }
    }
    let mut text = String::new();
    for vertex in triangles.iter().flatten() {
        let [x, y, z] = unit(*vertex);
        let _ = writeln!(text, "v {x} {y} {z}");
    }
    for index in 0..triangles.len() {
        let first = 3 * index + 1;
        let _ = writeln!(text, "f {first} {} {}", first + 1, first + 2);
    }
    text
}

/// What renders probes.
#[derive(Clone, Copy)]
pub(super) struct Lab<'a> {
    pub(super) registry: &'a Registry,
    pub(super) subject: &'a Subject,
    /// The folder of all results.
    pub(super) target: &'a Path,
    /// The folder of the files that probes name.
    pub(super) files: &'a Path,
    pub(super) stage: &'a dyn Fn(&str),
    pub(super) stop: &'a Stop,
}

impl Lab<'_> {
    fn sources(&self, text: &str, changes: &[String]) -> Result<Sources, String> {
        let changes = [&self.subject.set[..], changes].concat();
        Sources::from_text("probe.toml", text, self.files, &changes)
            .map_err(|error| error.sources.report(&error.errors, false))
    }

    /// The subject's image of a probe.
    pub(super) fn subject(&self, probe: &Probe) -> Result<Image, SubjectError> {
        let sources = self.sources(&probe.text(&probe.lights), &[]);
        let scene = sources.and_then(|sources| flatten_sources(&sources));
        let scene = scene.map_err(SubjectError::Environment)?;
        let folder = Path::new("conventions").join(probe.folder);
        let job = Job {
            registry: self.registry,
            target: self.target,
            folder: &folder,
            scene: &scene,
            size: SIZE,
            threads: 0,
            stage: self.stage,
            stop: self.stop,
        };
        let rendered = render(self.subject, &job)?;
        let notes = &rendered.run.approximated;
        let inexact = probe
            .exactly
            .and_then(|word| notes.iter().find(|note| note.contains(word)));
        match inexact {
            Some(note) => Err(SubjectError::NotExpressible(format!(
                "the format only approximates it: {note}"
            ))),
            None => Ok(rendered.image),
        }
    }

    /// The model's image of a text with `factor` times the pixels, shifted by a part of one.
    fn model(
        &self,
        text: &str,
        changes: &[String],
        factor: usize,
        shift: [f64; 2],
    ) -> Result<[Vec<f32>; 3], String> {
        let mut changes = changes.to_vec();
        changes.push(format!("film.width={}", SIZE[0] * factor));
        changes.push(format!("film.height={}", SIZE[1] * factor));
        if shift != [0.0; 2] {
            let flattened = flatten_sources(&self.sources(text, &changes)?)?;
            changes.push(shifted(&flattened.text, shift)?);
        }
        let sources = self.sources(text, &changes)?;
        let pipeline = Pipeline::load(&sources, self.registry, BuildOptions::default())
            .map_err(|errors| sources.report(&errors, false))?;
        let film = pipeline.render(RenderOptions::default());
        Ok(std::array::from_fn(|channel| {
            film.rgb.iter().map(|rgb| rgb[channel]).collect()
        }))
    }

    /// The model's samples of a probe with changes, where a hypothesis needs them: all, or those of
    /// one sample per pixel.
    pub(super) fn samples(
        &self,
        probe: &Probe,
        changes: &[String],
        guess: &Guess,
    ) -> Result<Samples, String> {
        match guess.filter {
            Filter::Point => {
                let part =
                    |axis: usize| self.subject.offset[axis] + f64::from(guess.offset[axis]) / SUPER as f64;
                self.samples_at(probe, changes, guess.view, 1, [part(0), part(1)])
            }
            _ => self.all_samples(probe, changes, guess.view),
        }
    }

    /// The model's samples of a probe with changes, at multiples of 1/[`SUPER`] pixels.
    pub(super) fn all_samples(
        &self,
        probe: &Probe,
        changes: &[String],
        view: usize,
    ) -> Result<Samples, String> {
        // The camera sees the centre of a pixel. A sample is at the top left corner of one.
        let shift = self.subject.offset.map(|part| part * SUPER as f64 - 0.5);
        self.samples_at(probe, changes, view, SUPER, shift)
    }

    fn samples_at(
        &self,
        probe: &Probe,
        changes: &[String],
        view: usize,
        factor: usize,
        shift: [f64; 2],
    ) -> Result<Samples, String> {
        let seen: Vec<String> = probe.camera.seen(view).into_iter().collect();
        let with = |lights: &str, changes: &[String]| {
            let changes = [&seen[..], changes].concat();
            self.model(&probe.text(lights), &changes, factor, shift)
        };
        let color = with(&probe.lights, changes)?;
        // Changes of lights have nothing to change there.
        let others = changes.iter().filter(|change| !change.starts_with("light"));
        let others: Vec<String> = others.cloned().collect();
        let ambient = with("[[light]]\ntype = \"ambient\"\nradiance = 1\n", &others)?;
        let [empty, ..] = with("[[light]]\ntype = \"background\"\nradiance = 1\n", &others)?;
        Ok(Samples {
            factor,
            color,
            ambient,
            empty,
        })
    }
}
