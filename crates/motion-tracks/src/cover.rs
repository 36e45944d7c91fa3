//! Which block covers a pixel.

/// Side of the finest AV1 block, px.
const CELL: u32 = 4;
/// Marks a cell or a chain end without a row.
const NONE: u32 = u32::MAX;

/// Look-up from a pixel to the rows of the block that covers it.
///
/// Built per frame and thrown away after it: `width * height / 16` entries of 4 bytes.
pub(crate) struct Cover {
    columns: u32,
    lines: u32,
    /// First row of the block on each 4x4 cell.
    first: Vec<u32>,
    /// Next row of the same block (compound), per row.
    next: Vec<u32>,
}

impl Cover {
    /// Paints the rows of one frame; where blocks overlap against the rules, the first one stays.
    pub(crate) fn new(width: u32, height: u32, blocks: &[[i32; 4]]) -> Self {
        let (columns, lines) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let mut cover = Self {
            columns,
            lines,
            first: vec![NONE; columns as usize * lines as usize],
            next: vec![NONE; blocks.len()],
        };
        for (row, (block, index)) in blocks.iter().zip(0_u32..).enumerate() {
            if row > 0 && blocks[row - 1] == *block {
                cover.next[row - 1] = index;
            } else if !cover.append_to_same_block(blocks, block, index) {
                cover.paint(block, index);
            }
        }
        cover
    }

    /// Rows of the block that covers `xy`, first to last; none outside the picture and on intra.
    pub(crate) fn rows_at(&self, xy: [f32; 2]) -> Rows<'_> {
        Rows {
            next: &self.next,
            row: self.first_at(xy),
        }
    }

    /// Whether `row` is the first one of its block.
    pub(crate) fn is_first(&self, block: &[i32; 4], row: usize) -> bool {
        self.cell_of(block)
            .is_none_or(|cell| self.first[cell] as usize == row)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be inside"
    )]
    fn first_at(&self, [x, y]: [f32; 2]) -> u32 {
        if !(x >= 0.0 && y >= 0.0) {
            return NONE;
        }
        let (column, line) = (x as u32 / CELL, y as u32 / CELL);
        if column >= self.columns || line >= self.lines {
            return NONE;
        }
        self.first[line as usize * self.columns as usize + column as usize]
    }

    /// Index of the cell that holds the block's corner, if that lies in the picture.
    fn cell_of(&self, &[x, y, ..]: &[i32; 4]) -> Option<usize> {
        let column = u32::try_from(x).ok()? / CELL;
        let line = u32::try_from(y).ok()? / CELL;
        (column < self.columns && line < self.lines)
            .then(|| line as usize * self.columns as usize + column as usize)
    }

    fn append_to_same_block(&mut self, blocks: &[[i32; 4]], block: &[i32; 4], index: u32) -> bool {
        let Some(cell) = self.cell_of(block) else {
            return true;
        };
        let mut row = self.first[cell];
        if row == NONE || blocks[row as usize] != *block {
            return false;
        }
        while self.next[row as usize] != NONE {
            row = self.next[row as usize];
        }
        self.next[row as usize] = index;
        true
    }

    fn paint(&mut self, &[x, y, w, h]: &[i32; 4], index: u32) {
        let span = |start: i32, side: i32, limit: u32| {
            let first = start.unsigned_abs() / CELL;
            let end = (start + side).unsigned_abs().div_ceil(CELL).min(limit);
            first.min(end) as usize..end as usize
        };
        let columns = span(x, w, self.columns);
        for line in span(y, h, self.lines) {
            let start = line * self.columns as usize;
            for owner in &mut self.first[start + columns.start..start + columns.end] {
                if *owner == NONE {
                    *owner = index;
                }
            }
        }
    }
}

/// Iterator over the rows of one block.
pub(crate) struct Rows<'a> {
    next: &'a [u32],
    row: u32,
}

impl Iterator for Rows<'_> {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        let row = self.row as usize;
        self.row = *self.next.get(row)?;
        Some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(cover: &Cover, xy: [f32; 2]) -> Vec<usize> {
        cover.rows_at(xy).collect()
    }

    #[test]
    fn every_pixel_of_a_block_finds_its_row_and_its_neighbour_does_not() {
        let cover = Cover::new(32, 16, &[[8, 4, 8, 8]]);
        assert_eq!(rows(&cover, [8.0, 4.0]), [0]);
        assert_eq!(rows(&cover, [15.99, 11.99]), [0]);
        assert!(rows(&cover, [16.0, 8.0]).is_empty());
        assert!(rows(&cover, [7.99, 8.0]).is_empty());
    }

    #[test]
    fn a_compound_block_gives_both_rows_wherever_they_stand() {
        let cover = Cover::new(
            32,
            16,
            &[[0, 0, 8, 8], [8, 0, 8, 8], [0, 0, 8, 8], [8, 0, 8, 8]],
        );
        assert_eq!(rows(&cover, [1.0, 1.0]), [0, 2]);
        assert_eq!(rows(&cover, [9.0, 1.0]), [1, 3]);
        let adjacent = Cover::new(32, 16, &[[0, 0, 8, 8], [0, 0, 8, 8]]);
        assert_eq!(rows(&adjacent, [1.0, 1.0]), [0, 1]);
    }

    #[test]
    fn points_outside_the_picture_and_not_a_number_are_covered_by_nothing() {
        let cover = Cover::new(10, 10, &[[0, 0, 64, 64]]);
        for xy in [
            [-0.1, 5.0],
            [5.0, -3.0],
            [f32::NAN, 5.0],
            [12.0, 5.0],
            [5.0, f32::INFINITY],
        ] {
            assert!(rows(&cover, xy).is_empty(), "{xy:?}");
        }
        assert_eq!(rows(&cover, [9.9, 9.9]), [0]);
    }

    #[test]
    fn a_block_beyond_the_picture_covers_nothing_and_breaks_nothing() {
        let cover = Cover::new(16, 16, &[[64, 64, 8, 8], [0, 0, 8, 8]]);
        assert_eq!(rows(&cover, [1.0, 1.0]), [1]);
        assert!(rows(&cover, [15.0, 15.0]).is_empty());
    }
}
