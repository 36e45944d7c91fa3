//! AV1 bytes in, motion vectors out: a syntax-only AV1 decoder that never reconstructs a pixel.
//!
//! Written from the AV1 specification; `§` names its sections (edition of June 2023).
#![forbid(unsafe_code)]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "positions, sizes and vectors fit by the limits of the format, which the headers check"
)]

mod bits;
mod container;
mod display;
mod entropy;
mod error;
mod frame;
mod info;
mod interrupt;
mod limits;
mod memory;
mod motion;
mod mvpred;
mod obu;
mod parser;
mod refs;
#[allow(
    dead_code,
    reason = "the tables and constants of the specification, complete"
)]
mod tables;
mod tile;
mod trace;
mod warp;

pub use container::{ContainerKind, ContainerReader, Unit};
pub use error::{Error, Result};
pub use info::{FrameInfo, SequenceInfo};
pub use limits::Limits;
pub use motion::{Frame, Motion, MotionVector, Reference, flags};
pub use parser::Parser;
#[cfg(fuzzing)]
#[doc(hidden)]
pub use parser::fuzzing;
pub use tile::{Block, CoefficientStats};
#[cfg(feature = "trace")]
pub use trace::{FrameTrace, SymbolCounts, TracedSlot, TransformBlock};
