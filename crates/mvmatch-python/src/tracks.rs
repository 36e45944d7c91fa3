//! Door to `motion-tracks`: NumPy columns in, NumPy columns out.

use motion_tracks::{
    Carry, Cosine, ErrorModel, Field, FieldError, Fill, FitOptions, Follow, LinkOptions, Linked,
    Linker, Tracks,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

fn refuse(error: FieldError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Rows of a C-contiguous (N, K) array.
fn rows<'a, T: numpy::Element, const K: usize>(
    array: &'a PyReadonlyArray2<'_, T>,
    name: &str,
) -> PyResult<&'a [[T; K]]> {
    let flat = array.as_slice()?;
    let (rows, rest) = flat.as_chunks::<K>();
    if !rest.is_empty() || array.as_array().ncols() != K {
        return Err(PyValueError::new_err(format!(
            "{name} must have the shape (N, {K})"
        )));
    }
    Ok(rows)
}

/// Arrays of one motion field, held while Rust looks at them.
#[derive(FromPyObject)]
pub struct Columns<'py> {
    frame: i32,
    width: u32,
    height: u32,
    block: PyReadonlyArray2<'py, i32>,
    mv: PyReadonlyArray2<'py, f32>,
    ref_frame: PyReadonlyArray1<'py, i32>,
    residual: PyReadonlyArray1<'py, f32>,
}

impl Columns<'_> {
    fn field(&self) -> PyResult<Field<'_>> {
        Ok(Field {
            frame: self.frame,
            width: self.width,
            height: self.height,
            blocks: rows(&self.block, "block")?,
            vectors: rows(&self.mv, "mv")?,
            references: self.ref_frame.as_slice()?,
            energies: self.residual.as_slice()?,
        })
    }
}

fn carry_named(name: &str) -> PyResult<Carry> {
    match name {
        "translate" => Ok(Carry::Translate),
        "fuse" => Ok(Carry::Fuse),
        _ => Err(PyValueError::new_err(format!(
            "carry is {name:?}; it can be translate or fuse"
        ))),
    }
}

fn follow_named(name: &str) -> PyResult<Follow> {
    match name {
        "nearest" => Ok(Follow::Nearest),
        "all" => Ok(Follow::All),
        _ => Err(PyValueError::new_err(format!(
            "follow is {name:?}; it can be nearest or all"
        ))),
    }
}

type TrackArrays<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i32>>,
    Bound<'py, PyArray2<f32>>,
);

type LinkedArrays<'py> = (TrackArrays<'py>, TrackArrays<'py>);

/// (N, K) array of rows.
fn to_array<const K: usize>(
    py: Python<'_>,
    rows: Vec<[f32; K]>,
) -> PyResult<Bound<'_, PyArray2<f32>>> {
    let len = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([len, K])
}

/// Collects motion fields in decode order, then chains them.
#[pyclass]
pub struct TrackLinker {
    linker: Option<Linker>,
}

