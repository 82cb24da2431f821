use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::io::Write;
use std::path::Path;
use whitstone_core::Ray;
use whitstone_validate::environment::Environment;

/// Bytes of a number in single precision.
const NUMBER: usize = 4;

/// A Python with Mitsuba in it.
pub struct Mitsuba {
    /// The module of the driver that meets rays with shapes.
    rays: Py<PyModule>,
}

impl Mitsuba {
    /// Starts Python, with the packages of the environment and the driver.
    ///
    /// # Errors
    ///
    /// If the environment is of another Python than this program; what Python says if the driver or
    /// Mitsuba cannot be imported.
    pub fn start(environment: &Environment) -> Result<Self, String> {
        Python::initialize();
        Python::attach(|python| {
            let version = python.version_info();
            let linked = format!("python{}.{}", version.major, version.minor);
            let packages = environment.folder().join(format!("lib/{linked}/site-packages"));
            if !packages.is_dir() {
                return Err(format!(
                    "this program is linked with {linked}, which {} was not made by; let PYO3_PYTHON and WHITSTONE_PYTHON name the same Python",
                    environment.folder().display()
                ));
            }
            let import = || -> PyResult<_> {
                python.import("site")?.call_method1("addsitedir", (packages,))?;
                let path = python.import("sys")?.getattr("path")?;
                // Python looks for packages in texts only, not in paths.
                path.call_method1("insert", (0, environment.package.as_os_str()))?;
                python.import("whitstone_mitsuba.rays")
            };
            let rays = import().map_err(|error| error.to_string())?;
            Ok(Self { rays: rays.unbind() })
        })
    }

    /// Ends the process with this code, and at once: the libraries of Mitsuba ask Python for its
    /// state when they are unloaded, and then there is none.
    pub fn exit(&self, code: u8) -> ! {
        let _ = std::io::stdout().flush();
        Python::attach(|python| {
            let os = python.import("os");
            let _ = os.and_then(|os| os.call_method1("_exit", (code,)));
        });
        std::process::abort()
    }

    /// The nearest hit of every ray, in single precision, with the shapes of a scene; `None` where
    /// the driver has no twin of one of them.
    ///
    /// # Errors
    ///
    /// What else is wrong, as the driver says it.
    pub fn intersect(
        &self,
        scene: &str,
        folder: &Path,
        rays: &[Ray],
    ) -> Result<Option<Vec<Option<f64>>>, String> {
        let numbers = rays
            .iter()
            .flat_map(|ray| [ray.origin, ray.direction])
            .flat_map(|v| v.as_vec3().to_array());
        let bytes: Vec<u8> = numbers.flat_map(f32::to_ne_bytes).collect();
        Python::attach(|python| {
            let ask = || -> PyResult<Vec<Option<f64>>> {
                let module = self.rays.bind(python);
                let found = module.call_method1("closest", (scene, folder, PyBytes::new(python, &bytes)))?;
                let found: Vec<u8> = found.extract()?;
                let distances = found
                    .as_chunks::<NUMBER>()
                    .0
                    .iter()
                    .map(|bytes| f32::from_ne_bytes(*bytes));
                Ok(distances.map(|t| t.is_finite().then_some(f64::from(t))).collect())
            };
            ask().map(Some).or_else(|error| {
                let kind = error.value(python).getattr("kind");
                let kind = kind.and_then(|kind| kind.extract::<String>());
                match kind {
                    Ok(kind) if kind == "unsupported" => Ok(None),
                    _ if error.is_instance_of::<PyException>(python) => Err(error.to_string()),
                    _ => Err(format!("Python was stopped: {error}")),
                }
            })
        })
    }
}
