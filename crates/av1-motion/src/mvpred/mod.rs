//! §7.9 Motion field estimation and §7.10 Motion vector prediction.

mod extra;
pub(crate) mod global;
mod overlap;
pub(crate) mod projection;
mod spatial;
mod stack;
pub(crate) mod storage;
mod temporal;
pub(crate) mod warp_samples;

pub(crate) use stack::MvStack;