#[pymethods]
impl TrackLinker {
    #[new]
    #[pyo3(signature = (
        *, keep_zero, error_weights, max_error, max_drift, num_neighbors, carry, follow, epsilon, tau, cell, extend,
        min_length, fill, window
    ))]
    #[expect(
        clippy::too_many_arguments,
        reason = "keyword-only options, named in Python"
    )]
    fn new(
        keep_zero: bool,
        error_weights: Option<[f64; 6]>,
        max_error: Option<f32>,
        max_drift: Option<f32>,
        num_neighbors: usize,
        carry: &str,
        follow: &str,
        epsilon: Option<f32>,
        tau: f32,
        cell: Option<u32>,
        extend: bool,
        min_length: u32,
        fill: Option<(u32, Option<f32>, Option<f32>)>,
        window: Option<u32>,
    ) -> PyResult<Self> {
        let options = LinkOptions {
            keep_zero,
            error_model: error_weights.map(|weights| ErrorModel { weights }),
            max_error,
            max_drift,
            fit: FitOptions {
                neighbors: num_neighbors,
                ..FitOptions::default()
            },
            carry: carry_named(carry)?,
            follow: follow_named(follow)?,
            cosine: epsilon.map(|epsilon| Cosine { epsilon, tau }),
            cell,
            extend,
            min_length,
            fill: fill.map(|(side, max_error, max_drift)| Fill {
                side,
                max_error,
                max_drift,
            }),
            window,
        };
        Ok(Self {
            linker: Some(Linker::new(options)),
        })
    }

    /// Adds the next motion field in decode order.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "arguments from Python are extracted values"
    )]
    fn push(&mut self, py: Python<'_>, columns: Columns<'_>) -> PyResult<()> {
        let field = columns.field()?;
        let linker = self.linker.as_mut().ok_or_else(finished)?;
        py.detach(|| linker.push(&field)).map_err(refuse)
    }

    /// Tracks that have ended since the last time, and further ones likewise; each are offsets (T + 1,),
    /// frame (O,) and xy (O, 2).
    fn take<'py>(&mut self, py: Python<'py>) -> PyResult<LinkedArrays<'py>> {
        let linker = self.linker.as_mut().ok_or_else(finished)?;
        linked_arrays(py, linker.take())
    }

    /// Chains the rest: all tracks that were not taken, and further ones likewise.
    fn finish<'py>(&mut self, py: Python<'py>) -> PyResult<LinkedArrays<'py>> {
        let linker = self.linker.take().ok_or_else(finished)?;
        linked_arrays(py, py.detach(|| linker.finish()))
    }
}

fn linked_arrays(py: Python<'_>, linked: Linked) -> PyResult<LinkedArrays<'_>> {
    Ok((
        track_arrays(py, linked.tracks)?,
        track_arrays(py, linked.further)?,
    ))
}

fn track_arrays(py: Python<'_>, tracks: Tracks) -> PyResult<TrackArrays<'_>> {
    Ok((
        tracks.offsets.into_pyarray(py),
        tracks.frames.into_pyarray(py),
        to_array(py, tracks.points)?,
    ))
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("the tracks of this linker are finished; start a new one")
}

type FitArrays<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
);

/// Local fit per row: residual (N,), spread (N,), vector (N, 2), linear (N, 4).
#[pyfunction]
#[pyo3(signature = (columns, *, num_neighbors = 12))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "arguments from Python are extracted values"
)]
pub fn fit_neighbors<'py>(
    py: Python<'py>,
    columns: Columns<'py>,
    num_neighbors: usize,
) -> PyResult<FitArrays<'py>> {
    let field = columns.field()?;
    field.validate().map_err(refuse)?;
    let options = FitOptions {
        neighbors: num_neighbors,
        ..FitOptions::default()
    };
    let fits = py.detach(|| motion_tracks::fit_neighbors(&field, &options));
    let residual: Vec<f32> = fits.iter().map(|fit| fit.residual).collect();
    let spread: Vec<f32> = fits.iter().map(|fit| fit.spread).collect();
    Ok((
        residual.into_pyarray(py),
        spread.into_pyarray(py),
        to_array(py, fits.iter().map(|fit| fit.vector).collect())?,
        to_array(py, fits.iter().map(|fit| fit.linear).collect())?,
    ))
}

/// Median error of every row (N,), px.
#[pyfunction]
#[pyo3(signature = (columns, *, weights, num_neighbors = 12))]
#[expect(
    clippy::needless_pass_by_value,
    reason = "arguments from Python are extracted values"
)]
pub fn vector_errors<'py>(
    py: Python<'py>,
    columns: Columns<'py>,
    weights: [f64; 6],
    num_neighbors: usize,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let field = columns.field()?;
    field.validate().map_err(refuse)?;
    let options = FitOptions {
        neighbors: num_neighbors,
        ..FitOptions::default()
    };
    let model = ErrorModel { weights };
    let errors = py.detach(|| motion_tracks::vector_errors(&field, &options, &model));
    Ok(errors.into_pyarray(py))
}
