//! §7.10.2.12 Extra search process, §7.10.2.13 Add extra MV candidate process.

use super::stack::Search;
use crate::motion::MotionVector;
use crate::tables::symbols::INTRA_FRAME;
use crate::tile::{Block, BlockContext};

/// Up to two vectors found for one list.
#[derive(Default)]
struct Pair {
    mvs: [MotionVector; 2],
    count: usize,
}

impl Pair {
    fn push(&mut self, mv: MotionVector) {
        self.mvs[self.count] = mv;
        self.count += 1;
    }
}

/// `RefIdMvs` and `RefDiffMvs` of one list.
#[derive(Default)]
struct ExtraList {
    same: Pair,
    different: Pair,
}

impl Search<'_> {
    /// §7.10.2.12 Extra search process.
    pub(super) fn extra_search(&mut self, context: &BlockContext) {
        let mut lists = [ExtraList::default(), ExtraList::default()];
        let frame = &self.tile.frame.header.size;
        let width4 = (self.block.width4() as u32)
            .min(16)
            .min(frame.mi_cols - self.block.mi_col);
        let height4 = (self.block.height4() as u32)
            .min(16)
            .min(frame.mi_rows - self.block.mi_row);
        let num4x4 = width4.min(height4);
        if context.above.is_some() {
            let mut idx = 0;
            while idx < num4x4 && self.stack.num_found < 2 {
                let candidate = self
                    .tile
                    .block_at(self.block.mi_row - 1, self.block.mi_col + idx);
                self.add_extra_candidate(candidate, &mut lists);
                idx += candidate.width4() as u32;
            }
        }
        if context.left.is_some() {
            let mut idx = 0;
            while idx < num4x4 && self.stack.num_found < 2 {
                let candidate = self
                    .tile
                    .block_at(self.block.mi_row + idx, self.block.mi_col - 1);
                self.add_extra_candidate(candidate, &mut lists);
                idx += candidate.height4() as u32;
            }
        }
        if self.is_compound {
            self.combine(&lists);
        } else {
            let global = [self.stack.global_mvs[0], MotionVector::ZERO];
            for idx in self.stack.num_found..2 {
                self.stack.mvs[idx] = global;
            }
        }
    }

    /// §7.10.2.13 Add extra MV candidate process.
    fn add_extra_candidate(&mut self, candidate: &Block, lists: &mut [ExtraList; 2]) {
        let sign_bias = &self.tile.frame.header.ref_frame_sign_bias;
        for candidate_list in 0..2 {
            let reference = candidate.ref_frame[candidate_list];
            if reference <= INTRA_FRAME {
                continue;
            }
            let mv = candidate.mv[candidate_list];
            let towards = |own: i8| {
                let is_opposite =
                    own > INTRA_FRAME && sign_bias[reference as usize] != sign_bias[own as usize];
                if is_opposite { mv.negated() } else { mv }
            };
            if !self.is_compound {
                let mvs = [towards(self.block.ref_frame[0]), MotionVector::ZERO];
                if !self.stack.mvs[..self.stack.num_found].contains(&mvs) {
                    self.stack.push(mvs, 2);
                }
                continue;
            }
            for (list, extra) in lists.iter_mut().enumerate() {
                let own = self.block.ref_frame[list];
                if reference == own && extra.same.count < 2 {
                    extra.same.push(mv);
                } else if extra.different.count < 2 {
                    extra.different.push(towards(own));
                }
            }
        }
    }

    /// §7.10.2.12: fills a compound stack up to two entries.
    fn combine(&mut self, lists: &[ExtraList; 2]) {
        let mut combined = [self.stack.global_mvs; 2];
        for (list, extra) in lists.iter().enumerate() {
            let same = &extra.same.mvs[..extra.same.count];
            let different = &extra.different.mvs[..extra.different.count];
            for (entry, mv) in combined.iter_mut().zip(same.iter().chain(different)) {
                entry[list] = *mv;
            }
        }
        if self.stack.num_found == 1 {
            let is_known = combined[0] == self.stack.mvs[0];
            self.stack.push(combined[usize::from(is_known)], 2);
        } else {
            self.stack.push(combined[0], 2);
            self.stack.push(combined[1], 2);
        }
    }
}
