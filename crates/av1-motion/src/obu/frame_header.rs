//! §5.9: what a frame header says, as data. `uncompressed_header.rs` reads it.

use super::cdef::CdefParams;
use super::delta::{DeltaLfParams, DeltaQParams};
use super::film_grain::FilmGrainParams;
use super::frame_size::FrameSize;
use super::global_motion::DEFAULT_GM_PARAMS;
use super::loop_filter::LoopFilterParams;
use super::loop_restoration::LoopRestorationParams;
use super::quantization::QuantizationParams;
use super::segmentation::{MAX_SEGMENTS, SEG_LVL_ALT_Q, SEGMENTS, SegmentationParams};
use super::tile_info::TileInfo;
use crate::tables::symbols::IDENTITY;
pub(crate) use crate::tables::symbols::{
    NUM_REF_FRAMES, PRIMARY_REF_NONE, REFS_PER_FRAME, SWITCHABLE, TOTAL_REFS_PER_FRAME,
};

/// `allFrames` of §5.9.2: a refresh of every slot.
pub(crate) const ALL_FRAMES: u8 = 0xff;

/// §6.8.2 `frame_type`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum FrameType {
    #[default]
    Key = 0,
    Inter = 1,
    IntraOnly = 2,
    Switch = 3,
}

impl From<u8> for FrameType {
    /// The two low bits of `number`.
    fn from(number: u8) -> Self {
        match number & 3 {
            0 => Self::Key,
            1 => Self::Inter,
            2 => Self::IntraOnly,
            _ => Self::Switch,
        }
    }
}

impl FrameType {
    /// `FrameIsIntra`.
    pub(crate) fn is_intra(self) -> bool {
        matches!(self, Self::Key | Self::IntraOnly)
    }
}

/// §6.8.21 `TxMode`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum TxMode {
    #[default]
    Only4x4 = 0,
    Largest = 1,
    Select = 2,
}

/// §5.9.2 `uncompressed_header`. With `show_existing_frame` only the fields up to `size`, the
/// order hints, global motion and film grain have a meaning; they describe the shown frame.
#[derive(Debug, Clone)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the specification, one to one"
)]
pub(crate) struct FrameHeader {
    pub(crate) show_existing_frame: bool,
    /// Slot to show, with `show_existing_frame`.
    pub(crate) frame_to_show_map_idx: u8,
    pub(crate) frame_type: FrameType,
    /// `FrameIsIntra`.
    pub(crate) frame_is_intra: bool,
    pub(crate) show_frame: bool,
    pub(crate) showable_frame: bool,
    /// Set for every shown key frame, whether coded or not.
    pub(crate) error_resilient_mode: bool,
    /// `temporal_point_info` (§5.9.31), if present.
    pub(crate) frame_presentation_time: Option<u32>,
    pub(crate) disable_cdf_update: bool,
    pub(crate) allow_screen_content_tools: bool,
    /// After the rule that intra frames force it.
    pub(crate) force_integer_mv: bool,
    /// 0 without frame ids.
    pub(crate) current_frame_id: u32,
    pub(crate) frame_size_override: bool,
    /// `OrderHint`.
    pub(crate) order_hint: u32,
    /// Index into `ref_frame_idx`, or [`PRIMARY_REF_NONE`].
    pub(crate) primary_ref_frame: u8,
    /// Bit i: slot i receives this frame.
    pub(crate) refresh_frame_flags: u8,
    pub(crate) size: FrameSize,
    pub(crate) allow_intrabc: bool,
    pub(crate) frame_refs_short_signaling: bool,
    /// Slots of `LAST_FRAME` to `ALTREF_FRAME`; zeros for intra frames.
    pub(crate) ref_frame_idx: [u8; REFS_PER_FRAME],
    pub(crate) allow_high_precision_mv: bool,
    /// 0 to 3, or [`SWITCHABLE`].
    pub(crate) interpolation_filter: u8,
    pub(crate) is_motion_mode_switchable: bool,
    pub(crate) use_ref_frame_mvs: bool,
    /// `OrderHints`, by reference name; index 0 is unused, intra frames have zeros.
    pub(crate) order_hints: [u32; TOTAL_REFS_PER_FRAME],
    /// `RefFrameSignBias`, by reference name: the reference comes later in display order.
    pub(crate) ref_frame_sign_bias: [bool; TOTAL_REFS_PER_FRAME],
    pub(crate) disable_frame_end_update_cdf: bool,
    pub(crate) tile_info: TileInfo,
    pub(crate) quantization: QuantizationParams,
    pub(crate) segmentation: SegmentationParams,
    pub(crate) delta_q_present: bool,
    /// Left shift of decoded quantizer index deltas.
    pub(crate) delta_q_res: u8,
    pub(crate) delta_lf_present: bool,
    /// Left shift of decoded loop filter deltas.
    pub(crate) delta_lf_res: u8,
    pub(crate) delta_lf_multi: bool,
    /// `LosslessArray`, by segment.
    pub(crate) lossless_array: [bool; MAX_SEGMENTS],
    pub(crate) coded_lossless: bool,
    pub(crate) all_lossless: bool,
    pub(crate) loop_filter: LoopFilterParams,
    pub(crate) cdef: CdefParams,
    pub(crate) loop_restoration: LoopRestorationParams,
    pub(crate) tx_mode: TxMode,
    pub(crate) reference_select: bool,
    pub(crate) skip_mode_present: bool,
    /// `SkipModeFrame`: reference names, zeros if skip mode is not allowed.
    pub(crate) skip_mode_frame: [u8; 2],
    pub(crate) allow_warped_motion: bool,
    pub(crate) reduced_tx_set: bool,
    /// `GmType`, by reference name.
    pub(crate) gm_type: [u8; TOTAL_REFS_PER_FRAME],
    /// `gm_params`, by reference name.
    pub(crate) gm_params: [[i32; 6]; TOTAL_REFS_PER_FRAME],
    pub(crate) film_grain: FilmGrainParams,
}

