//! §5.9.2: the facts of a frame header that a caller can use.

use crate::motion::Frame;

/// Facts of a frame's headers, under the specification's names.
#[derive(Clone, Debug, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the specification, one to one"
)]
pub struct FrameInfo {
    /// 0 key, 1 inter, 2 intra-only, 3 switch.
    pub frame_type: u8,
    /// An earlier frame is shown; nothing is coded.
    pub show_existing_frame: bool,
    /// The frame is shown when it is decoded.
    pub show_frame: bool,
    /// A hidden frame that may be shown later.
    pub showable_frame: bool,
    /// Frames after this one do not need anything before it.
    pub error_resilient_mode: bool,
    /// `OrderHint`, which wraps around.
    pub order_hint: u32,
    /// `RefOrderHint` of LAST to ALTREF; zeros in intra frames.
    pub ref_order_hint: [u32; 7],
    /// Slots of LAST to ALTREF.
    pub ref_frame_idx: [u8; 7],
    /// Whether LAST to ALTREF come later in display order.
    pub ref_sign_bias: [bool; 7],
    /// Bit i: slot i receives the frame.
    pub refresh_frame_flags: u8,
    /// 7 when the frame starts from default probabilities.
    pub primary_ref_frame: u8,
    /// Coded width in luma samples.
    pub frame_width: u32,
    /// Coded height in luma samples.
    pub frame_height: u32,
    /// Width of the shown picture in luma samples.
    pub upscaled_width: u32,
    /// Intended width for display.
    pub render_width: u32,
    /// Intended height for display.
    pub render_height: u32,
    /// Coded width is `upscaled_width * 8 / superres_denom`.
    pub superres_denom: u8,
    /// Rows of 4x4 luma samples.
    pub mi_rows: u32,
    /// Columns of 4x4 luma samples.
    pub mi_cols: u32,
    /// Quantiser index of the frame, 0 to 255.
    pub base_q_idx: u8,
    /// Segmentation is on.
    pub segmentation_enabled: bool,
    /// Vectors have 1/8 px precision.
    pub allow_high_precision_mv: bool,
    /// Vectors have whole pixels only.
    pub force_integer_mv: bool,
    /// Vectors of earlier frames predict those of this one.
    pub use_ref_frame_mvs: bool,
    /// Blocks may average two references.
    pub reference_select: bool,
    /// Tile columns.
    pub tile_cols: u32,
    /// Tile rows.
    pub tile_rows: u32,
    /// Superblocks of 128x128 luma samples, not 64x64.
    pub use_128x128_superblock: bool,
    /// `GmType` of LAST to ALTREF: 0 identity, 1 translation, 2 rotzoom, 3 affine.
    pub gm_type: [u8; 7],
    /// `gm_params` of LAST to ALTREF.
    pub gm_params: [[i32; 6]; 7],
    /// Bits per sample.
    pub bit_depth: u8,
    /// No chroma planes.
    pub mono_chrome: bool,
    /// Chroma is half as wide.
    pub subsampling_x: u8,
    /// Chroma is half as high.
    pub subsampling_y: u8,
}

impl Frame {
    /// Facts of the frame's headers.
    #[must_use]
    pub fn info(&self) -> FrameInfo {
        let (header, sequence) = (&*self.header, &*self.sequence);
        let (size, color) = (&header.size, &sequence.color);
        FrameInfo {
            frame_type: header.frame_type as u8,
            show_existing_frame: header.show_existing_frame,
            show_frame: header.show_frame,
            showable_frame: header.showable_frame,
            error_resilient_mode: header.error_resilient_mode,
            order_hint: header.order_hint,
            ref_order_hint: named(header.order_hints),
            ref_frame_idx: header.ref_frame_idx,
            ref_sign_bias: named(header.ref_frame_sign_bias),
            refresh_frame_flags: header.refresh_frame_flags,
            primary_ref_frame: header.primary_ref_frame,
            frame_width: size.frame_width,
            frame_height: size.frame_height,
            upscaled_width: size.upscaled_width,
            render_width: size.render_width,
            render_height: size.render_height,
            superres_denom: size.superres_denom,
            mi_rows: size.mi_rows,
            mi_cols: size.mi_cols,
            base_q_idx: header.quantization.base_q_idx,
            segmentation_enabled: header.segmentation.enabled,
            allow_high_precision_mv: header.allow_high_precision_mv,
            force_integer_mv: header.force_integer_mv,
            use_ref_frame_mvs: header.use_ref_frame_mvs,
            reference_select: header.reference_select,
            tile_cols: header.tile_info.tile_cols,
            tile_rows: header.tile_info.tile_rows,
            use_128x128_superblock: sequence.use_128x128_superblock,
            gm_type: named(header.gm_type),
            gm_params: named(header.gm_params),
            bit_depth: color.bit_depth,
            mono_chrome: color.mono_chrome,
            subsampling_x: color.subsampling_x,
            subsampling_y: color.subsampling_y,
        }
    }
}

/// The entries of LAST to ALTREF.
fn named<T: Copy>(by_name: [T; 8]) -> [T; 7] {
    std::array::from_fn(|index| by_name[index + 1])
}
