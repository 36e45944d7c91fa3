//! The numbers of a block, in libaom's conventions.

use av1_motion::{Block, Frame};

/// A value if a condition holds, else libaom's neutral one.
fn only(condition: bool, value: impl Into<i64>, neutral: i64) -> i64 {
    if condition { value.into() } else { neutral }
}

/// libaom's number of a compound type: average, distance, wedge, diffwtd.
fn compound_type(block: &Block) -> i64 {
    [2, 3, 0, -1, 1][usize::from(block.compound_type)]
}

/// The numbers of one block, in the order of `CELL_COLUMNS` and in libaom's conventions.
fn block_values(block: &Block) -> Vec<i64> {
    let is_inter = block.is_inter && !block.use_intrabc;
    let is_compound = block.ref_frame[1] > 0;
    let is_interintra = is_inter && block.ref_frame[1] == 0;
    let is_warped = block.motion_mode == 2;
    let is_near = matches!(block.y_mode, 14 | 18 | 21 | 22);
    let uv_mode = only(block.has_chroma, block.uv_mode, 0);
    let mask = match compound_type(block) {
        2 => i64::from(block.wedge_index) + 16 * i64::from(block.wedge_sign),
        3 => i64::from(block.mask_type),
        _ => -1,
    };
    let has_cfl = block.uv_mode == 13;
    let mut values: Vec<i64> = vec![
        block.mi_row.into(),
        block.mi_col.into(),
        block.size.into(),
        block.partition.into(),
        is_inter.into(),
        block.use_intrabc.into(),
        block.y_mode.into(),
        only(!is_inter, uv_mode, -1),
    ];
    values.extend(
        block
            .mv
            .iter()
            .flat_map(|mv| [i64::from(mv.row), i64::from(mv.col)]),
    );
    values.extend(block.ref_frame.map(i64::from));
    values.extend([
        block.skip.into(),
        block.skip_mode.into(),
        block.motion_mode.into(),
        only(is_warped, block.num_samples, 0),
        i64::from(is_warped && !block.has_local_warp()),
        only(is_interintra, block.interintra_mode, -1),
        only(
            is_interintra && block.wedge_interintra,
            block.wedge_index,
            -1,
        ),
        only(is_compound, compound_type(block), -1),
        only(is_compound, mask, -1),
        block.comp_group_idx.into(),
        only(is_compound, block.compound_idx, 0),
        i64::from(block.ref_mv_idx) - i64::from(is_near),
        only(is_inter, block.interp_filter[0], -1),
        only(is_inter, block.interp_filter[1], -1),
        block.segment_id.into(),
        block.q_index.into(),
    ]);
    values.extend(block.delta_lf.map(i64::from));
    values.extend([
        block.palette_size[0].into(),
        block.palette_size[1].into(),
        only(block.use_filter_intra, block.filter_intra_mode, -1),
        block.angle_delta[0].into(),
        block.angle_delta[1].into(),
        only(has_cfl, block.cfl_alpha_signs, -1),
        block.cfl_alpha.cast_signed().into(),
    ]);
    values
}

/// Everything of a frame's blocks, its references and its coefficients.
pub(crate) fn values(frame: &Frame) -> Vec<i64> {
    let mut blocks: Vec<&Block> = frame.blocks().iter().collect();
    blocks.sort_by_key(|block| (block.mi_row, block.mi_col));
    let references = frame
        .references
        .map(|reference| reference.map_or(-1, |reference| reference.decode_index.cast_signed()));
    let stats = frame.coefficient_stats().iter().flat_map(|plane| {
        [
            plane.coded_blocks,
            plane.zero_blocks,
            plane.end_of_block,
            plane.level,
            plane.negative,
        ]
        .map(u64::cast_signed)
    });
    blocks
        .iter()
        .flat_map(|block| block_values(block))
        .chain(references)
        .chain(stats)
        .collect()
}
