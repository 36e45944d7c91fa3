//! Motion fields in, point tracks out.
#![forbid(unsafe_code)]
