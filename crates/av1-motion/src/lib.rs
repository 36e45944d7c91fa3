//! AV1 bytes in, motion vectors out.
#![forbid(unsafe_code)]
