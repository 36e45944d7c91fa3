//! §5.11.7 Intra frame mode info, §5.11.22 Intra block mode info, and what both share.

use super::{Block, BlockContext, TileDecoder, TileResult};
use crate::tables::block_size::{
    BLOCK_4X4, BLOCK_8X8, BLOCK_HEIGHT, BLOCK_WIDTH, SIZE_GROUP, SUBSAMPLED_SIZE,
};
use crate::tables::contexts::INTRA_MODE_CONTEXT;
use crate::tables::symbols::{
    BILINEAR, CFL_SIGN_ZERO, D67_PRED, DC_PRED, MAX_ANGLE_DELTA, UV_CFL_PRED, V_PRED,
};

impl TileDecoder<'_> {
    /// §5.11.7 `intra_frame_mode_info`.
    pub(super) fn intra_frame_mode_info(
        &mut self,
        block: &mut Block,
        context: &mut BlockContext,
    ) -> TileResult<()> {
        let header = &self.frame.header;
        let (pre_skip, allow_intrabc) = (header.segmentation.seg_id_pre_skip, header.allow_intrabc);
        if pre_skip {
            self.intra_segment_id(block, context)?;
        }
        self.read_skip(block, context);
        if !pre_skip {
            self.intra_segment_id(block, context)?;
        }
        context.lossless = self.frame.header.lossless_array[block.segment_id as usize];
        self.read_cdef(block);
        self.read_delta_qindex(block);
        self.read_delta_lf(block);
        self.read_deltas = false;
        block.use_intrabc = allow_intrabc && self.symbols.flag(&mut self.cdfs.intrabc);
        if block.use_intrabc {
            block.is_inter = true;
            block.y_mode = DC_PRED;
            block.uv_mode = DC_PRED;
            block.interp_filter = [BILINEAR; 2];
            let stack = self.find_mv_stack(block, context);
            return self.assign_mv(block, &stack);
        }
        let mode_context = |neighbor: &Option<Block>| {
            let mode = neighbor.as_ref().map_or(DC_PRED, |block| block.y_mode);
            INTRA_MODE_CONTEXT[mode as usize] as usize
        };
        let (above, left) = (mode_context(&context.above), mode_context(&context.left));
        block.y_mode = self
            .symbols
            .symbol(&mut self.cdfs.intra_frame_y_mode[above][left]);
        self.intra_mode_details(block, context);
        Ok(())
    }

    /// §5.11.22 `intra_block_mode_info`.
    pub(super) fn intra_block_mode_info(&mut self, block: &mut Block, context: &BlockContext) {
        let group = SIZE_GROUP[block.size as usize] as usize;
        block.y_mode = self.symbols.symbol(&mut self.cdfs.y_mode[group]);
        self.intra_mode_details(block, context);
    }

    /// §5.11.7, §5.11.22: everything after the luma mode.
    fn intra_mode_details(&mut self, block: &mut Block, context: &BlockContext) {
        block.angle_delta[0] = self.read_angle_delta(block.size, block.y_mode);
        if block.has_chroma {
            self.read_uv_mode(block, context);
        }
        let (width, height) = (
            BLOCK_WIDTH[block.size as usize],
            BLOCK_HEIGHT[block.size as usize],
        );
        if block.size >= BLOCK_8X8
            && width <= 64
            && height <= 64
            && self.frame.header.allow_screen_content_tools
        {
            self.palette_mode_info(block, context);
        }
        // §5.11.24 filter_intra_mode_info.
        if self.frame.sequence.enable_filter_intra
            && block.y_mode == DC_PRED
            && block.palette_size[0] == 0
            && width.max(height) <= 32
        {
            block.use_filter_intra = self
                .symbols
                .flag(&mut self.cdfs.filter_intra[block.size as usize]);
            if block.use_filter_intra {
                block.filter_intra_mode = self.symbols.symbol(&mut self.cdfs.filter_intra_mode);
            }
        }
    }

    /// §5.11.42, §5.11.43 `intra_angle_info_y`, `intra_angle_info_uv`.
    fn read_angle_delta(&mut self, size: u8, mode: u8) -> i8 {
        if size < BLOCK_8X8 || !(V_PRED..=D67_PRED).contains(&mode) {
            return 0;
        }
        let delta = self
            .symbols
            .symbol(&mut self.cdfs.angle_delta[(mode - V_PRED) as usize]);
        delta as i8 - MAX_ANGLE_DELTA as i8
    }

    /// §5.11.22 `uv_mode`, `read_cfl_alphas`, `intra_angle_info_uv`.
    fn read_uv_mode(&mut self, block: &mut Block, context: &BlockContext) {
        let size = block.size as usize;
        let color = &self.frame.sequence.color;
        let allows_cfl = if context.lossless {
            let (x, y) = (color.subsampling_x as usize, color.subsampling_y as usize);
            SUBSAMPLED_SIZE[size][x][y] == BLOCK_4X4
        } else {
            BLOCK_WIDTH[size].max(BLOCK_HEIGHT[size]) <= 32
        };
        let mode = block.y_mode as usize;
        block.uv_mode = if allows_cfl {
            self.symbols
                .symbol(&mut self.cdfs.uv_mode_cfl_allowed[mode])
        } else {
            self.symbols
                .symbol(&mut self.cdfs.uv_mode_cfl_not_allowed[mode])
        };
        if block.uv_mode == UV_CFL_PRED {
            self.read_cfl_alphas(block);
        }
        block.angle_delta[1] = self.read_angle_delta(block.size, block.uv_mode);
    }

    /// §5.11.45 `read_cfl_alphas`.
    fn read_cfl_alphas(&mut self, block: &mut Block) {
        let signs = self.symbols.symbol(&mut self.cdfs.cfl_sign);
        let (sign_u, sign_v) = ((signs + 1) / 3, (signs + 1) % 3);
        let mut alpha = |sign: u8, other: u8| {
            if sign == CFL_SIGN_ZERO {
                return 0;
            }
            let context = (sign - 1) * 3 + other;
            self.symbols
                .symbol(&mut self.cdfs.cfl_alpha[context as usize])
        };
        let alpha_u = alpha(sign_u, sign_v);
        let alpha_v = alpha(sign_v, sign_u);
        block.cfl_alpha_signs = signs;
        block.cfl_alpha = alpha_u * 16 + alpha_v;
    }
}
