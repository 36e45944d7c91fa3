//! The Python module `mvmatch._core`: converts, releases the GIL, decides nothing.
#![allow(
    clippy::needless_pass_by_value,
    reason = "PyO3 extracts arguments by value"
)]

use pyo3::prelude::*;

mod av1;
mod coded_frame;
mod errors;
mod signals;
mod tracks;

#[pymodule(gil_used = false)]
mod _core {
    #[pymodule_export]
    use super::av1::{Av1Parser, PyContainerReader, default_limits};
    #[pymodule_export]
    use super::coded_frame::CodedFrame;
    #[pymodule_export]
    use super::tracks::{TrackLinker, fit_neighbors, vector_errors};
}
