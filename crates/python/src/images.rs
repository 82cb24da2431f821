//! Images: files, pictures, comparison.

use numpy::{
    IntoPyArray, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use whitstone::image::planes::RGB;
use whitstone::image::{Image, Limits, Raster, ToneMap, exr_io};
use whitstone::metrics::error_map::error_map;
use whitstone::metrics::{CompareOptions, ErrorView, Tolerance, flip, metrics, ssim};

fn value_error(error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// An image from radiance of shape (height, width, 3) and layers of shape (height, width).
fn image(
    rgb: &PyReadonlyArray3<'_, f32>,
    layers: BTreeMap<String, PyReadonlyArray2<'_, f32>>,
) -> PyResult<Image> {
    let &[height, width, channels] = rgb.shape() else {
        unreachable!("the array has three dimensions");
    };
    if channels != RGB.len() {
        return Err(PyValueError::new_err(format!(
            "expected an array of shape (height, width, 3), found {:?}",
            rgb.shape()
        )));
    }
    let mut image = Image::new(width, height).map_err(value_error)?;
    let values = rgb.as_slice()?;
    for (channel, name) in RGB.into_iter().enumerate() {
        let plane = values.iter().skip(channel).step_by(RGB.len()).copied().collect();
        image.add_channel(name, plane).map_err(value_error)?;
    }
    for (name, values) in layers {
        if values.shape() != [height, width] {
            return Err(PyValueError::new_err(format!(
                "expected the layer {name} of shape ({height}, {width}), found {:?}",
                values.shape()
            )));
        }
        let values = values.as_slice()?.to_vec();
        image.add_channel(name, values).map_err(value_error)?;
    }
    Ok(image)
}

/// Writes an OpenEXR file.
#[pyfunction]
pub(crate) fn write_image(
    py: Python<'_>,
    path: PathBuf,
    rgb: PyReadonlyArray3<'_, f32>,
    layers: BTreeMap<String, PyReadonlyArray2<'_, f32>>,
    attributes: BTreeMap<String, String>,
) -> PyResult<()> {
    let mut image = image(&rgb, layers)?;
    for (name, value) in attributes {
        image.set_attribute(name, value).map_err(value_error)?;
    }
    py.detach(|| exr_io::write(path, &image))
        .map_err(|error| PyOSError::new_err(error.to_string()))
}

/// Reads an OpenEXR file: radiance and layers.
#[pyfunction]
pub(crate) fn read_image<'py>(
    py: Python<'py>,
    path: PathBuf,
) -> PyResult<(Bound<'py, PyArray3<f32>>, Bound<'py, PyDict>)> {
    let mut image = py
        .detach(|| exr_io::read(path, Limits::IMAGE))
        .map_err(|error| PyOSError::new_err(error.to_string()))?;
    let (width, height) = (image.width(), image.height());
    let [r, g, b] = image.rgb().map_err(value_error)?;
    let rgb: Vec<f32> = (0..r.len()).flat_map(|k| [r[k], g[k], b[k]]).collect();
    let layers = PyDict::new(py);
    let names: Vec<String> = image.channels().map(|(name, _)| name.to_owned()).collect();
    for name in names {
        if RGB.contains(&name.as_str()) {
            continue;
        }
        if let Some(values) = image.remove_channel(&name) {
            layers.set_item(name, values.into_pyarray(py).reshape([height, width])?)?;
        }
    }
    Ok((rgb.into_pyarray(py).reshape([height, width, 3])?, layers))
}

/// A PNG file of radiance: sRGB, clamped, after an exposure in stops.
#[pyfunction]
pub(crate) fn png(py: Python<'_>, rgb: PyReadonlyArray3<'_, f32>, exposure: f64) -> PyResult<Vec<u8>> {
    let image = image(&rgb, BTreeMap::new())?;
    py.detach(|| {
        let tone = ToneMap {
            exposure,
            ..ToneMap::default()
        };
        let raster = Raster::preview(&image, tone).map_err(value_error)?;
        raster.to_png().map_err(value_error)
    })
}

/// A PNG file of the error between two images.
#[pyfunction]
pub(crate) fn difference_png(
    py: Python<'_>,
    ours: PyReadonlyArray3<'_, f32>,
    reference: PyReadonlyArray3<'_, f32>,
) -> PyResult<Vec<u8>> {
    let (ours, reference) = (
        image(&ours, BTreeMap::new())?,
        image(&reference, BTreeMap::new())?,
    );
    py.detach(|| {
        let map = error_map(&ours, &reference, ErrorView::default()).map_err(value_error)?;
        map.to_png().map_err(value_error)
    })
}

/// The metrics of two images as JSON, with FLIP and SSIM if they are wanted.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    ours: PyReadonlyArray3<'_, f32>,
    reference: PyReadonlyArray3<'_, f32>,
    relative: f64,
    absolute: f64,
    perceptual: bool,
) -> PyResult<String> {
    let (ours, reference) = (
        image(&ours, BTreeMap::new())?,
        image(&reference, BTreeMap::new())?,
    );
    py.detach(|| {
        let tolerance = Tolerance { relative, absolute };
        let options = CompareOptions {
            tolerance,
            ..CompareOptions::default()
        };
        let measured = metrics::compare(&ours, &reference, &options).map_err(value_error)?;
        let mut found = serde_json::to_value(measured).map_err(value_error)?;
        let worst = metrics::worst(&ours, &reference, 5, None).map_err(value_error)?;
        found["worst"] = serde_json::to_value(worst).map_err(value_error)?;
        if perceptual {
            let flip = flip(&ours, &reference).map_err(value_error)?;
            let ssim = ssim(&ours, &reference, ToneMap::default()).map_err(value_error)?;
            found["flip"] = flip.mean.into();
            found["ssim"] = ssim.into();
        }
        Ok(found.to_string())
    })
}
