//! §7.10.2.2 Scan row, §7.10.2.3 Scan col, §7.10.2.4 Scan point, §7.10.2.7 Add reference motion vector.

use super::global::lower_precision;
use super::stack::Search;
use crate::motion::MotionVector;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{
    GLOBAL_GLOBALMV, GLOBALMV, NEAR_NEWMV, NEAREST_NEWMV, NEW_NEARESTMV, NEW_NEARMV, NEW_NEWMV,
    NEWMV, TRANSLATION,
};
use crate::tile::Block;

impl Search<'_> {
    /// §7.10.2.2 Scan row process.
    pub(super) fn scan_row(&mut self, delta_row: i32) {
        let width4 = self.block.width4() as i32;
        let (mi_row, mi_col) = (self.block.mi_row as i32, self.block.mi_col as i32);
        let mi_cols = self.tile.frame.header.size.mi_cols as i32;
        let end4 = width4.min(mi_cols - mi_col).min(16);
        let is_far = delta_row < -1;
        let (row, first_col) = if is_far {
            (mi_row + delta_row + (mi_row & 1), mi_col + 1 - (mi_col & 1))
        } else {
            (mi_row + delta_row, mi_col)
        };
        // §7.10.2.2 tests the adjusted distance; rows -3 and -5 stay beyond -1 after it.
        let min_len = minimum_length(is_far, width4);
        let mut i = 0;
        while i < end4 {
            let Some(candidate) = self.candidate(row, first_col + i) else {
                break;
            };
            let len = width4.min(candidate.width4() as i32).max(min_len);
            self.add_ref_mv_candidate(candidate, len as u32 * 2);
            i += len;
        }
    }

    /// §7.10.2.3 Scan col process.
    pub(super) fn scan_col(&mut self, delta_col: i32) {
        let height4 = self.block.height4() as i32;
        let (mi_row, mi_col) = (self.block.mi_row as i32, self.block.mi_col as i32);
        let mi_rows = self.tile.frame.header.size.mi_rows as i32;
        let end4 = height4.min(mi_rows - mi_row).min(16);
        let is_far = delta_col < -1;
        let (first_row, col) = if is_far {
            (mi_row + 1 - (mi_row & 1), mi_col + delta_col + (mi_col & 1))
        } else {
            (mi_row, mi_col + delta_col)
        };
        let min_len = minimum_length(is_far, height4);
        let mut i = 0;
        while i < end4 {
            let Some(candidate) = self.candidate(first_row + i, col) else {
                break;
            };
            let len = height4.min(candidate.height4() as i32).max(min_len);
            self.add_ref_mv_candidate(candidate, len as u32 * 2);
            i += len;
        }
    }

    /// §7.10.2.4 Scan point process.
    pub(super) fn scan_point(&mut self, delta_row: i32, delta_col: i32) {
        let row = self.block.mi_row as i32 + delta_row;
        let col = self.block.mi_col as i32 + delta_col;
        if self.tile.bounds.contains(row, col) && self.tile.grid.is_decoded(row as u32, col as u32)
        {
            self.add_ref_mv_candidate(self.tile.block_at(row as u32, col as u32), 4);
        }
    }

    /// The block at a position inside the tile.
    #[inline]
    pub(super) fn candidate<'b>(&self, row: i32, col: i32) -> Option<&'b Block>
    where
        Self: 'b,
    {
        self.tile
            .bounds
            .contains(row, col)
            .then(|| self.tile.block_at(row as u32, col as u32))
    }

    /// §7.10.2.7 Add reference motion vector process.
    fn add_ref_mv_candidate(&mut self, candidate: &Block, weight: u32) {
        if !candidate.is_inter {
            return;
        }
        if self.is_compound {
            if candidate.ref_frame == self.block.ref_frame {
                self.compound_search_stack(candidate, weight);
            }
            return;
        }
        for list in 0..2 {
            if candidate.ref_frame[list] == self.block.ref_frame[0] {
                self.search_stack(candidate, list, weight);
            }
        }
    }

    /// §7.10.2.8 Search stack process.
    fn search_stack(&mut self, candidate: &Block, list: usize, weight: u32) {
        let header = &self.tile.frame.header;
        let size = candidate.size as usize;
        let is_global = matches!(candidate.y_mode, GLOBALMV | GLOBAL_GLOBALMV);
        let is_large = || BLOCK_WIDTH[size].min(BLOCK_HEIGHT[size]) >= 8;
        let mv = if is_global && is_large() && self.has_model(0) {
            self.stack.global_mvs[0]
        } else {
            candidate.mv[list]
        };
        self.found_new_mv |= has_new_mv(candidate.y_mode);
        self.found_match = true;
        self.stack
            .add([lower_precision(header, mv), MotionVector::ZERO], weight);
    }

    /// §7.10.2.9 Compound search stack process.
    fn compound_search_stack(&mut self, candidate: &Block, weight: u32) {
        let header = &self.tile.frame.header;
        let mut mvs = candidate.mv;
        if candidate.y_mode == GLOBAL_GLOBALMV {
            for (list, mv) in mvs.iter_mut().enumerate() {
                if self.has_model(list) {
                    *mv = self.stack.global_mvs[list];
                }
            }
        }
        self.found_new_mv |= has_new_mv(candidate.y_mode);
        self.found_match = true;
        self.stack
            .add(mvs.map(|mv| lower_precision(header, mv)), weight);
    }

    /// Whether the global model of a list is more than a translation.
    fn has_model(&self, list: usize) -> bool {
        let reference = self.block.ref_frame[list];
        reference > 0 && self.tile.frame.header.gm_type[reference as usize] > TRANSLATION
    }
}

/// §7.10.2.2: how far the scan moves on at least.
fn minimum_length(is_far: bool, size4: i32) -> i32 {
    match (size4 >= 16, is_far) {
        (true, _) => 4,
        (false, true) => 2,
        (false, false) => 1,
    }
}

/// §7.10.2.9 `has_newmv`.
fn has_new_mv(mode: u8) -> bool {
    matches!(
        mode,
        NEWMV | NEW_NEWMV | NEAR_NEWMV | NEW_NEARMV | NEAREST_NEWMV | NEW_NEARESTMV
    )
}
