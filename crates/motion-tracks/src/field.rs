//! The vectors of one coded frame, as borrowed columns.

use std::fmt;

/// One coded frame: one row per block *and* reference; intra blocks have no row.
///
/// Blocks lie on a 4 px grid, do not overlap (rows of one compound block share their rectangle) and
/// may overhang the right and lower picture edge.
#[derive(Clone, Copy, Debug)]
pub struct Field<'a> {
    /// Display index of the frame.
    pub frame: i32,
    /// Picture width in px.
    pub width: u32,
    /// Picture height in px.
    pub height: u32,
    /// `[x, y, w, h]` in px.
    pub blocks: &'a [[i32; 4]],
    /// `[dx, dy]` in px into the reference.
    pub vectors: &'a [[f32; 2]],
    /// Display index of the reference.
    pub references: &'a [i32],
    /// Sum of the absolute coefficient levels of each row's block; an empty slice when not known.
    pub energies: &'a [f32],
}

/// Why a field cannot be used; always the caller's fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FieldError {
    /// The columns do not have one entry per row.
    Lengths,
    /// A block is empty or lies outside `0..65536` px.
    Block {
        /// Row of the block.
        row: usize,
    },
    /// A vector is not finite or longer than 65536 px.
    Vector {
        /// Row of the vector.
        row: usize,
    },
    /// The picture is empty or larger than 65536 px in one direction.
    Size,
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lengths => {
                f.write_str("block, mv, ref_frame and residual need one row each per vector")
            }
            Self::Block { row } => {
                write!(f, "block of row {row} is empty or lies outside 0..65536 px")
            }
            Self::Vector { row } => {
                write!(f, "vector of row {row} is not finite and below 65536 px")
            }
            Self::Size => f.write_str("picture width and height must be 1 to 65536 px"),
        }
    }
}

impl std::error::Error for FieldError {}

/// Largest coordinate a field may use, px (the largest picture side of AV1).
const MAX_COORDINATE: i32 = 1 << 16;

impl Field<'_> {
    /// Coefficient levels per 16 px of a row's block; 0 when not known.
    #[expect(clippy::cast_precision_loss, reason = "block areas are small")]
    pub(crate) fn energy(&self, row: usize) -> f32 {
        let [_, _, w, h] = self.blocks[row];
        self.energies.get(row).map_or(0.0, |energy| {
            16.0 * energy / (i64::from(w) * i64::from(h)) as f32
        })
    }

    /// Checks what the rest of the crate relies on.
    ///
    /// # Errors
    /// [`FieldError`] names the first rule that does not hold.
    pub fn validate(&self) -> Result<(), FieldError> {
        let rows = self.blocks.len();
        let energies = self.energies.len();
        if self.vectors.len() != rows
            || self.references.len() != rows
            || (energies != 0 && energies != rows)
        {
            return Err(FieldError::Lengths);
        }
        if !(1..=1 << 16).contains(&self.width) || !(1..=1 << 16).contains(&self.height) {
            return Err(FieldError::Size);
        }
        let usable = |&[x, y, w, h]: &[i32; 4]| {
            let inside = |start| (0..MAX_COORDINATE).contains(&start);
            let sized = |side| (1..MAX_COORDINATE).contains(&side);
            inside(x) && inside(y) && sized(w) && sized(h)
        };
        if let Some(row) = self.blocks.iter().position(|block| !usable(block)) {
            return Err(FieldError::Block { row });
        }
        let limit = 65_536.0_f32;
        let bounded = |v: &[f32; 2]| v[0].abs() <= limit && v[1].abs() <= limit;
        match self.vectors.iter().position(|v| !bounded(v)) {
            Some(row) => Err(FieldError::Vector { row }),
            None => Ok(()),
        }
    }
}

/// Centre of a block in px.
#[expect(
    clippy::cast_precision_loss,
    reason = "doubled coordinates stay below 2^24"
)]
pub(crate) fn center([x, y, w, h]: [i32; 4]) -> [f32; 2] {
    [(2 * x + w) as f32 / 2.0, (2 * y + h) as f32 / 2.0]
}

/// Offset of a block's corner from its centre, px.
#[expect(clippy::cast_precision_loss, reason = "sides are below 2^16 px")]
pub(crate) fn half_sizes([_, _, w, h]: [i32; 4]) -> [f32; 2] {
    [w as f32 / 2.0, h as f32 / 2.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field<'a>(blocks: &'a [[i32; 4]], vectors: &'a [[f32; 2]]) -> Field<'a> {
        Field {
            frame: 1,
            width: 16,
            height: 16,
            blocks,
            vectors,
            references: &[0],
            energies: &[],
        }
    }

    #[test]
    fn the_center_of_a_block_is_its_corner_plus_half_its_size() {
        assert_eq!(center([8, 0, 8, 4]), [12.0, 2.0]);
    }

    #[test]
    fn columns_of_different_length_are_refused() {
        assert_eq!(
            field(&[[0, 0, 8, 8]], &[]).validate(),
            Err(FieldError::Lengths)
        );
    }

    #[test]
    fn an_empty_block_and_a_vector_that_is_not_a_number_are_refused_by_row() {
        let vector = [[1.0, 0.0]];
        assert_eq!(
            field(&[[0, 0, 0, 8]], &vector).validate(),
            Err(FieldError::Block { row: 0 })
        );
        assert_eq!(
            field(&[[0, 0, 8, 8]], &[[f32::NAN, 0.0]]).validate(),
            Err(FieldError::Vector { row: 0 })
        );
        assert_eq!(field(&[[0, 0, 8, 8]], &vector).validate(), Ok(()));
    }
}
