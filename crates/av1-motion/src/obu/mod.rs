//! §5.3 to §5.9 and the header of §5.11.1: everything that is coded in plain bits.

pub(crate) mod cdef;
pub(crate) mod color_config;
pub(crate) mod delta;
pub(crate) mod film_grain;
pub(crate) mod frame_header;
pub(crate) mod frame_references;
pub(crate) mod frame_size;
pub(crate) mod global_motion;
pub(crate) mod header;
pub(crate) mod loop_filter;
pub(crate) mod loop_restoration;
pub(crate) mod quantization;
pub(crate) mod segmentation;
pub(crate) mod sequence_header;
pub(crate) mod set_frame_refs;
pub(crate) mod skip_mode;
pub(crate) mod tile_group;
pub(crate) mod tile_info;
pub(crate) mod timing;
pub(crate) mod uncompressed_header;

#[cfg(test)]
mod tests;
