//! §7.10.3 Has overlappable candidates process.

use crate::tile::{Block, BlockContext, TileDecoder};

impl TileDecoder<'_> {
    /// §7.10.3 `has_overlappable_candidates`.
    pub(crate) fn has_overlappable_candidates(
        &self,
        block: &Block,
        context: &BlockContext,
    ) -> bool {
        let (mi_row, mi_col) = (block.mi_row, block.mi_col);
        let size = &self.frame.header.size;
        let col_end = size.mi_cols.min(mi_col + block.width4() as u32);
        let row_end = size.mi_rows.min(mi_row + block.height4() as u32);
        let is_inter = |row, col| self.block_at(row, col).ref_frame[0] > 0;
        (context.above.is_some()
            && (mi_col..col_end)
                .step_by(2)
                .any(|col| is_inter(mi_row - 1, col | 1)))
            || (context.left.is_some()
                && (mi_row..row_end)
                    .step_by(2)
                    .any(|row| is_inter(row | 1, mi_col - 1)))
    }
}