impl Default for FrameHeader {
    fn default() -> Self {
        Self {
            show_existing_frame: false,
            frame_to_show_map_idx: 0,
            frame_type: FrameType::Key,
            frame_is_intra: true,
            show_frame: true,
            showable_frame: false,
            error_resilient_mode: true,
            frame_presentation_time: None,
            disable_cdf_update: false,
            allow_screen_content_tools: false,
            force_integer_mv: false,
            current_frame_id: 0,
            frame_size_override: false,
            order_hint: 0,
            primary_ref_frame: PRIMARY_REF_NONE,
            refresh_frame_flags: 0,
            size: FrameSize::default(),
            allow_intrabc: false,
            frame_refs_short_signaling: false,
            ref_frame_idx: [0; REFS_PER_FRAME],
            allow_high_precision_mv: false,
            interpolation_filter: 0,
            is_motion_mode_switchable: false,
            use_ref_frame_mvs: false,
            order_hints: [0; TOTAL_REFS_PER_FRAME],
            ref_frame_sign_bias: [false; TOTAL_REFS_PER_FRAME],
            disable_frame_end_update_cdf: false,
            tile_info: TileInfo::default(),
            quantization: QuantizationParams::default(),
            segmentation: SegmentationParams::default(),
            delta_q_present: false,
            delta_q_res: 0,
            delta_lf_present: false,
            delta_lf_res: 0,
            delta_lf_multi: false,
            lossless_array: [false; MAX_SEGMENTS],
            coded_lossless: false,
            all_lossless: false,
            loop_filter: LoopFilterParams::default(),
            cdef: CdefParams::default(),
            loop_restoration: LoopRestorationParams::default(),
            tx_mode: TxMode::Only4x4,
            reference_select: false,
            skip_mode_present: false,
            skip_mode_frame: [0; 2],
            allow_warped_motion: false,
            reduced_tx_set: false,
            gm_type: [IDENTITY; TOTAL_REFS_PER_FRAME],
            gm_params: DEFAULT_GM_PARAMS,
            film_grain: FilmGrainParams::default(),
        }
    }
}

