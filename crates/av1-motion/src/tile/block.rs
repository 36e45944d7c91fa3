//! §5.11.5 Decode block: the order in which the parts of a block are read, and the record that is kept.

use super::{BlockContext, TileDecoder, TileResult};
use crate::motion::MotionVector;
use crate::tables::block_size::{NUM_4X4_BLOCKS_HIGH, NUM_4X4_BLOCKS_WIDE};

/// What is kept of a coded block, for its neighbours and for the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "syntax elements, one to one")]
pub struct Block {
    /// Row of the upper left corner, in units of 4 luma samples.
    pub mi_row: u32,
    /// Column of the upper left corner, in units of 4 luma samples of the coded frame.
    pub mi_col: u32,
    /// `MiSize`, from 0 for 4x4 to 21 for 64x16 (§6.10.4).
    pub size: u8,
    /// `partition` of the node that the block belongs to.
    pub partition: u8,
    /// The block is predicted from other frames, or from this one (`use_intrabc`).
    pub is_inter: bool,
    /// Intra block copy: `mv[0]` points into the same frame. That is no motion.
    pub use_intrabc: bool,
    /// No coefficients are coded.
    pub skip: bool,
    /// The block repeats the nearest compound prediction without further syntax.
    pub skip_mode: bool,
    /// The block carries the chroma of its place; of small blocks only the last does.
    pub has_chroma: bool,
    /// Segment, 0 to 7.
    pub segment_id: u8,
    /// `YMode`, in the specification's numbering.
    pub y_mode: u8,
    /// `UVMode`; 255 when the block has none.
    pub uv_mode: u8,
    /// `RefFrame`: -1 none, 0 intra, 1..=7 LAST..ALTREF.
    pub ref_frame: [i8; 2],
    /// Vectors to `ref_frame`; zero where there is no reference.
    pub mv: [MotionVector; 2],
    /// 0 simple, 1 overlapped, 2 local warp.
    pub motion_mode: u8,
    /// `interintra_mode`, when `RefFrame[1]` is `INTRA_FRAME`.
    pub interintra_mode: u8,
    /// `wedge_interintra`: the two predictions are blended along a wedge.
    pub wedge_interintra: bool,
    /// `wedge_index`, the shape of the wedge.
    pub wedge_index: u8,
    /// `wedge_sign`, which side the first prediction is on.
    pub wedge_sign: bool,
    /// `mask_type` of a difference-weighted compound.
    pub mask_type: bool,
    /// `compound_type`: 0 wedge, 1 difference, 2 average, 3 intra, 4 distance.
    pub compound_type: u8,
    /// `comp_group_idx`.
    pub comp_group_idx: u8,
    /// `compound_idx`: 0 when the average is weighted by distance.
    pub compound_idx: u8,
    /// `RefMvIdx`: which candidate predicts the vector.
    pub ref_mv_idx: u8,
    /// `interp_filter`, vertical then horizontal.
    pub interp_filter: [u8; 2],
    /// `PaletteSizeY`, `PaletteSizeUV`.
    pub palette_size: [u8; 2],
    /// `use_filter_intra`.
    pub use_filter_intra: bool,
    /// `filter_intra_mode`.
    pub filter_intra_mode: u8,
    /// `AngleDeltaY`, `AngleDeltaUV`.
    pub angle_delta: [i8; 2],
    /// `cfl_alpha_signs`.
    pub cfl_alpha_signs: u8,
    /// `cfl_alpha_u * 16 + cfl_alpha_v`.
    pub cfl_alpha: u8,
    /// `TxSize`.
    pub tx_size: u8,
    /// `CurrentQIndex`.
    pub q_index: u8,
    /// `DeltaLF`: offsets of the loop filter levels.
    pub delta_lf: [i8; 4],
    /// `NumSamples` of §7.10.4.
    pub num_samples: u8,
    /// Index into the frame's local warp models; [`NO_WARP`] without a valid one.
    pub(crate) warp: u32,
    /// Sum of `eob` over the luma, then the chroma transform blocks.
    pub coefficients: [u16; 2],
    /// Sum of absolute quantised luma levels.
    pub luma_level: u32,
}

/// `uv_mode` of a block without chroma mode.
pub(crate) const NO_CHROMA_MODE: u8 = 255;
/// `warp` of a block without a valid local model.
pub(crate) const NO_WARP: u32 = u32::MAX;

