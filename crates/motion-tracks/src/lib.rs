//! Motion fields in, point tracks out.
//!
//! The crate knows blocks, vectors and frame numbers; no codec, no container, no I/O. A [`Field`]
//! holds the vectors of one coded frame, a [`Linker`] takes fields in decode order and chains them
//! into [`Tracks`], [`fit_neighbors`] tells what the
//! vectors around each one say, and [`vector_errors`] how far off it may be.
//!
//! Coordinates are pixels, `[x, y]`, origin at the upper-left picture corner, so the first pixel's
//! centre is (0.5, 0.5). A vector leads from the current frame into its reference:
//! `xy_in_reference = xy_in_current + mv`. Frames are display indices. Everything is deterministic.
#![forbid(unsafe_code)]
#![cfg_attr(
    test,
    allow(clippy::float_cmp, reason = "expected values are exact in binary")
)]

mod cells;
mod chain;
mod confidence;
mod cover;
mod curvature;
mod extend;
mod field;
mod filter;
mod link;
mod motion;
mod neighbors;
mod seeds;
mod tracks;
mod window;

pub use confidence::{ErrorModel, vector_errors};
pub use field::{Field, FieldError};
pub use filter::{FitOptions, LocalFit, fit_neighbors};
pub use link::{Fill, LinkOptions, Linked, Linker};
pub use motion::{Carry, Cosine, Follow};
pub use tracks::Tracks;
