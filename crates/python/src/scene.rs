//! Scenes.

use crate::interruptible;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::path::PathBuf;
use whitstone::core::stream::{HitStream, LANES, RayStream};
use whitstone::core::{DVec3, Ray, Scratch, SelfHitFilter};
use whitstone::render::{FilmError, Region, RenderOptions};
use whitstone::{Change, Error, SceneOptions};

/// A scene that is built.
#[pyclass(frozen, module = "whitstone._native")]
pub(crate) struct Scene(pub(crate) whitstone::Scene);

/// Radiance, layers and statistics of an image.
type Rendered<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyDict>, Bound<'py, PyDict>);

/// Columns of hits: parameter, shape, primitive, instance, surface parameters.
type Columns<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<f64>>,
);

/// The exception for a scene with errors: `whitstone.SceneError(report, problems)`.
pub(crate) fn scene_error(py: Python<'_>, error: &Error) -> PyErr {
    let problems: Vec<_> = error
        .problems
        .iter()
        .map(|problem| {
            let place = problem.place.as_ref();
            (
                place.map(|place| place.file.clone()),
                place.map(|place| place.line),
                place.map(|place| place.column),
                problem.message.clone(),
                problem.help.clone(),
            )
        })
        .collect();
    let raised = py
        .import("whitstone._errors")
        .and_then(|module| module.getattr("SceneError"))
        .and_then(|class| class.call1((error.to_string(), problems)));
    match raised {
        Ok(exception) => PyErr::from_value(exception),
        Err(exception) => exception,
    }
}

fn options(camera: Option<String>, max_memory: Option<u64>, max_tree_rays: Option<u32>) -> SceneOptions {
    SceneOptions {
        camera,
        max_memory,
        max_tree_rays,
        ..SceneOptions::default()
    }
}

fn changes(texts: &[String]) -> Vec<Change> {
    texts.iter().map(|text| Change::parse(text)).collect()
}

#[pymethods]
impl Scene {
    /// Reads and builds a scene file.
    #[staticmethod]
    #[pyo3(signature = (path, overrides, camera=None, max_memory=None, max_tree_rays=None))]
    fn open(
        py: Python<'_>,
        path: PathBuf,
        overrides: Vec<String>,
        camera: Option<String>,
        max_memory: Option<u64>,
        max_tree_rays: Option<u32>,
    ) -> PyResult<Self> {
        let options = options(camera, max_memory, max_tree_rays);
        let work = |_: &_| whitstone::Scene::open_with(path, &changes(&overrides), options);
        interruptible::run(py, None, work)?
            .map(Self)
            .map_err(|error| scene_error(py, &error))
    }

    /// Builds a scene from TOML text with paths relative to a folder.
    #[staticmethod]
    #[pyo3(signature = (text, base, overrides, max_memory=None, max_tree_rays=None))]
    fn parse(
        py: Python<'_>,
        text: &str,
        base: PathBuf,
        overrides: Vec<String>,
        max_memory: Option<u64>,
        max_tree_rays: Option<u32>,
    ) -> PyResult<Self> {
        let options = options(None, max_memory, max_tree_rays);
        let work = |_: &_| whitstone::Scene::parse_with(text, base, &changes(&overrides), options);
        interruptible::run(py, None, work)?
            .map(Self)
            .map_err(|error| scene_error(py, &error))
    }

    /// The scene with other values of some keys.
    #[pyo3(name = "with_")]
    fn with(&self, py: Python<'_>, overrides: Vec<String>) -> PyResult<Self> {
        let work = |_: &_| self.0.with(&changes(&overrides));
        interruptible::run(py, None, work)?
            .map(Self)
            .map_err(|error| scene_error(py, &error))
    }

    /// Width and height in pixels.
    #[getter]
    pub(crate) fn size(&self) -> (u32, u32) {
        let size = self.0.pipeline().film.size;
        (size.width, size.height)
    }

    /// Files that the scene was read from.
    #[getter]
    fn files(&self) -> Vec<PathBuf> {
        self.0.files().to_vec()
    }

