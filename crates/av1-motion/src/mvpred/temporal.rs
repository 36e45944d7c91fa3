//! §7.10.2.5 Temporal scan process, §7.10.2.6 Temporal sample process.

use super::global::lower_precision;
use super::projection::ProjectedVector;
use super::stack::Search;
use crate::motion::MotionVector;

/// The last sample that was not a hole; neighbours are equal more often than not.
struct LastSample {
    projected: ProjectedVector,
    /// Where it is in the stack.
    index: usize,
}

impl Search<'_> {
    /// §7.10.2.5 Temporal scan process.
    pub(super) fn temporal_scan(&mut self) {
        let (width4, height4) = (self.block.width4() as u32, self.block.height4() as u32);
        let step_col = if width4 >= 16 { 4 } else { 2 };
        let step_row = if height4 >= 16 { 4 } else { 2 };
        let (mi_row, mi_col) = (self.block.mi_row, self.block.mi_col);
        let mut last = None;
        self.first_temporal(&mut last);
        let mut row = 0;
        while row < height4.min(16) {
            let mut col = if row == 0 { step_col } else { 0 };
            while col < width4.min(16) {
                self.add_temporal(mi_row + row, mi_col + col, &mut last);
                col += step_col;
            }
            row += step_row;
        }
        if !(2..16).contains(&height4) || !(2..16).contains(&width4) {
            return;
        }
        // `check_sb_border`: inside the same 64x64 luma samples.
        let (row, col) = (mi_row & 15, mi_col & 15);
        if row + height4 < 16 {
            if col >= 2 {
                self.add_temporal(mi_row + height4, mi_col - 2, &mut last);
            }
            if col + width4 < 16 {
                self.add_temporal(mi_row + height4, mi_col + width4, &mut last);
            }
        }
        if col + width4 < 16 {
            self.add_temporal(mi_row + height4 - 2, mi_col + width4, &mut last);
        }
    }

    /// §7.10.2.6 `add_tpl_ref_mv`, of the upper left corner.
    fn first_temporal(&mut self, last: &mut Option<LastSample>) {
        let (mi_row, mi_col) = (self.block.mi_row, self.block.mi_col);
        let is_far = |mv: MotionVector, global: MotionVector| {
            (i32::from(mv.row) - i32::from(global.row)).abs() >= 16
                || (i32::from(mv.col) - i32::from(global.col)).abs() >= 16
        };
        let bounds = &self.tile.bounds;
        if (mi_row | 1) >= bounds.mi_row_end || (mi_col | 1) >= bounds.mi_col_end {
            return;
        }
        self.stack.zero_mv_context = 1;
        if let Some(mvs) = self.add_temporal(mi_row, mi_col, last) {
            let globals = self.stack.global_mvs;
            let lists = if self.is_compound { 2 } else { 1 };
            let any_far = (0..lists).any(|list| is_far(mvs[list], globals[list]));
            self.stack.zero_mv_context = usize::from(any_far);
        }
    }

    /// §7.10.2.6 `add_tpl_ref_mv`: the vectors, if they are not those of the sample before.
    #[inline]
    fn add_temporal(
        &mut self,
        row: u32,
        col: u32,
        last: &mut Option<LastSample>,
    ) -> Option<[MotionVector; 2]> {
        let (row, col) = (row | 1, col | 1);
        let (frame, bounds) = (self.tile.frame, &self.tile.bounds);
        if row >= bounds.mi_row_end || col >= bounds.mi_col_end {
            return None;
        }
        let field = frame.projected_motion.as_ref()?;
        let projected = field.at(row as usize >> 1, col as usize >> 1)?;
        if let Some(last) = last
            && last.projected == projected
        {
            self.stack.add_weight(last.index, 2);
            return None;
        }
        let mut mvs = [MotionVector::ZERO; 2];
        let lists = if self.is_compound { 2 } else { 1 };
        for (mv, &reference) in mvs[..lists].iter_mut().zip(&self.block.ref_frame) {
            let distance = frame.ref_distance[reference as usize];
            *mv = lower_precision(&frame.header, projected.project(distance));
        }
        let index = self.stack.add(mvs, 2);
        *last = Some(LastSample { projected, index });
        Some(mvs)
    }
}
