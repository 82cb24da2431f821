//! The native half of the Python package `whitstone`. Its public half is in `python/whitstone`.

#[cfg(feature = "module")]
mod images;
#[cfg(feature = "module")]
mod interruptible;
#[cfg(feature = "module")]
mod oracle;
#[cfg(feature = "module")]
mod scene;

/// The module.
#[cfg(feature = "module")]
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use super::images::{compare, difference_png, png, read_image, write_image};
    #[pymodule_export]
    use super::oracle::Oracle;
    #[pymodule_export]
    use super::scene::Scene;

    use pyo3::prelude::*;
    use std::ffi::OsString;
    use std::path::PathBuf;

    /// Runs the command line, and returns its exit code.
    #[pyfunction]
    fn main(py: Python<'_>, arguments: Vec<OsString>) -> PyResult<u8> {
        let module = py.import("whitstone._native")?;
        let library: PathBuf = module.getattr("__file__")?.extract()?;
        let python: PathBuf = py.import("sys")?.getattr("executable")?.extract()?;
        let program = whitstone::Cli::new("whitstone").in_python(library, python);
        Ok(py.detach(|| program.run_with(arguments)))
    }

    /// The folder of the references' drivers, which is written on first use.
    #[pyfunction]
    fn drivers() -> PyResult<PathBuf> {
        let installation = whitstone::validate::Installation::default();
        installation
            .drivers()
            .map_err(|error| pyo3::exceptions::PyOSError::new_err(error.to_string()))
    }

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
