//! Door to `av1-motion`: files and bytes in, NumPy columns out.

use std::fs::File;
use std::path::PathBuf;

use av1_motion::{ContainerReader, Error, Limits, Parser};
use pyo3::exceptions::{PyFileNotFoundError, PyOSError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::coded_frame::CodedFrame;

/// One Python exception for each kind of error, with its place as attributes.
fn raise(py: Python<'_>, error: Error) -> PyErr {
    let message = error.to_string();
    let (class, place) = match error {
        Error::Io(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return PyFileNotFoundError::new_err(error.to_string());
        }
        Error::Io(error) => return PyOSError::new_err(error.to_string()),
        Error::Malformed {
            section,
            byte_offset,
            ..
        }
        | Error::MissingReference {
            section,
            byte_offset,
            ..
        } => ("BitstreamError", Some((section, byte_offset))),
        Error::Unsupported { .. } => ("UnsupportedError", None),
        Error::LimitExceeded { .. } => ("LimitError", None),
        Error::OperatingPoint { .. } => ("DataError", None),
        _ => ("MvmatchError", None),
    };
    let build = || {
        let arguments = PyDict::new(py);
        if let Some((section, byte_offset)) = place {
            arguments.set_item("section", section)?;
            arguments.set_item("byte_offset", byte_offset)?;
        }
        py.import("mvmatch.errors")?
            .getattr(class)?
            .call((message,), Some(&arguments))
    };
    match build() {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}

/// Presentation time, data and byte offset of a unit.
type PyUnit<'py> = (Option<i64>, Bound<'py, PyBytes>, u64);

/// Units of an IVF, Section 5 or Annex B file.
#[pyclass(module = "mvmatch._core", name = "ContainerReader")]
pub struct PyContainerReader {
    reader: ContainerReader<File>,
}

#[pymethods]
impl PyContainerReader {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let reader = py
            .detach(|| ContainerReader::open(&path, &Limits::default()))
            .map_err(|error| raise(py, error))?;
        Ok(Self { reader })
    }

    /// The next unit as (pts, data, byte offset), or None at the end.
    fn next_unit<'py>(&mut self, py: Python<'py>) -> PyResult<Option<PyUnit<'py>>> {
        let unit = py
            .detach(|| self.reader.next_unit())
            .map_err(|error| raise(py, error))?;
        Ok(unit.map(|unit| (unit.pts, PyBytes::new(py, &unit.data), unit.byte_offset)))
    }

    #[getter]
    fn kind(&self) -> String {
        format!("{:?}", self.reader.kind()).to_lowercase()
    }

    #[getter]
    fn time_base(&self) -> Option<(u32, u32)> {
        self.reader.time_base()
    }

    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.reader.size()
    }
}

/// The AV1 parser.
#[pyclass(module = "mvmatch._core")]
pub struct Av1Parser {
    parser: Parser,
}

#[pymethods]
impl Av1Parser {
    #[new]
    #[pyo3(signature = (*, operating_point=0, max_frame_area=None, max_frames=None))]
    fn new(operating_point: usize, max_frame_area: Option<u64>, max_frames: Option<u64>) -> Self {
        let mut limits = Limits {
            max_frames,
            ..Limits::default()
        };
        if let Some(area) = max_frame_area {
            limits.max_frame_area = area;
        }
        Self {
            parser: Parser::new(limits).with_operating_point(operating_point),
        }
    }

    /// Hands over one unit.
    #[pyo3(signature = (unit, byte_offset=0))]
    fn push(&mut self, unit: Vec<u8>, byte_offset: u64) {
        self.parser.push(unit, byte_offset);
    }

    /// The next frame of the unit, or None when another unit is needed.
    fn next_frame(&mut self, py: Python<'_>) -> PyResult<Option<CodedFrame>> {
        let frame = py
            .detach(|| self.parser.next_frame())
            .map_err(|error| raise(py, error))?;
        Ok(frame.map(CodedFrame::new))
    }

    /// Checks that the last frame is complete.
    fn finish(&mut self, py: Python<'_>) -> PyResult<()> {
        self.parser.finish().map_err(|error| raise(py, error))
    }
}
