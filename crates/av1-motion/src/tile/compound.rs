//! §5.11.29 Read compound type.

use super::{Block, BlockContext, TileDecoder};
use crate::tables::block_size::WEDGE_BITS;
use crate::tables::symbols::{
    ALTREF_FRAME, COMPOUND_AVERAGE, COMPOUND_DIFFWTD, COMPOUND_DISTANCE, COMPOUND_INTRA,
    COMPOUND_WEDGE,
};

impl TileDecoder<'_> {
    /// §5.11.29 `read_compound_type`.
    pub(super) fn read_compound_type(&mut self, block: &mut Block, context: &BlockContext) {
        block.compound_idx = 1;
        if block.skip_mode {
            return;
        }
        if !block.is_compound() {
            block.compound_type = match (block.is_interintra(), block.wedge_interintra) {
                (true, true) => COMPOUND_WEDGE,
                (true, false) => COMPOUND_INTRA,
                _ => COMPOUND_AVERAGE,
            };
            return;
        }
        let size = block.size as usize;
        if self.frame.sequence.enable_masked_compound {
            let cdf_context = comp_group_idx_context(context);
            let group = self
                .symbols
                .flag(&mut self.cdfs.comp_group_idx[cdf_context]);
            block.comp_group_idx = group.into();
        }
        if block.comp_group_idx == 0 {
            if self.frame.sequence.enable_jnt_comp {
                let cdf_context = self.compound_idx_context(block, context);
                let is_average = self.symbols.flag(&mut self.cdfs.compound_idx[cdf_context]);
                block.compound_idx = is_average.into();
                block.compound_type = if is_average {
                    COMPOUND_AVERAGE
                } else {
                    COMPOUND_DISTANCE
                };
            }
        } else if WEDGE_BITS[size] == 0 {
            block.compound_type = COMPOUND_DIFFWTD;
        } else {
            let is_difference = self.symbols.flag(&mut self.cdfs.compound_type[size]);
            block.compound_type = if is_difference {
                COMPOUND_DIFFWTD
            } else {
                COMPOUND_WEDGE
            };
        }
        if block.compound_type == COMPOUND_WEDGE {
            block.wedge_index = self.symbols.symbol(&mut self.cdfs.wedge_index[size]);
            block.wedge_sign = self.symbols.bit();
        } else if block.compound_type == COMPOUND_DIFFWTD {
            block.mask_type = self.symbols.bit();
        }
    }

    /// §8.3.2: the context of `compound_idx`.
    fn compound_idx_context(&self, block: &Block, context: &BlockContext) -> usize {
        let distance = |list: usize| self.frame.ref_distance[block.ref_frame[list] as usize].abs();
        let base = if distance(0) == distance(1) { 3 } else { 0 };
        let share = |neighbor: &Block| {
            if neighbor.is_single() {
                usize::from(neighbor.ref_frame[0] == ALTREF_FRAME)
            } else {
                usize::from(neighbor.compound_idx)
            }
        };
        base + context.above.as_ref().map_or(0, share) + context.left.as_ref().map_or(0, share)
    }
}

/// §8.3.2: the context of `comp_group_idx`.
fn comp_group_idx_context(context: &BlockContext) -> usize {
    let share = |neighbor: &Block| {
        if !neighbor.is_single() {
            usize::from(neighbor.comp_group_idx)
        } else if neighbor.ref_frame[0] == ALTREF_FRAME {
            3
        } else {
            0
        }
    };
    let sum = context.above.as_ref().map_or(0, share) + context.left.as_ref().map_or(0, share);
    sum.min(5)
}
