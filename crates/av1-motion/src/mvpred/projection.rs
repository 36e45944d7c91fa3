//! §7.9 Motion field estimation process.
//!
//! The specification projects every saved vector to all seven references at once. Here a cell keeps
//! the vector with the number of frames it covers, and is projected when a block asks for it.

use super::global::round2_signed;
use super::storage::SavedMotionBands;
use crate::frame::ContextError;
use crate::memory::filled;
use crate::motion::MotionVector;
use crate::obu::frame_header::{FrameHeader, FrameType};
use crate::obu::sequence_header::SequenceHeader;
use crate::tables::arithmetic::DIV_MULT;
use crate::tables::symbols::{
    ALTREF_FRAME, ALTREF2_FRAME, BWDREF_FRAME, GOLDEN_FRAME, LAST_FRAME, LAST2_FRAME,
    MAX_FRAME_DISTANCE, MAX_OFFSET_HEIGHT, MAX_OFFSET_WIDTH, MFMV_STACK_SIZE,
};

/// A saved vector of a reference frame at the place it is projected to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ProjectedVector {
    mv: MotionVector,
    /// Frame intervals that `mv` covers; 0 marks a hole.
    distance: u8,
}

impl ProjectedVector {
    /// §7.9.3: the vector to a reference `distance` frame intervals in the past.
    #[inline]
    pub(crate) fn project(self, distance: i32) -> MotionVector {
        project_mv(self.mv, distance, self.distance.into())
    }
}

/// `MotionFieldMvs`, on a grid of 8x8 luma samples.
pub(crate) struct ProjectedMotion {
    cells: Vec<ProjectedVector>,
    cols: usize,
}

/// What projection needs of the frame in a reference slot.
pub(crate) struct ProjectionSource<'a> {
    pub(crate) frame_type: FrameType,
    pub(crate) mi_rows: u32,
    pub(crate) mi_cols: u32,
    /// `SavedOrderHints`.
    pub(crate) order_hints: &'a [u32; 8],
    /// Absent when the tiles of the frame were lost.
    pub(crate) motion: Option<&'a SavedMotionBands>,
}

impl ProjectedMotion {
    /// The vector of a cell, unless it is a hole.
    #[inline]
    pub(crate) fn at(&self, y8: usize, x8: usize) -> Option<ProjectedVector> {
        let cell = self.cells[y8 * self.cols + x8];
        (cell.distance > 0).then_some(cell)
    }

