//! The Python module `mvmatch._core`: converts, releases the GIL, decides nothing.
use pyo3::prelude::*;

#[pymodule(gil_used = false)]
mod _core {}
