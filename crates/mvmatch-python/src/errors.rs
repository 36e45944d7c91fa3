//! Errors and faults of `av1-motion` as the exceptions of `mvmatch.errors`.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use av1_motion::Error;
use pyo3::exceptions::{PyFileNotFoundError, PyMemoryError, PyOSError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One Python exception for each kind of error, with its place as attributes.
pub(crate) fn raise(py: Python<'_>, error: Error) -> PyErr {
    let message = error.to_string();
    let (class, place) = match error {
        Error::Io(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return PyFileNotFoundError::new_err(error.to_string());
        }
        Error::Io(error) => return PyOSError::new_err(error.to_string()),
        Error::OutOfMemory { .. } => return PyMemoryError::new_err(message),
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
    instance(py, class, &message, |arguments| {
        if let Some((section, byte_offset)) = place {
            arguments.set_item("section", section)?;
            arguments.set_item("byte_offset", byte_offset)?;
        }
        Ok(())
    })
}

/// An exception of a class of `mvmatch.errors`.
fn instance(
    py: Python<'_>,
    class: &str,
    message: &str,
    fill: impl FnOnce(&Bound<'_, PyDict>) -> PyResult<()>,
) -> PyErr {
    let build = || {
        let arguments = PyDict::new(py);
        fill(&arguments)?;
        py.import("mvmatch.errors")?
            .getattr(class)?
            .call((message,), Some(&arguments))
    };
    match build() {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}

/// Runs `run` without the GIL. A panic there is a fault of mvmatch and is told as one, with the place
/// in the stream that brought it about.
pub(crate) fn guarded<T: Send>(
    py: Python<'_>,
    place: &str,
    run: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    py.detach(|| catch_unwind(AssertUnwindSafe(run)))
        .map_err(|payload| fault(py, place, payload.as_ref()))
}

/// The exception for a panic.
pub(crate) fn fault(py: Python<'_>, place: &str, payload: &(dyn Any + Send)) -> PyErr {
    let words = payload
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message");
    let message = format!(
        "internal error of mvmatch {place}: {words}. This is a bug in mvmatch, not in the file; \
         please report it with the file"
    );
    instance(py, "InternalError", &message, |_| Ok(()))
}