impl FrameHeader {
    /// §7.12.2 `get_qindex( ignoreDeltaQ, segment )`. `current_q_index` is `CurrentQIndex`; `None`
    /// means `ignoreDeltaQ` = 1.
    pub(crate) fn qindex(&self, segment: u8, current_q_index: Option<u8>) -> u8 {
        let base = current_q_index
            .filter(|_| self.delta_q_present)
            .unwrap_or(self.quantization.base_q_idx);
        if !self.segmentation.feature_active(segment, SEG_LVL_ALT_Q) {
            return base;
        }
        let data = self.segmentation.feature_data[usize::from(segment)][SEG_LVL_ALT_Q];
        let qindex = (i16::from(base) + data).clamp(0, 255);
        u8::try_from(qindex).unwrap_or(u8::MAX)
    }

    /// A shown key frame, which starts from nothing.
    pub(crate) fn is_shown_key(&self) -> bool {
        self.frame_type == FrameType::Key && self.show_frame && !self.show_existing_frame
    }

    /// Slot of the primary reference frame, if there is one.
    pub(crate) fn primary_slot(&self) -> Option<usize> {
        let name = usize::from(self.primary_ref_frame);
        self.ref_frame_idx.get(name).map(|&slot| slot.into())
    }

    /// §5.9.2: `LosslessArray`, `CodedLossless` and `AllLossless`.
    pub(crate) fn derive_lossless(&mut self) {
        let no_deltas = self.quantization.has_no_deltas();
        self.lossless_array = SEGMENTS.map(|segment| no_deltas && self.qindex(segment, None) == 0);
        self.coded_lossless = self.lossless_array == [true; MAX_SEGMENTS];
        self.all_lossless =
            self.coded_lossless && self.size.frame_width == self.size.upscaled_width;
    }

    pub(crate) fn set_deltas(&mut self, delta_q: DeltaQParams, delta_lf: DeltaLfParams) {
        self.delta_q_present = delta_q.present;
        self.delta_q_res = delta_q.res;
        self.delta_lf_present = delta_lf.present;
        self.delta_lf_res = delta_lf.res;
        self.delta_lf_multi = delta_lf.multi;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header_with_segment_offset(offset: i16) -> FrameHeader {
        let mut header = FrameHeader::default();
        header.quantization.base_q_idx = 100;
        header.segmentation.enabled = true;
        header.segmentation.feature_enabled[2][SEG_LVL_ALT_Q] = true;
        header.segmentation.feature_data[2][SEG_LVL_ALT_Q] = offset;
        header
    }

    #[test]
    fn the_segment_offset_is_added_to_the_current_index_and_clipped() {
        let mut header = header_with_segment_offset(-30);
        assert_eq!(header.qindex(0, None), 100);
        assert_eq!(header.qindex(2, None), 70);
        assert_eq!(header.qindex(2, Some(20)), 70);
        header.delta_q_present = true;
        assert_eq!(header.qindex(0, Some(20)), 20);
        assert_eq!(header.qindex(2, Some(20)), 0);
        assert_eq!(header.qindex(2, Some(45)), 15);
        assert_eq!(header_with_segment_offset(255).qindex(2, None), 255);
    }

    #[test]
    fn one_lossy_segment_makes_the_frame_lossy() {
        let mut header = header_with_segment_offset(-100);
        header.quantization.base_q_idx = 0;
        header.size.frame_width = 8;
        header.size.upscaled_width = 8;
        header.derive_lossless();
        assert!(header.coded_lossless && header.all_lossless);
        header.size.upscaled_width = 16;
        header.derive_lossless();
        assert!(header.coded_lossless && !header.all_lossless);
        header.segmentation.feature_data[2][SEG_LVL_ALT_Q] = 1;
        header.derive_lossless();
        assert!(!header.coded_lossless);
        assert_eq!(header.lossless_array[1..3], [true, false]);
    }
}