    /// The scene as one TOML document, and the folder that its paths are relative to.
    fn flattened(&self) -> (&str, PathBuf) {
        let flattened = self.0.flattened();
        (&flattened.text, flattened.base.clone())
    }

    /// Messages of the warnings.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        let warnings = self.0.warnings().iter();
        warnings.map(|warning| warning.message.clone()).collect()
    }

    /// Type of the accelerator.
    #[getter]
    fn accelerator(&self) -> &str {
        &self.0.pipeline().accelerator.0
    }

    /// Renders the image: radiance of shape (height, width, 3), layers, and statistics.
    #[pyo3(signature = (threads=0, region=None, progress=None))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        threads: usize,
        region: Option<[u32; 4]>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Rendered<'py>> {
        let region = region.map(|[x, y, width, height]| Region { x, y, width, height });
        let film = interruptible::run(py, progress, |watch| {
            self.0.render_with(RenderOptions {
                threads,
                region,
                progress: Some(&|done, total| watch.report(done, total)),
                ..RenderOptions::default()
            })
        })?;
        film.check().map_err(|error| scene_error(py, &error.into()))?;
        let (width, height) = (film.width as usize, film.height as usize);
        let rgb = film.rgb.into_flattened().into_pyarray(py);
        let layers = PyDict::new(py);
        for (name, values) in film.layers {
            layers.set_item(name, values.into_pyarray(py).reshape([height, width])?)?;
        }
        let statistics = PyDict::new(py);
        statistics.set_item("scene_hash", &self.0.pipeline().scene_hash)?;
        statistics.set_item("samples", film.samples)?;
        statistics.set_item("render_seconds", film.render_seconds)?;
        statistics.set_item("build_seconds", self.0.pipeline().build_seconds)?;
        statistics.set_item("closest_rays", film.counters.closest)?;
        statistics.set_item("shadow_rays", film.counters.shadow)?;
        Ok((rgb.reshape([height, width, 3])?, layers, statistics))
    }

    /// Radiance of one pixel in double precision.
    fn pixel(&self, py: Python<'_>, x: u32, y: u32) -> PyResult<[f64; 3]> {
        let (width, height) = self.size();
        if x >= width || y >= height {
            return Err(PyKeyError::new_err(format!(
                "the pixel ({x}, {y}) is outside of the image of {width} x {height} pixels"
            )));
        }
        let mut scratch = Scratch::within(self.0.pipeline().tree_limits(1));
        let work = |_: &_| self.0.pipeline().pixel([x, y], &mut scratch);
        let value = interruptible::run(py, None, work)?;
        match scratch.too_large {
            None => Ok(value.to_array()),
            Some(tree) => {
                let error = FilmError::TooLarge { pixel: [x, y], tree };
                Err(scene_error(py, &error.into()))
            }
        }
    }

    /// The nearest hits of rays, as columns.
    fn trace<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Columns<'py>> {
        let count = check_shapes(&origins, &directions)?;
        let (origins, directions) = (origins.as_slice()?, directions.as_slice()?);
        // Allocated on this thread: memory of a thread that ends is returned to the system, and a
        // third of the time of the next call is spent on getting it again.
        let mut hits = Hits::zeros(count);
        interruptible::run(py, None, |_| self.fill(origins, directions, &mut hits))?.map_err(invalid_ray)?;
        let Hits {
            t,
            shape,
            primitive,
            instance,
            uv,
        } = hits;
        Ok((
            t.into_pyarray(py),
            shape.into_pyarray(py),
            primitive.into_pyarray(py),
            instance.into_pyarray(py),
            uv.into_pyarray(py).reshape([count, 2])?,
        ))
    }
}

