//! The oracle.

use crate::interruptible;
use crate::scene::{Scene, rays, scene_error};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use rayon::prelude::*;
use whitstone::oracle::tracer::{FirstHit, Tracer, Value};

/// The oracle for a scene.
#[pyclass(frozen, module = "whitstone._native")]
pub(crate) struct Oracle {
    tracer: Tracer,
    size: (u32, u32),
}

/// Columns of first hits: whether the oracle is certain, parameter, point, normal.
type Columns<'py> = (
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

#[pymethods]
impl Oracle {
    #[new]
    fn new(py: Python<'_>, scene: &Scene) -> PyResult<Self> {
        let tracer = interruptible::run(py, None, |_| scene.0.oracle())?;
        Ok(Self {
            tracer: tracer.map_err(|error| scene_error(py, &error))?,
            size: scene.size(),
        })
    }

    /// The first hits of rays, as columns. `progress` is called with the number of finished and of
    /// all rays.
    #[pyo3(signature = (origins, directions, progress=None))]
    fn trace<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Columns<'py>> {
        let rays = rays(&origins, &directions)?;
        let done = std::sync::atomic::AtomicU64::new(0);
        let found = interruptible::run(py, progress, |watch| {
            let first = |ray| {
                let one = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                // After Ctrl-C, nobody reads the rest.
                match watch.report(one, rays.len() as u64).is_break() {
                    true => FirstHit::Unknown,
                    false => self.tracer.first_hit(ray),
                }
            };
            rays.par_iter().map(first).collect::<Vec<FirstHit>>()
        })?;
        let mut certain = vec![true; found.len()];
        let mut t = vec![f64::INFINITY; found.len()];
        let mut points = vec![f64::NAN; 3 * found.len()];
        let mut normals = vec![f64::NAN; 3 * found.len()];
        for (k, hit) in found.iter().enumerate() {
            match hit {
                FirstHit::Hit {
                    t: exact,
                    point,
                    normal,
                } => {
                    t[k] = *exact;
                    points[3 * k..3 * k + 3].copy_from_slice(&point.to_array());
                    normals[3 * k..3 * k + 3].copy_from_slice(&normal.to_array());
                }
                FirstHit::Miss => {}
                FirstHit::Unknown => {
                    certain[k] = false;
                    t[k] = f64::NAN;
                }
            }
        }
        let shape = [found.len(), 3];
        Ok((
            certain.into_pyarray(py),
            t.into_pyarray(py),
            points.into_pyarray(py).reshape(shape)?,
            normals.into_pyarray(py).reshape(shape)?,
        ))
    }

    /// The radiance of a pixel, and a bound on its error.
    fn pixel(&self, py: Python<'_>, x: u32, y: u32) -> PyResult<([f64; 3], [f64; 3])> {
        let (width, height) = self.size;
        if x >= width || y >= height {
            return Err(PyKeyError::new_err(format!(
                "the pixel ({x}, {y}) is outside of the image of {width} x {height} pixels"
            )));
        }
        match interruptible::run(py, None, |_| self.tracer.pixel([x, y]))? {
            Value::Known { rgb, uncertainty, .. } => Ok((rgb, uncertainty)),
            Value::Unknown(reason) => Err(PyValueError::new_err(format!(
                "the oracle cannot decide the pixel ({x}, {y}): {reason}"
            ))),
        }
    }
}