impl Block {
    /// A block at its place, before anything is read.
    fn new(mi_row: u32, mi_col: u32, size: u8, partition: u8) -> Self {
        Self {
            mi_row,
            mi_col,
            size,
            partition,
            is_inter: false,
            use_intrabc: false,
            skip: false,
            skip_mode: false,
            has_chroma: false,
            segment_id: 0,
            y_mode: 0,
            uv_mode: NO_CHROMA_MODE,
            ref_frame: [0, -1],
            mv: [MotionVector::ZERO; 2],
            motion_mode: 0,
            interintra_mode: 0,
            wedge_interintra: false,
            wedge_index: 0,
            wedge_sign: false,
            mask_type: false,
            compound_type: crate::tables::symbols::COMPOUND_AVERAGE,
            comp_group_idx: 0,
            compound_idx: 0,
            ref_mv_idx: 0,
            interp_filter: [0; 2],
            palette_size: [0; 2],
            use_filter_intra: false,
            filter_intra_mode: 0,
            angle_delta: [0; 2],
            cfl_alpha_signs: 0,
            cfl_alpha: 0,
            tx_size: 0,
            q_index: 0,
            delta_lf: [0; 4],
            num_samples: 0,
            warp: NO_WARP,
            coefficients: [0; 2],
            luma_level: 0,
        }
    }

    /// Whether two references are averaged: `RefFrame[1] > INTRA_FRAME`.
    #[inline]
    pub(crate) fn is_compound(&self) -> bool {
        self.ref_frame[1] > 0
    }

    /// Whether inter prediction is blended with intra prediction.
    #[inline]
    pub(crate) fn is_interintra(&self) -> bool {
        self.is_inter && self.ref_frame[1] == 0
    }

    /// `LeftIntra`, `AboveIntra`: intra block copy counts as intra.
    #[inline]
    pub(crate) fn is_intra_reference(&self) -> bool {
        self.ref_frame[0] <= 0
    }

    /// `LeftSingle`, `AboveSingle`.
    #[inline]
    pub(crate) fn is_single(&self) -> bool {
        self.ref_frame[1] <= 0
    }

    /// Whether a valid local affine model predicts the block.
    #[must_use]
    pub fn has_local_warp(&self) -> bool {
        self.warp != NO_WARP
    }

    /// Moves the index of the local model from the tile's list to the frame's.
    pub(crate) fn offset_warp(&mut self, offset: u32) {
        if self.warp != NO_WARP {
            self.warp += offset;
        }
    }

    /// Block width in units of 4 luma samples.
    #[inline]
    pub(crate) fn width4(&self) -> usize {
        NUM_4X4_BLOCKS_WIDE[self.size as usize] as usize
    }

    /// Block height in units of 4 luma samples.
    #[inline]
    pub(crate) fn height4(&self) -> usize {
        NUM_4X4_BLOCKS_HIGH[self.size as usize] as usize
    }
}

impl TileDecoder<'_> {
    /// §5.11.5 `decode_block`.
    pub(super) fn decode_block(
        &mut self,
        mi_row: u32,
        mi_col: u32,
        size: u8,
        partition: u8,
    ) -> TileResult<()> {
        let mut block = Block::new(mi_row, mi_col, size, partition);
        let mut context = self.block_context(&mut block);
        if self.frame.header.frame_is_intra {
            self.intra_frame_mode_info(&mut block, &mut context)?;
        } else {
            self.inter_frame_mode_info(&mut block, &mut context)?;
        }
        block.q_index = self.current_q_index;
        block.delta_lf = self.delta_lf;
        self.palette_tokens(&block);
        self.grid.place(self.blocks.len() as u32, &block);
        self.read_block_tx_size(&mut block, &context);
        if block.skip {
            self.reset_block_context(&block);
        } else {
            self.residual(&mut block, &context)?;
        }
        self.blocks.push(block);
        Ok(())
    }

    /// Availability of the neighbours, and copies of the two that most contexts look at.
    fn block_context(&self, block: &mut Block) -> BlockContext {
        let Block { mi_row, mi_col, .. } = *block;
        let color = &self.frame.sequence.color;
        let no_chroma_row = block.height4() == 1 && color.subsampling_y == 1 && mi_row & 1 == 0;
        let no_chroma_col = block.width4() == 1 && color.subsampling_x == 1 && mi_col & 1 == 0;
        block.has_chroma = color.num_planes > 1 && !no_chroma_row && !no_chroma_col;
        BlockContext {
            above: (mi_row > self.bounds.mi_row_start)
                .then(|| self.blocks[self.grid.index(mi_row - 1, mi_col) as usize]),
            left: (mi_col > self.bounds.mi_col_start)
                .then(|| self.blocks[self.grid.index(mi_row, mi_col - 1) as usize]),
            lossless: false,
        }
    }

    /// §5.11.5 `reset_block_context`.
    fn reset_block_context(&mut self, block: &Block) {
        let color = &self.frame.sequence.color;
        let planes = if block.has_chroma { 3 } else { 1 };
        for plane in 0..planes {
            let (x, y) = if plane > 0 {
                (color.subsampling_x, color.subsampling_y)
            } else {
                (0, 0)
            };
            let col = self.bounds.col(block.mi_col) >> x;
            let row = (block.mi_row as usize & 31) >> y;
            let width = block.width4().div_ceil(1 << x);
            let height = block.height4().div_ceil(1 << y);
            self.above.coefficients[plane][col..col + width].fill(0);
            self.left.coefficients[plane][row..row + height].fill(0);
        }
    }
}
