//! §7.10.2.5 Temporal scan process, §7.10.2.6 Temporal sample process.

use super::global::lower_precision;
use super::stack::Search;
use crate::motion::MotionVector;

impl Search<'_> {
    /// §7.10.2.5 Temporal scan process.
    pub(super) fn temporal_scan(&mut self) {
        let (width4, height4) = (self.block.width4() as i32, self.block.height4() as i32);
        let step_col = if width4 >= 16 { 4 } else { 2 };
        let step_row = if height4 >= 16 { 4 } else { 2 };
        for delta_row in (0..height4.min(16)).step_by(step_row) {
            for delta_col in (0..width4.min(16)).step_by(step_col) {
                self.add_temporal(delta_row, delta_col);
            }
        }
        if !(2..16).contains(&height4) || !(2..16).contains(&width4) {
            return;
        }
        for (delta_row, delta_col) in [(height4, -2), (height4, width4), (height4 - 2, width4)] {
            // `check_sb_border`: inside the same 64x64 luma samples.
            let row = (self.block.mi_row as i32 & 15) + delta_row;
            let col = (self.block.mi_col as i32 & 15) + delta_col;
            if (0..16).contains(&row) && (0..16).contains(&col) {
                self.add_temporal(delta_row, delta_col);
            }
        }
    }

    /// §7.10.2.6 `add_tpl_ref_mv`.
    fn add_temporal(&mut self, delta_row: i32, delta_col: i32) {
        let row = (self.block.mi_row as i32 + delta_row) | 1;
        let col = (self.block.mi_col as i32 + delta_col) | 1;
        if !self.tile.bounds.contains(row, col) {
            return;
        }
        let is_first = delta_row == 0 && delta_col == 0;
        if is_first {
            self.stack.zero_mv_context = 1;
        }
        let frame = self.tile.frame;
        let Some(projected) = frame
            .projected_motion
            .as_ref()
            .and_then(|field| field.at(row as usize >> 1, col as usize >> 1))
        else {
            return;
        };
        let mut mvs = [MotionVector::ZERO; 2];
        let lists = if self.is_compound { 2 } else { 1 };
        for (mv, &reference) in mvs[..lists].iter_mut().zip(&self.block.ref_frame) {
            let distance = frame.ref_distance[reference as usize];
            *mv = lower_precision(&frame.header, projected.project(distance));
        }
        if is_first {
            let is_far = (0..lists).any(|list| {
                let global = self.stack.global_mvs[list];
                (i32::from(mvs[list].row) - i32::from(global.row)).abs() >= 16
                    || (i32::from(mvs[list].col) - i32::from(global.col)).abs() >= 16
            });
            self.stack.zero_mv_context = usize::from(is_far);
        }
        self.stack.add(mvs, 2);
    }
}
