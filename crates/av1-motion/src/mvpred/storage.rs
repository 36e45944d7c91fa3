//! §7.19 Motion field motion vector storage process.

use std::sync::Arc;

use crate::memory::{OutOfMemory, filled, shared};
use crate::motion::MotionVector;
use crate::tables::symbols::{INTRA_FRAME, REFMVS_LIMIT};
use crate::tile::{Block, FrameContext};

/// `MfRefFrames` and `MfMvs` of 8x8 luma samples. The specification keeps a record for each 4x4, of
/// which only those in odd rows and columns are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SavedMotion {
    pub(crate) mv: MotionVector,
    /// Reference name of the saving frame; 0 when nothing is saved.
    pub(crate) ref_frame: i8,
}

/// Saved motion in bands of 64 luma rows, so that a later frame can start on a band as soon as it is
/// complete: projection never crosses bands (§7.9.4, `MAX_OFFSET_HEIGHT` is 0).
#[derive(Clone, Debug)]
pub(crate) struct SavedMotionBands {
    /// Records of each band in raster order, `cols` to a row.
    bands: Vec<Arc<Vec<SavedMotion>>>,
    cols: usize,
}

/// Rows of 8x8 luma samples in a band.
const BAND_ROWS: usize = 8;

impl SavedMotionBands {
    /// One row of records.
    pub(crate) fn row(&self, y8: usize) -> &[SavedMotion] {
        &self.bands[y8 / BAND_ROWS][y8 % BAND_ROWS * self.cols..][..self.cols]
    }
}

/// Collects the records of one frame, block by block.
pub(crate) struct SavedMotionBuilder {
    records: Vec<SavedMotion>,
    cols: usize,
    rows: usize,
}

impl SavedMotionBuilder {
    pub(crate) fn new(frame: &FrameContext) -> Result<Self, OutOfMemory> {
        let size = &frame.header.size;
        let (rows, cols) = (size.mi_rows as usize >> 1, size.mi_cols as usize >> 1);
        Ok(Self {
            records: filled(SavedMotion::default(), rows * cols)?,
            cols,
            rows,
        })
    }

    /// Saves the motion of a block in the 8x8 cells whose odd row and column it covers.
    pub(crate) fn store(&mut self, frame: &FrameContext, block: &Block) {
        let saved = saved_motion(frame, block);
        if saved.ref_frame == 0 {
            return;
        }
        // Cell y8 is read at row 2 * y8 + 1.
        let (row, col) = (block.mi_row as usize >> 1, block.mi_col as usize >> 1);
        let row_end = ((block.mi_row as usize + block.height4()) >> 1).min(self.rows);
        let col_end = ((block.mi_col as usize + block.width4()) >> 1).min(self.cols);
        for y8 in row..row_end {
            self.records[y8 * self.cols + col..y8 * self.cols + col_end.max(col)].fill(saved);
        }
    }

    pub(crate) fn finish(self) -> Result<SavedMotionBands, OutOfMemory> {
        let bands = self.records.chunks((BAND_ROWS * self.cols).max(1));
        Ok(SavedMotionBands {
            bands: bands.map(shared).collect::<Result<_, _>>()?,
            cols: self.cols,
        })
    }
}

/// §7.19: the last list whose reference precedes the frame and whose vector is short enough.
fn saved_motion(frame: &FrameContext, block: &Block) -> SavedMotion {
    let is_short = |mv: MotionVector| {
        i32::from(mv.row).abs() <= REFMVS_LIMIT && i32::from(mv.col).abs() <= REFMVS_LIMIT
    };
    (0..2)
        .rev()
        .find(|&list| {
            let reference = block.ref_frame[list];
            reference > INTRA_FRAME
                && frame.ref_is_past[reference as usize]
                && is_short(block.mv[list])
        })
        .map_or_else(SavedMotion::default, |list| SavedMotion {
            mv: block.mv[list],
            ref_frame: block.ref_frame[list],
        })
}
