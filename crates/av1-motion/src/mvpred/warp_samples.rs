//! §7.10.4 Find warp samples process.

use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{LEAST_SQUARES_SAMPLES_MAX, NONE};
use crate::tile::{Block, BlockContext, TileDecoder};

/// §7.10.4 `CandList`: positions in the current frame and in the reference, in 1/8 luma samples.
pub(crate) struct WarpSamples {
    /// `[ row, col, row in the reference, col in the reference ]`.
    candidates: [[i32; 4]; LEAST_SQUARES_SAMPLES_MAX],
    /// `NumSamples`.
    num_valid: usize,
    /// `NumSamplesScanned`.
    num_scanned: usize,
}

impl WarpSamples {
    pub(crate) fn len(&self) -> usize {
        // When no vector is close enough, the first one counts all the same.
        if self.num_valid == 0 {
            self.num_scanned.min(1)
        } else {
            self.num_valid
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.num_scanned == 0
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &[i32; 4]> {
        self.candidates[..self.len()].iter()
    }
}

impl TileDecoder<'_> {
    /// §7.10.4.1 `find_warp_samples`.
    pub(crate) fn find_warp_samples(&self, block: &Block, context: &BlockContext) -> WarpSamples {
        let mut samples = WarpSamples {
            candidates: [[0; 4]; LEAST_SQUARES_SAMPLES_MAX],
            num_valid: 0,
            num_scanned: 0,
        };
        let (width4, height4) = (block.width4() as u32, block.height4() as u32);
        let (mi_row, mi_col) = (block.mi_row, block.mi_col);
        let size = &self.frame.header.size;
        let (mut do_top_left, mut do_top_right) = (true, true);
        if let Some(above) = &context.above {
            let source = above.width4() as u32;
            if width4 <= source {
                let offset = mi_col & (source - 1);
                do_top_left &= offset == 0;
                do_top_right &= source - offset <= width4;
                self.add_sample(&mut samples, block, -1, 0);
            } else {
                let mut i = 0;
                while i < width4.min(size.mi_cols - mi_col) {
                    let source = self.block_at(mi_row - 1, mi_col + i).width4() as u32;
                    self.add_sample(&mut samples, block, -1, i as i32);
                    i += width4.min(source);
                }
            }
        }
        if let Some(left) = &context.left {
            let source = left.height4() as u32;
            if height4 <= source {
                do_top_left &= mi_row & (source - 1) == 0;
                self.add_sample(&mut samples, block, 0, -1);
            } else {
                let mut i = 0;
                while i < height4.min(size.mi_rows - mi_row) {
                    let source = self.block_at(mi_row + i, mi_col - 1).height4() as u32;
                    self.add_sample(&mut samples, block, i as i32, -1);
                    i += height4.min(source);
                }
            }
        }
        if do_top_left {
            self.add_sample(&mut samples, block, -1, -1);
        }
        if do_top_right && width4.max(height4) <= 16 {
            self.add_sample(&mut samples, block, -1, width4 as i32);
        }
        samples
    }

    /// §7.10.4.2 Add sample process.
    fn add_sample(&self, samples: &mut WarpSamples, block: &Block, delta_row: i32, delta_col: i32) {
        if samples.num_scanned >= LEAST_SQUARES_SAMPLES_MAX {
            return;
        }
        let (row, col) = (
            block.mi_row as i32 + delta_row,
            block.mi_col as i32 + delta_col,
        );
        if !self.bounds.contains(row, col) || !self.grid.is_decoded(row as u32, col as u32) {
            return;
        }
        let candidate = self.block_at(row as u32, col as u32);
        if candidate.ref_frame != [block.ref_frame[0], NONE] {
            return;
        }
        let mid_y = candidate.mi_row as i32 * 4 + candidate.height4() as i32 * 2 - 1;
        let mid_x = candidate.mi_col as i32 * 4 + candidate.width4() as i32 * 2 - 1;
        let size = block.size as usize;
        let threshold = i32::from(BLOCK_WIDTH[size].max(BLOCK_HEIGHT[size])).clamp(16, 112);
        let (mv_row, mv_col) = (
            i32::from(candidate.mv[0].row),
            i32::from(candidate.mv[0].col),
        );
        let difference = (mv_row - i32::from(block.mv[0].row)).abs()
            + (mv_col - i32::from(block.mv[0].col)).abs();
        let is_valid = difference <= threshold;
        samples.num_scanned += 1;
        if !is_valid && samples.num_scanned > 1 {
            return;
        }
        samples.candidates[samples.num_valid] =
            [mid_y * 8, mid_x * 8, mid_y * 8 + mv_row, mid_x * 8 + mv_col];
        samples.num_valid += usize::from(is_valid);
    }
}
