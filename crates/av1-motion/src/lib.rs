//! AV1 bytes in, motion vectors out.
#![forbid(unsafe_code)]

#[allow(dead_code)] // until the parser reads them all
mod entropy;
#[allow(dead_code)] // until the parser reads them all
mod tables;
