//! Door to `av1-motion`: files and bytes in, frames out.

use std::fs::File;
use std::path::PathBuf;

use av1_motion::{ContainerReader, Limits, Parser};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::coded_frame::CodedFrame;
use crate::errors::{guarded, raise};
use crate::signals::{Interruptible, Signals};

/// `mvmatch.Limits`, field by field.
#[derive(FromPyObject)]
#[expect(
    clippy::struct_field_names,
    reason = "the names of `av1_motion::Limits`"
)]
pub struct PyLimits {
    max_frame_area: u64,
    max_tiles: u32,
    max_unit_bytes: u64,
    max_frames: Option<u64>,
    max_unit_samples: u64,
    max_samples: Option<u64>,
}

impl PyLimits {
    fn or_default(limits: Option<Self>) -> Limits {
        let mut chosen = Limits::default();
        if let Some(limits) = limits {
            chosen.max_frame_area = limits.max_frame_area;
            chosen.max_tiles = limits.max_tiles;
            chosen.max_unit_bytes = limits.max_unit_bytes;
            chosen.max_frames = limits.max_frames;
            chosen.max_unit_samples = limits.max_unit_samples;
            chosen.max_samples = limits.max_samples;
        }
        chosen
    }
}

/// The limits that hold when none are given, by name.
#[pyfunction]
pub fn default_limits(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let limits = Limits::default();
    let named = PyDict::new(py);
    named.set_item("max_frame_area", limits.max_frame_area)?;
    named.set_item("max_tiles", limits.max_tiles)?;
    named.set_item("max_unit_bytes", limits.max_unit_bytes)?;
    named.set_item("max_frames", limits.max_frames)?;
    named.set_item("max_unit_samples", limits.max_unit_samples)?;
    named.set_item("max_samples", limits.max_samples)?;
    Ok(named)
}

/// Presentation time, data and byte offset of a unit.
type PyUnit<'py> = (Option<i64>, Bound<'py, PyBytes>, u64);

/// Units of an IVF, Section 5 or Annex B file.
#[pyclass(module = "mvmatch._core", name = "ContainerReader")]
pub struct PyContainerReader {
    reader: ContainerReader<Interruptible<File>>,
    signals: Signals,
}

#[pymethods]
impl PyContainerReader {
    #[new]
    #[pyo3(signature = (path, *, limits=None))]
    fn new(py: Python<'_>, path: PathBuf, limits: Option<PyLimits>) -> PyResult<Self> {
        let (limits, signals) = (PyLimits::or_default(limits), Signals::new());
        let watched = signals.clone();
        let reader = guarded(py, "while a file is opened", || {
            let file = Interruptible::new(File::open(&path)?, watched);
            ContainerReader::new(file, &limits)
        })?;
        match reader {
            Ok(reader) => Ok(Self { reader, signals }),
            Err(error) => Err(signals.take().unwrap_or_else(|| raise(py, error))),
        }
    }

    /// The next unit as (pts, data, byte offset), or None at the end.
    fn next_unit<'py>(&mut self, py: Python<'py>) -> PyResult<Option<PyUnit<'py>>> {
        let reader = &mut self.reader;
        let unit = guarded(py, "while a container is split", || reader.next_unit())?;
        let unit = unit.map_err(|error| {
            let signal = self.signals.take();
            signal.unwrap_or_else(|| raise(py, error))
        })?;
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
    signals: Signals,
    /// Frames returned so far, for messages.
    frames: u64,
    /// Where the last unit starts in the file, for messages.
    byte_offset: u64,
    /// A panic left the parser in a state that nobody knows.
    is_broken: bool,
}

#[pymethods]
impl Av1Parser {
    #[new]
    #[pyo3(signature = (*, limits=None, operating_point=0, threads=1))]
    fn new(limits: Option<PyLimits>, operating_point: usize, threads: usize) -> Self {
        let signals = Signals::new();
        let mut parser = Parser::new(PyLimits::or_default(limits))
            .with_operating_point(operating_point)
            .with_threads(threads);
        let watched = signals.clone();
        parser.interrupt_when(move || watched.are_pending());
        Self {
            parser,
            signals,
            frames: 0,
            byte_offset: 0,
            is_broken: false,
        }
    }

    /// Hands over one unit.
    #[pyo3(signature = (unit, byte_offset=0))]
    fn push(&mut self, unit: &[u8], byte_offset: u64) -> PyResult<()> {
        let mut data = Vec::new();
        data.try_reserve_exact(unit.len())
            .map_err(|error| PyMemoryError::new_err(error.to_string()))?;
        data.extend_from_slice(unit);
        self.byte_offset = byte_offset;
        self.parser.push(data, byte_offset);
        Ok(())
    }

    /// The next frame, or None when another unit is needed; after `finish` when there is none left.
    fn next_frame(&mut self, py: Python<'_>) -> PyResult<Option<CodedFrame>> {
        let frame = self.run(py, Parser::next_frame)?;
        self.frames += u64::from(frame.is_some());
        Ok(frame.map(CodedFrame::new))
    }

    /// Checks that the last frame is complete.
    fn finish(&mut self, py: Python<'_>) -> PyResult<()> {
        self.run(py, Parser::finish)
    }
}

impl Av1Parser {
    /// Lets the parser work without the GIL.
    fn run<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Parser) -> av1_motion::Result<T> + Send,
    ) -> PyResult<T> {
        let place = format!(
            "at frame {}, in the unit at byte {}",
            self.frames, self.byte_offset
        );
        // Until the work has come to an end, nobody knows what state it leaves.
        if std::mem::replace(&mut self.is_broken, true) {
            return Err(crate::errors::fault(
                py,
                &place,
                &"an earlier fault ended this parser",
            ));
        }
        let parser = &mut self.parser;
        let result = guarded(py, &place, move || work(parser))?;
        self.is_broken = false;
        result.map_err(|error| {
            let signal = self.signals.take();
            signal.unwrap_or_else(|| raise(py, error))
        })
    }
}
