//! AV1 bytes in, motion vectors out.
#![forbid(unsafe_code)]
#![allow(dead_code, unused_imports)] // until the parser reads them all

mod bits;
mod container;
mod entropy;
mod error;
mod limits;
mod obu;
mod refs;
mod tables;

pub use container::{ContainerKind, ContainerReader, Unit};
pub use error::{Error, Result};
pub use limits::Limits;