/// The number of rays, if the arrays have the shape (n, 3).
fn check_shapes(
    origins: &PyReadonlyArray2<'_, f64>,
    directions: &PyReadonlyArray2<'_, f64>,
) -> PyResult<usize> {
    let count = origins.shape()[0];
    if origins.shape() == [count, 3] && directions.shape() == [count, 3] {
        return Ok(count);
    }
    Err(PyValueError::new_err(format!(
        "expected origins and directions of shape (n, 3), found {:?} and {:?}",
        origins.shape(),
        directions.shape()
    )))
}

/// The ray with a direction of unit length, if its numbers allow it.
fn unit_ray(origin: &[f64], direction: &[f64]) -> Option<Ray> {
    let (origin, unit) = (
        DVec3::from_slice(origin),
        DVec3::from_slice(direction).normalize(),
    );
    (origin.is_finite() && unit.is_finite()).then(|| Ray::new(origin, unit))
}

fn invalid_ray(number: usize) -> PyErr {
    PyValueError::new_err(format!(
        "ray {number}: the origin and the direction must be finite, and the direction not zero"
    ))
}

/// All rays, with directions of unit length.
pub(crate) fn rays(
    origins: &PyReadonlyArray2<'_, f64>,
    directions: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<Ray>> {
    check_shapes(origins, directions)?;
    let pairs = origins
        .as_slice()?
        .chunks_exact(3)
        .zip(directions.as_slice()?.chunks_exact(3));
    pairs
        .enumerate()
        .map(|(number, (origin, direction))| unit_ray(origin, direction).ok_or_else(|| invalid_ray(number)))
        .collect()
}

/// Hits as columns. A miss has an infinite parameter and the shape -1.
struct Hits {
    t: Vec<f64>,
    shape: Vec<i32>,
    primitive: Vec<u32>,
    instance: Vec<u32>,
    uv: Vec<f64>,
}

impl Hits {
    /// Room for this many hits.
    fn zeros(count: usize) -> Self {
        Self {
            t: vec![0.0; count],
            shape: vec![0; count],
            primitive: vec![0; count],
            instance: vec![0; count],
            uv: vec![0.0; 2 * count],
        }
    }
}

impl Scene {
    /// Finds the hits of all rays; the error is the number of the first invalid ray.
    fn fill(&self, origins: &[f64], directions: &[f64], hits: &mut Hits) -> Result<(), usize> {
        let accelerator = &self.0.pipeline().scene.accelerator;
        let inputs = origins
            .par_chunks(3 * LANES)
            .zip(directions.par_chunks(3 * LANES))
            .enumerate();
        let outputs = hits
            .t
            .par_chunks_mut(LANES)
            .zip(hits.shape.par_chunks_mut(LANES))
            .zip(hits.primitive.par_chunks_mut(LANES))
            .zip(hits.instance.par_chunks_mut(LANES))
            .zip(hits.uv.par_chunks_mut(2 * LANES));
        let memory = <(Box<RayStream>, Box<HitStream>)>::default;
        let bad = inputs
            .zip(outputs)
            .map_init(memory, |(rays, found), (input, output)| {
                let (chunk, (origins, directions)) = input;
                let ((((t, shape), primitive), instance), uv) = output;
                rays.len = t.len();
                let pairs = origins.chunks_exact(3).zip(directions.chunks_exact(3));
                for (lane, (origin, direction)) in pairs.enumerate() {
                    let Some(ray) = unit_ray(origin, direction) else {
                        return Some(chunk * LANES + lane);
                    };
                    rays.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
                }
                accelerator.intersect_stream(rays, found);
                for lane in 0..t.len() {
                    (t[lane], shape[lane]) = (f64::INFINITY, -1);
                    if let Some(hit) = found.get(lane) {
                        t[lane] = hit.t;
                        shape[lane] = i32::try_from(hit.shape).unwrap_or(i32::MAX);
                        primitive[lane] = hit.primitive;
                        instance[lane] = hit.instance.0;
                        uv[2 * lane..2 * lane + 2].copy_from_slice(&hit.prim_uv.to_array());
                    }
                }
                None
            });
        match bad.flatten().min() {
            Some(ray) => Err(ray),
            None => Ok(()),
        }
    }
}
