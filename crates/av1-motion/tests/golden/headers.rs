//! The facts of a frame's headers, in libaom's conventions.

use av1_motion::{Frame, FrameInfo, SequenceInfo};

/// Where the frame lies, what it shows and how large it is.
fn identity(frame: &Frame, info: &FrameInfo) -> Vec<i64> {
    vec![
        frame.unit_index.cast_signed(),
        frame.temporal_id.into(),
        frame.spatial_id.into(),
        info.frame_type.into(),
        info.show_frame.into(),
        info.showable_frame.into(),
        info.upscaled_width.into(),
        info.frame_width.into(),
        info.frame_height.into(),
        info.render_width.into(),
        info.render_height.into(),
        info.superres_denom.into(),
        info.mi_rows.into(),
        info.mi_cols.into(),
        info.base_q_idx.into(),
        info.refresh_frame_flags.into(),
        info.primary_ref_frame.into(),
        info.error_resilient_mode.into(),
        info.disable_cdf_update.into(),
        info.allow_screen_content_tools.into(),
        info.allow_intrabc.into(),
    ]
}

/// How blocks are predicted; libaom has zeros for what intra frames do not code.
fn prediction(info: &FrameInfo, is_inter: bool) -> Vec<i64> {
    let inter = |value: u8| if is_inter { i64::from(value) } else { 0 };
    vec![
        inter(info.allow_high_precision_mv.into()),
        inter(info.interpolation_filter),
        inter(info.is_motion_mode_switchable.into()),
        inter(info.use_ref_frame_mvs.into()),
        2 * i64::from(info.reference_select),
        info.skip_mode_present.into(),
        i64::from(info.skip_mode_frame[0]) - 1,
        i64::from(info.skip_mode_frame[1]) - 1,
        inter(info.allow_warped_motion.into()),
        info.reduced_tx_set.into(),
        info.tx_mode.into(),
        i64::from(!info.disable_frame_end_update_cdf),
    ]
}

/// Quantiser, segments, tiles and filters.
fn coding(info: &FrameInfo, sequence: &SequenceInfo) -> Vec<i64> {
    vec![
        info.coded_lossless.into(),
        info.delta_q_present.into(),
        1 << info.delta_q_res,
        info.delta_lf_present.into(),
        info.delta_lf_multi.into(),
        info.segmentation_enabled.into(),
        info.segmentation_update_map.into(),
        info.segmentation_temporal_update.into(),
        info.seg_id_pre_skip.into(),
        info.using_qmatrix.into(),
        info.tile_cols.into(),
        info.tile_rows.into(),
        info.uniform_tile_spacing.into(),
        info.context_update_tile_id.into(),
        if sequence.use_128x128_superblock {
            32
        } else {
            16
        },
        info.apply_grain.into(),
        info.cdef_bits.into(),
        info.frame_restoration_type[0].into(),
        info.frame_restoration_type[1].into(),
        info.frame_restoration_type[2].into(),
        info.current_frame_id.into(),
    ]
}

fn sequence(sequence: &SequenceInfo) -> Vec<i64> {
    vec![
        sequence.seq_profile.into(),
        sequence.bit_depth.into(),
        sequence.mono_chrome.into(),
        sequence.subsampling_x.into(),
        sequence.subsampling_y.into(),
        sequence.still_picture.into(),
        sequence.reduced_still_picture_header.into(),
        sequence.enable_order_hint.into(),
        sequence.order_hint_bits.into(),
        sequence.frame_id_numbers_present.into(),
        i64::try_from(sequence.operating_point_idc.len()).expect("at most 32"),
        sequence.film_grain_params_present.into(),
    ]
}

/// What the frame says of LAST to ALTREF; libaom has -1 or 0 in intra frames.
fn references(info: &FrameInfo, is_inter: bool) -> Vec<i64> {
    let named = |value: i64, neutral: i64| if is_inter { value } else { neutral };
    let mut values = Vec::new();
    values.extend(info.ref_frame_idx.map(|slot| named(slot.into(), -1)));
    values.extend(info.ref_order_hint.map(|hint| named(hint.into(), -1)));
    for (&width, &height) in info.ref_upscaled_width.iter().zip(&info.ref_frame_height) {
        values.extend([named(width.into(), -1), named(height.into(), -1)]);
    }
    values.extend(info.ref_sign_bias.map(i64::from));
    values.extend(info.gm_type.map(i64::from));
    values.extend(
        info.gm_params
            .iter()
            .flatten()
            .map(|&value| named(value.into(), 0)),
    );
    values.extend(info.is_gm_valid.map(|is_valid| i64::from(!is_valid)));
    values
}

/// Everything that the headers of a coded frame say, in the order of `HEADER_FIELDS`.
pub(crate) fn values(frame: &Frame) -> Vec<i64> {
    let (info, facts) = (frame.info(), frame.sequence_info());
    let is_inter = !frame.is_intra();
    [
        identity(frame, &info),
        prediction(&info, is_inter),
        coding(&info, &facts),
        sequence(&facts),
        references(&info, is_inter),
    ]
    .concat()
}
