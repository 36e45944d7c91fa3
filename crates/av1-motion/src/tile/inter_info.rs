//! §5.11.18 Inter frame mode info, §5.11.23 Inter block mode info.

use super::segment_id::count;
use super::{Block, BlockContext, TileDecoder, TileResult};
use crate::mvpred::MvStack;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::contexts::COMPOUND_MODE_CTX_MAP;
use crate::tables::symbols::{
    COMP_NEWMV_CTXS, EIGHTTAP, GLOBAL_GLOBALMV, GLOBALMV, INTRA_FRAME, LOCALWARP, NEAR_NEARMV,
    NEAR_NEWMV, NEAREST_NEARESTMV, NEARESTMV, NEARMV, NEW_NEARMV, NEW_NEWMV, NEWMV,
    SEG_LVL_GLOBALMV, SEG_LVL_REF_FRAME, SEG_LVL_SKIP, SWITCHABLE, TRANSLATION,
};

impl TileDecoder<'_> {
    /// §5.11.18 `inter_frame_mode_info`.
    pub(super) fn inter_frame_mode_info(
        &mut self,
        block: &mut Block,
        context: &mut BlockContext,
    ) -> TileResult<()> {
        self.inter_segment_id(block, context, true)?;
        self.read_skip_mode(block, context);
        if block.skip_mode {
            block.skip = true;
        } else {
            self.read_skip(block, context);
        }
        if !self.frame.header.segmentation.seg_id_pre_skip {
            self.inter_segment_id(block, context, false)?;
        }
        context.lossless = self.frame.header.lossless_array[block.segment_id as usize];
        self.read_cdef(block);
        self.read_delta_qindex(block);
        self.read_delta_lf(block);
        self.read_deltas = false;
        block.is_inter = self.read_is_inter(block, context);
        if block.is_inter {
            self.inter_block_mode_info(block, context)
        } else {
            self.intra_block_mode_info(block, context);
            Ok(())
        }
    }

    /// §5.11.20 `read_is_inter`.
    fn read_is_inter(&mut self, block: &Block, context: &BlockContext) -> bool {
        let segmentation = &self.frame.header.segmentation;
        if block.skip_mode {
            return true;
        }
        if segmentation.feature_active(block.segment_id, SEG_LVL_REF_FRAME) {
            let reference = segmentation.feature_data[block.segment_id as usize][SEG_LVL_REF_FRAME];
            return reference != i16::from(INTRA_FRAME);
        }
        if segmentation.feature_active(block.segment_id, SEG_LVL_GLOBALMV) {
            return true;
        }
        let num_intra = count(context, Block::is_intra_reference);
        let cdf_context = match (&context.above, &context.left) {
            (Some(_), Some(_)) => {
                if num_intra == 2 {
                    3
                } else {
                    num_intra
                }
            }
            (None, None) => 0,
            _ => 2 * num_intra,
        };
        self.symbols.flag(&mut self.cdfs.is_inter[cdf_context])
    }

    /// §5.11.23 `inter_block_mode_info`.
    fn inter_block_mode_info(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
    ) -> TileResult<()> {
        self.read_ref_frames(block, context);
        let stack = self.find_mv_stack(block, context);
        block.y_mode = self.read_inter_mode(block, &stack);
        self.read_ref_mv_idx(block, &stack);
        self.assign_mv(block, &stack)?;
        self.read_interintra_mode(block);
        self.read_motion_mode(block, context);
        self.read_compound_type(block, context);
        self.read_interp_filters(block, context);
        Ok(())
    }

    /// §5.11.23: `YMode` of an inter block.
    fn read_inter_mode(&mut self, block: &Block, stack: &MvStack) -> u8 {
        let segmentation = &self.frame.header.segmentation;
        if block.skip_mode {
            return NEAREST_NEARESTMV;
        }
        if segmentation.feature_active(block.segment_id, SEG_LVL_SKIP)
            || segmentation.feature_active(block.segment_id, SEG_LVL_GLOBALMV)
        {
            return GLOBALMV;
        }
        if block.is_compound() {
            let new_mv = stack.new_mv_context.min(COMP_NEWMV_CTXS - 1);
            let cdf_context = COMPOUND_MODE_CTX_MAP[stack.ref_mv_context >> 1][new_mv];
            return NEAREST_NEARESTMV
                + self
                    .symbols
                    .symbol(&mut self.cdfs.compound_mode[cdf_context as usize]);
        }
        if !self
            .symbols
            .flag(&mut self.cdfs.new_mv[stack.new_mv_context])
        {
            NEWMV
        } else if !self
            .symbols
            .flag(&mut self.cdfs.zero_mv[stack.zero_mv_context])
        {
            GLOBALMV
        } else if self
            .symbols
            .flag(&mut self.cdfs.ref_mv[stack.ref_mv_context])
        {
            NEARMV
        } else {
            NEARESTMV
        }
    }

    /// §5.11.23: `RefMvIdx`.
    fn read_ref_mv_idx(&mut self, block: &mut Block, stack: &MvStack) {
        let first = match block.y_mode {
            NEWMV | NEW_NEWMV => 0,
            NEARMV | NEAR_NEARMV | NEAR_NEWMV | NEW_NEARMV => 1,
            _ => return,
        };
        block.ref_mv_idx = first;
        for idx in first..first + 2 {
            if stack.num_found > usize::from(idx) + 1 {
                let cdf_context = stack.drl_context(idx.into());
                if !self.symbols.flag(&mut self.cdfs.drl_mode[cdf_context]) {
                    block.ref_mv_idx = idx;
                    break;
                }
                block.ref_mv_idx = idx + 1;
            }
        }
    }

    /// §5.11.23: `interp_filter`.
    fn read_interp_filters(&mut self, block: &mut Block, context: &BlockContext) {
        let frame_filter = self.frame.header.interpolation_filter;
        if frame_filter != SWITCHABLE {
            block.interp_filter = [frame_filter; 2];
            return;
        }
        if !self.needs_interp_filter(block) {
            block.interp_filter = [EIGHTTAP; 2];
            return;
        }
        let is_dual = self.frame.sequence.enable_dual_filter;
        for dir in 0..if is_dual { 2 } else { 1 } {
            let cdf_context = interp_filter_context(block, context, dir);
            block.interp_filter[dir] = self
                .symbols
                .symbol(&mut self.cdfs.interp_filter[cdf_context]);
        }
        if !is_dual {
            block.interp_filter[1] = block.interp_filter[0];
        }
    }

    /// §5.11.23 `needs_interp_filter`.
    fn needs_interp_filter(&self, block: &Block) -> bool {
        let size = block.size as usize;
        let is_large = BLOCK_WIDTH[size].min(BLOCK_HEIGHT[size]) >= 8;
        let is_translation =
            |list: usize| self.frame.header.gm_type[block.ref_frame[list] as usize] == TRANSLATION;
        if block.skip_mode || block.motion_mode == LOCALWARP {
            false
        } else if is_large && block.y_mode == GLOBALMV {
            is_translation(0)
        } else if is_large && block.y_mode == GLOBAL_GLOBALMV {
            is_translation(0) || is_translation(1)
        } else {
            true
        }
    }
}

/// §8.3.2: the context of `interp_filter[ dir ]`.
fn interp_filter_context(block: &Block, context: &BlockContext, dir: usize) -> usize {
    const NO_TYPE: u8 = 3;
    let neighbor_type = |neighbor: &Option<Block>| match neighbor {
        Some(neighbor) if neighbor.ref_frame.contains(&block.ref_frame[0]) => {
            neighbor.interp_filter[dir]
        }
        _ => NO_TYPE,
    };
    let (left, above) = (neighbor_type(&context.left), neighbor_type(&context.above));
    let base = ((dir & 1) * 2 + usize::from(block.is_compound())) * 4;
    let kind = if left == above || above == NO_TYPE {
        left
    } else if left == NO_TYPE {
        above
    } else {
        NO_TYPE
    };
    base + usize::from(kind)
}
