//! §5.5, §5.9.2: the facts of the headers that a caller can use.

use crate::motion::Frame;
use crate::warp::is_shear_valid;

/// Facts of the sequence that a frame belongs to, under the specification's names.
#[derive(Clone, Debug, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the specification, one to one"
)]
pub struct SequenceInfo {
    /// 0 main, 1 high, 2 professional.
    pub seq_profile: u8,
    /// The stream is one key frame.
    pub still_picture: bool,
    /// The headers leave out what a still picture does not need.
    pub reduced_still_picture_header: bool,
    /// `operating_point_idc` of every operating point: bits 0 to 7 temporal layers, bits 8 to 11
    /// spatial layers; 0 means everything.
    pub operating_point_idc: Vec<u16>,
    /// Largest width of a frame in luma samples.
    pub max_frame_width: u32,
    /// Largest height of a frame in luma samples.
    pub max_frame_height: u32,
    /// Frames carry numbers that reveal losses.
    pub frame_id_numbers_present: bool,
    /// Superblocks of 128x128 luma samples, not 64x64.
    pub use_128x128_superblock: bool,
    /// Frames carry their place in display order.
    pub enable_order_hint: bool,
    /// `OrderHintBits`.
    pub order_hint_bits: u8,
    /// Bits per sample.
    pub bit_depth: u8,
    /// No chroma planes.
    pub mono_chrome: bool,
    /// Chroma is half as wide.
    pub subsampling_x: u8,
    /// Chroma is half as high.
    pub subsampling_y: u8,
    /// Frames may carry film grain.
    pub film_grain_params_present: bool,
}

/// Facts of a frame's header, under the specification's names.
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
    /// Slot of the frame that is shown, with `show_existing_frame`.
    pub frame_to_show_map_idx: u8,
    /// The frame is shown when it is decoded.
    pub show_frame: bool,
    /// A hidden frame that may be shown later.
    pub showable_frame: bool,
    /// Frames after this one do not need anything before it.
    pub error_resilient_mode: bool,
    /// Probabilities stay as they are at the start of each tile.
    pub disable_cdf_update: bool,
    /// Probabilities at the end of the frame are not kept.
    pub disable_frame_end_update_cdf: bool,
    /// Palettes and whole-pixel vectors are possible.
    pub allow_screen_content_tools: bool,
    /// Blocks may be copied inside the frame.
    pub allow_intrabc: bool,
    /// Number of the frame; 0 without frame ids.
    pub current_frame_id: u32,
    /// `OrderHint`, which wraps around.
    pub order_hint: u32,
    /// `RefOrderHint` of LAST to ALTREF; zeros in intra frames.
    pub ref_order_hint: [u32; 7],
    /// Slots of LAST to ALTREF.
    pub ref_frame_idx: [u8; 7],
    /// Whether LAST to ALTREF come later in display order.
    pub ref_sign_bias: [bool; 7],
    /// `RefUpscaledWidth` of LAST to ALTREF; zeros in intra frames.
    pub ref_upscaled_width: [u32; 7],
    /// `RefFrameHeight` of LAST to ALTREF; zeros in intra frames.
    pub ref_frame_height: [u32; 7],
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
    /// The quantiser differs by frequency.
    pub using_qmatrix: bool,
    /// Blocks may change the quantiser.
    pub delta_q_present: bool,
    /// Binary logarithm of the step of quantiser changes.
    pub delta_q_res: u8,
    /// Blocks may change the loop filter.
    pub delta_lf_present: bool,
    /// Planes and directions have loop filter changes of their own.
    pub delta_lf_multi: bool,
    /// Nothing is quantised.
    pub coded_lossless: bool,
    /// Segmentation is on.
    pub segmentation_enabled: bool,
    /// Blocks carry their segment.
    pub segmentation_update_map: bool,
    /// Segments are predicted from an earlier frame.
    pub segmentation_temporal_update: bool,
    /// `SegIdPreSkip`: segments are read before the other modes.
    pub seg_id_pre_skip: bool,
    /// Bits of the choice of a CDEF filter for each 64x64 luma samples.
    pub cdef_bits: u8,
    /// `FrameRestorationType` of Y, U, V: 0 none, 1 Wiener, 2 self-guided, 3 switchable.
    pub frame_restoration_type: [u8; 3],
    /// 0 4x4 only, 1 largest, 2 chosen by the blocks.
    pub tx_mode: u8,
    /// Fewer transform types.
    pub reduced_tx_set: bool,
    /// Vectors have 1/8 px precision.
    pub allow_high_precision_mv: bool,
    /// Vectors have whole pixels only; always set in intra frames.
    pub force_integer_mv: bool,
    /// 0 regular, 1 smooth, 2 sharp, 3 bilinear, 4 chosen by the blocks.
    pub interpolation_filter: u8,
    /// Blocks choose among motion modes.
    pub is_motion_mode_switchable: bool,
    /// Vectors of earlier frames predict those of this one.
    pub use_ref_frame_mvs: bool,
    /// Blocks may average two references.
    pub reference_select: bool,
    /// Blocks may take the two nearest references and vectors without a residual.
    pub skip_mode_present: bool,
    /// `SkipModeFrame`: names of those references, 1 LAST to 7 ALTREF; 0 where there are none.
    pub skip_mode_frame: [u8; 2],
    /// Blocks may follow a local affine model.
    pub allow_warped_motion: bool,
    /// Tile columns.
    pub tile_cols: u32,
    /// Tile rows.
    pub tile_rows: u32,
    /// Tiles have equal sizes.
    pub uniform_tile_spacing: bool,
    /// Tile whose probabilities are kept.
    pub context_update_tile_id: u32,
    /// `GmType` of LAST to ALTREF: 0 identity, 1 translation, 2 rotzoom, 3 affine.
    pub gm_type: [u8; 7],
    /// `gm_params` of LAST to ALTREF.
    pub gm_params: [[i32; 6]; 7],
    /// Whether the models of LAST to ALTREF can be used to warp (`warpValid` of §7.11.3.6).
    pub is_gm_valid: [bool; 7],
    /// Film grain is added to the shown picture.
    pub apply_grain: bool,
}

