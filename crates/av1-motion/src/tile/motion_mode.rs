//! §5.11.27 Read motion mode, §5.11.28 Read inter intra.

use super::{Block, BlockContext, NO_WARP, TileDecoder};
use crate::mvpred::warp_samples::WarpSamples;
use crate::tables::block_size::{BLOCK_8X8, BLOCK_32X32, BLOCK_HEIGHT, BLOCK_WIDTH, SIZE_GROUP};
use crate::tables::symbols::{
    GLOBAL_GLOBALMV, GLOBALMV, INTRA_FRAME, LOCALWARP, OBMC, SIMPLE, TRANSLATION,
};
use crate::warp::{estimate_local_warp, is_shear_valid};

impl TileDecoder<'_> {
    /// §5.11.28 `read_interintra_mode`.
    pub(super) fn read_interintra_mode(&mut self, block: &mut Block) {
        if block.skip_mode
            || !self.frame.sequence.enable_interintra_compound
            || block.is_compound()
            || !(BLOCK_8X8..=BLOCK_32X32).contains(&block.size)
        {
            return;
        }
        let (symbols, cdfs) = (&mut self.symbols, &mut *self.cdfs);
        let group = SIZE_GROUP[block.size as usize] as usize - 1;
        if !symbols.flag(&mut cdfs.interintra[group]) {
            return;
        }
        block.interintra_mode = symbols.symbol(&mut cdfs.interintra_mode[group]);
        block.ref_frame[1] = INTRA_FRAME;
        block.wedge_interintra = symbols.flag(&mut cdfs.wedge_interintra[block.size as usize]);
        if block.wedge_interintra {
            block.wedge_index = symbols.symbol(&mut cdfs.wedge_index[block.size as usize]);
        }
    }

    /// §5.11.27 `read_motion_mode`.
    pub(super) fn read_motion_mode(&mut self, block: &mut Block, context: &BlockContext) {
        let header = &self.frame.header;
        let size = block.size as usize;
        let reference = block.ref_frame[0] as usize;
        let is_global = !header.force_integer_mv
            && matches!(block.y_mode, GLOBALMV | GLOBAL_GLOBALMV)
            && header.gm_type[reference] > TRANSLATION;
        if block.skip_mode
            || !header.is_motion_mode_switchable
            || BLOCK_WIDTH[size].min(BLOCK_HEIGHT[size]) < 8
            || is_global
            || block.ref_frame[1] >= INTRA_FRAME
            || !self.has_overlappable_candidates(block, context)
        {
            return;
        }
        let samples = self.find_warp_samples(block, context);
        block.num_samples = samples.len() as u8;
        block.motion_mode = if header.force_integer_mv
            || samples.is_empty()
            || !header.allow_warped_motion
            || self.frame.is_scaled[reference]
        {
            let is_obmc = self.symbols.flag(&mut self.cdfs.use_obmc[size]);
            if is_obmc { OBMC } else { SIMPLE }
        } else {
            self.symbols.symbol(&mut self.cdfs.motion_mode[size])
        };
        if block.motion_mode == LOCALWARP {
            block.warp = self.keep_local_warp(block, &samples);
        }
    }

    /// §7.11.3.1, steps 2 and 3: the local model, kept when it is usable for prediction.
    fn keep_local_warp(&mut self, block: &Block, samples: &WarpSamples) -> u32 {
        match estimate_local_warp(block, samples) {
            Some(params) if is_shear_valid(&params) => {
                self.warps.push(params);
                self.warps.len() as u32 - 1
            }
            _ => NO_WARP,
        }
    }
}
