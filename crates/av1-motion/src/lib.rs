//! AV1 bytes in, motion vectors out: a syntax-only AV1 decoder that never reconstructs a pixel.
//!
//! A video encoder finds, block by block, where each piece of a picture came from. Parsing does not
//! need pixels, so this crate reads the vectors exactly, and several other facts of each block,
//! without decoding the picture.
//!
//! ```no_run
//! use av1_motion::{ContainerReader, Limits, Parser};
//!
//! # fn main() -> av1_motion::Result<()> {
//! let limits = Limits::default();
//! let mut reader = ContainerReader::open("clip.ivf", &limits)?;
//! let mut parser = Parser::new(limits);
//! while let Some(unit) = reader.next_unit()? {
//!     parser.push(unit.data, unit.byte_offset);
//!     while let Some(frame) = parser.next_frame()? {
//!         for motion in frame.motion() {
//!             let ([x, y, ..], [dx, dy]) = (motion.block, motion.mv);
//!             println!("({x}, {y}) came from ({dx:+}, {dy:+}) px");
//!         }
//!     }
//! }
//! parser.finish()
//! # }
//! ```
//!
//! # What it reads
//! - All of AV1's syntax but large-scale tiles (§5.12), in all profiles, bit depths and chroma formats.
//! - IVF, low-overhead OBU streams ("Section 5") and Annex B ([`ContainerReader`]). Packets from any
//!   other demultiplexer (MP4, Matroska, WebM, RTP) go straight to [`Parser::push`]; the OBUs of the
//!   container's configuration record go in front of the first one.
//! - [`Frame::motion`]: one [`Motion`] for each inter block and reference, with affine models where the
//!   block has one; [`Frame::blocks`]: every coded [`Block`] under the specification's names;
//!   [`Frame::info`]: facts of the headers.
//!
//! It decodes no pixels, no film grain, no metadata, and it encodes nothing.
//!
//! # Units
//! [`Motion`] is in pixels of the shown picture, `x` to the right and `y` down from its upper left
//! corner, so that the centre of the first pixel is (0.5, 0.5). A vector is the position in the reference
//! minus the position in the frame. [`Block`] is in the specification's terms: units of 4 luma samples
//! of the coded frame, vectors in 1/8 sample, rows before columns. Frames are numbered in decode order
//! and in display order, both from 0.
//!
//! # Damage and hostile files
//! Whatever the bytes, the parser returns frames or an [`Error`], never a panic, and what it returns is
//! exact: nothing is concealed or guessed. After an error it can be asked on: it reads the next frame
//! that depends on nothing that was lost. [`Limits`] bound memory and work, and
//! [`Parser::interrupt_when`] stops in the middle of a frame. The library writes nothing to the
//! terminal and has no dependencies and no unsafe code.
//!
//! # Threads
//! [`Parser::with_threads`] reads key-frame segments, independent frames and tiles at the same time;
//! frames come in the same order, later. Without it the caller's thread does all the work, and every
//! frame comes with its unit.
//!
//! # Features and versions
//! The only cargo feature, `trace`, serves the tests of this repository and may change at any time.
//! Public enums are non-exhaustive where the format or the parser may grow; a field that is added to
//! [`Limits`], [`Block`] or [`FrameInfo`] makes a minor version before 1.0.
//!
//! Written from the AV1 specification; `§` names its sections (edition of June 2023).
#![forbid(unsafe_code)]
#![warn(missing_docs)]
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