impl Frame {
    /// Facts of the frame's sequence header.
    #[must_use]
    pub fn sequence_info(&self) -> SequenceInfo {
        let (sequence, color) = (&*self.sequence, &self.sequence.color);
        SequenceInfo {
            seq_profile: sequence.seq_profile,
            still_picture: sequence.still_picture,
            reduced_still_picture_header: sequence.reduced_still_picture_header,
            operating_point_idc: sequence.operating_points.iter().map(|p| p.idc).collect(),
            max_frame_width: sequence.max_frame_width,
            max_frame_height: sequence.max_frame_height,
            frame_id_numbers_present: sequence.frame_id_numbers_present,
            use_128x128_superblock: sequence.use_128x128_superblock,
            enable_order_hint: sequence.enable_order_hint,
            order_hint_bits: sequence.order_hint_bits,
            bit_depth: color.bit_depth,
            mono_chrome: color.mono_chrome,
            subsampling_x: color.subsampling_x,
            subsampling_y: color.subsampling_y,
            film_grain_params_present: sequence.film_grain_params_present,
        }
    }

    /// Facts of the frame's header.
    #[must_use]
    pub fn info(&self) -> FrameInfo {
        let header = &*self.header;
        let size = &header.size;
        FrameInfo {
            frame_type: header.frame_type as u8,
            show_existing_frame: header.show_existing_frame,
            frame_to_show_map_idx: header.frame_to_show_map_idx,
            show_frame: header.show_frame,
            showable_frame: header.showable_frame,
            error_resilient_mode: header.error_resilient_mode,
            disable_cdf_update: header.disable_cdf_update,
            disable_frame_end_update_cdf: header.disable_frame_end_update_cdf,
            allow_screen_content_tools: header.allow_screen_content_tools,
            allow_intrabc: header.allow_intrabc,
            current_frame_id: header.current_frame_id,
            order_hint: header.order_hint,
            ref_order_hint: named(header.order_hints),
            ref_frame_idx: header.ref_frame_idx,
            ref_sign_bias: named(header.ref_frame_sign_bias),
            ref_upscaled_width: named(self.ref_size.map(|size| size[0])),
            ref_frame_height: named(self.ref_size.map(|size| size[1])),
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
            using_qmatrix: header.quantization.using_qmatrix,
            delta_q_present: header.delta_q_present,
            delta_q_res: header.delta_q_res,
            delta_lf_present: header.delta_lf_present,
            delta_lf_multi: header.delta_lf_multi,
            coded_lossless: header.coded_lossless,
            segmentation_enabled: header.segmentation.enabled,
            segmentation_update_map: header.segmentation.update_map,
            segmentation_temporal_update: header.segmentation.temporal_update,
            seg_id_pre_skip: header.segmentation.seg_id_pre_skip,
            cdef_bits: header.cdef.bits,
            frame_restoration_type: header.loop_restoration.frame_restoration_type,
            tx_mode: header.tx_mode as u8,
            reduced_tx_set: header.reduced_tx_set,
            allow_high_precision_mv: header.allow_high_precision_mv,
            force_integer_mv: header.force_integer_mv,
            interpolation_filter: header.interpolation_filter,
            is_motion_mode_switchable: header.is_motion_mode_switchable,
            use_ref_frame_mvs: header.use_ref_frame_mvs,
            reference_select: header.reference_select,
            skip_mode_present: header.skip_mode_present,
            skip_mode_frame: header.skip_mode_frame,
            allow_warped_motion: header.allow_warped_motion,
            tile_cols: header.tile_info.tile_cols,
            tile_rows: header.tile_info.tile_rows,
            uniform_tile_spacing: header.tile_info.uniform_tile_spacing,
            context_update_tile_id: header.tile_info.context_update_tile_id,
            gm_type: named(header.gm_type),
            gm_params: named(header.gm_params),
            is_gm_valid: named(header.gm_params).map(|params| is_shear_valid(&params)),
            apply_grain: header.film_grain.apply_grain,
        }
    }
}

/// The entries of LAST to ALTREF.
fn named<T: Copy>(by_name: [T; 8]) -> [T; 7] {
    std::array::from_fn(|index| by_name[index + 1])
}