    /// §7.9.1 `motion_field_estimation`; `source` gives the frame behind a reference name.
    ///
    /// # Errors
    /// [`ContextError::LostMotion`] when a source that must be projected was lost.
    pub(crate) fn estimate<'a>(
        sequence: &SequenceHeader,
        header: &FrameHeader,
        source: impl Fn(i8) -> ProjectionSource<'a>,
    ) -> Result<Self, ContextError> {
        let (rows, cols) = (
            header.size.mi_rows as usize >> 1,
            header.size.mi_cols as usize >> 1,
        );
        let mut field = Self {
            cells: filled(ProjectedVector::default(), rows * cols)?,
            cols,
        };
        let hints = &header.order_hints;
        let is_future =
            |name: i8| sequence.relative_dist(hints[name as usize], header.order_hint) > 0;
        let mut project =
            |name: i8, sign: i32| field.project_source(sequence, header, &source(name), name, sign);
        let last_alt_hint = source(LAST_FRAME).order_hints[ALTREF_FRAME as usize];
        if last_alt_hint != hints[GOLDEN_FRAME as usize] {
            project(LAST_FRAME, -1)?;
        }
        let mut stamp = MFMV_STACK_SIZE as i32 - 2;
        for name in [BWDREF_FRAME, ALTREF2_FRAME] {
            if is_future(name) && project(name, 1)? {
                stamp -= 1;
            }
        }
        if is_future(ALTREF_FRAME) && stamp >= 0 && project(ALTREF_FRAME, 1)? {
            stamp -= 1;
        }
        if stamp >= 0 {
            project(LAST2_FRAME, -1)?;
        }
        Ok(field)
    }

    /// §7.9.2 Projection process; false when the source cannot be used.
    fn project_source(
        &mut self,
        sequence: &SequenceHeader,
        header: &FrameHeader,
        source: &ProjectionSource,
        name: i8,
        sign: i32,
    ) -> Result<bool, ContextError> {
        let size = &header.size;
        if source.mi_rows != size.mi_rows
            || source.mi_cols != size.mi_cols
            || matches!(source.frame_type, FrameType::Key | FrameType::IntraOnly)
        {
            return Ok(false);
        }
        let motion = source.motion.ok_or(ContextError::LostMotion)?;
        let hint = header.order_hints[name as usize];
        let to_current = sequence.relative_dist(hint, header.order_hint);
        let distances = source
            .order_hints
            .map(|saved| sequence.relative_dist(hint, saved));
        if to_current.abs() > MAX_FRAME_DISTANCE {
            return Ok(true);
        }
        let (rows, cols) = (size.mi_rows as usize >> 1, size.mi_cols as usize >> 1);
        for y8 in 0..rows {
            for (x8, saved) in motion.row(y8).iter().enumerate() {
                let distance = distances[saved.ref_frame as usize];
                if saved.ref_frame == 0 || !(1..=MAX_FRAME_DISTANCE).contains(&distance) {
                    continue;
                }
                let mv = project_mv(saved.mv, to_current * sign, distance);
                let row = project_position(y8, mv.row, sign, rows, MAX_OFFSET_HEIGHT);
                let col = project_position(x8, mv.col, sign, cols, MAX_OFFSET_WIDTH);
                if let (Some(row), Some(col)) = (row, col) {
                    self.cells[row * cols + col] = ProjectedVector {
                        mv: saved.mv,
                        distance: distance as u8,
                    };
                }
            }
        }
        Ok(true)
    }
}

/// §7.9.3 Get MV projection process: scales `mv` from `denominator` frame intervals to `numerator`.
#[inline]
fn project_mv(mv: MotionVector, numerator: i32, denominator: i32) -> MotionVector {
    let numerator = numerator.clamp(-MAX_FRAME_DISTANCE, MAX_FRAME_DISTANCE);
    let scale = numerator * i32::from(DIV_MULT[denominator.min(MAX_FRAME_DISTANCE) as usize]);
    let project = |component: i16| {
        let scaled = round2_signed(i64::from(component) * i64::from(scale), 14);
        scaled.clamp(-(1 << 14) + 1, (1 << 14) - 1) as i16
    };
    MotionVector {
        row: project(mv.row),
        col: project(mv.col),
    }
}

/// §7.9.4 `project`: where a cell moves along one axis, if that is near enough.
#[inline]
fn project_position(
    v8: usize,
    delta: i16,
    sign: i32,
    max8: usize,
    max_offset: i32,
) -> Option<usize> {
    let delta = i32::from(delta);
    // Towards zero.
    let offset = (delta + (delta >> 31 & 63)) >> 6;
    let base = v8 as i32 >> 3 << 3;
    let moved = v8 as i32 + sign * offset;
    let is_valid = moved >= 0
        && moved < max8 as i32
        && moved >= base - max_offset
        && moved < base + 8 + max_offset;
    is_valid.then_some(moved as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reciprocal_of_three_is_rounded_down_as_in_the_specification() {
        let mv = MotionVector {
            row: 12_000,
            col: -12_000,
        };
        assert_eq!(
            project_mv(mv, 3, 3),
            MotionVector {
                row: 11_999,
                col: -11_999
            }
        );
    }

    #[test]
    fn a_cell_never_leaves_its_band_of_64_rows() {
        for y8 in 0..32 {
            for delta in (-4096..4096).step_by(64) {
                let row = project_position(y8, delta, 1, 32, MAX_OFFSET_HEIGHT);
                assert!(row.is_none_or(|row| row / 8 == y8 / 8));
            }
        }
    }
}
