//! §6.10.3: the arrays above and left of a block that probabilities are chosen by.

use super::{Block, TileBounds};
use crate::memory::{OutOfMemory, filled};

/// Marks a cell that no block of this frame covers yet.
pub(crate) const NOT_DECODED: u32 = u32::MAX;

/// Per-cell state of one tile, in raster order.
pub(crate) struct TileGrid {
    mi_row_start: u32,
    mi_col_start: u32,
    cols: usize,
    rows: usize,
    /// Index of the covering block in the tile's list.
    block_index: Vec<u32>,
    /// `InterTxSizes`.
    pub(crate) tx_size: Vec<u8>,
    /// `TxTypes`.
    pub(crate) tx_type: Vec<u8>,
}

impl TileGrid {
    pub(super) fn new(bounds: &TileBounds) -> Result<Self, OutOfMemory> {
        let cells = bounds.rows() * bounds.cols();
        Ok(Self {
            mi_row_start: bounds.mi_row_start,
            mi_col_start: bounds.mi_col_start,
            cols: bounds.cols(),
            rows: bounds.rows(),
            block_index: filled(NOT_DECODED, cells)?,
            tx_size: filled(0, cells)?,
            tx_type: filled(0, cells)?,
        })
    }

    /// Position of a cell in the arrays.
    #[inline]
    pub(crate) fn cell(&self, mi_row: u32, mi_col: u32) -> usize {
        (mi_row - self.mi_row_start) as usize * self.cols + (mi_col - self.mi_col_start) as usize
    }

    /// Index of the block that covers a cell, or [`NOT_DECODED`].
    #[inline]
    pub(crate) fn index(&self, mi_row: u32, mi_col: u32) -> u32 {
        self.block_index[self.cell(mi_row, mi_col)]
    }

    /// Whether a cell inside the tile is covered by a block already.
    #[inline]
    pub(crate) fn is_decoded(&self, mi_row: u32, mi_col: u32) -> bool {
        self.index(mi_row, mi_col) != NOT_DECODED
    }

    /// Lets a block cover its cells.
    #[inline]
    pub(super) fn place(&mut self, index: u32, block: &Block) {
        let area = self.area(block.mi_row, block.mi_col, block.width4(), block.height4());
        area.fill(&mut self.block_index, index);
    }

    /// The part of a rectangle of cells that lies inside the tile.
    #[inline]
    pub(super) fn area(&self, mi_row: u32, mi_col: u32, width4: usize, height4: usize) -> Area {
        let row = (mi_row - self.mi_row_start) as usize;
        let col = (mi_col - self.mi_col_start) as usize;
        Area {
            start: row * self.cols + col,
            stride: self.cols,
            width: width4.min(self.cols - col),
            height: height4.min(self.rows - row),
        }
    }
}

/// A rectangle of cells.
#[derive(Clone, Copy)]
pub(super) struct Area {
    start: usize,
    stride: usize,
    width: usize,
    height: usize,
}

impl Area {
    /// Most areas are as wide as a block: then a row is one store, not a call.
    #[inline]
    pub(super) fn fill<T: Copy>(self, cells: &mut [T], value: T) {
        match self.width {
            1 => self.fill_rows::<T, 1>(cells, value),
            2 => self.fill_rows::<T, 2>(cells, value),
            4 => self.fill_rows::<T, 4>(cells, value),
            8 => self.fill_rows::<T, 8>(cells, value),
            16 => self.fill_rows::<T, 16>(cells, value),
            width => {
                for row in 0..self.height {
                    let start = self.start + row * self.stride;
                    cells[start..start + width].fill(value);
                }
            }
        }
    }

    #[inline]
    fn fill_rows<T: Copy, const WIDTH: usize>(self, cells: &mut [T], value: T) {
        for row in 0..self.height {
            let start = self.start + row * self.stride;
            cells[start..start + WIDTH].copy_from_slice(&[value; WIDTH]);
        }
    }
}

/// Sets all of a few entries; a call for so few would cost more than the stores.
#[inline]
pub(super) fn fill_few(entries: &mut [u8], value: u8) {
    match entries.len() {
        1 => entries[0] = value,
        2 => entries.copy_from_slice(&[value; 2]),
        4 => entries.copy_from_slice(&[value; 4]),
        8 => entries.copy_from_slice(&[value; 8]),
        _ => entries.fill(value),
    }
}

/// The row above, over the width of a tile. Coefficient entries hold the level sum in six bits and
/// the sign of the DC coefficient above them; entries outside the frame stay zero.
pub(super) struct AboveContext {
    pub(super) coefficients: [Vec<u8>; 3],
    /// `AboveSegPredContext`.
    pub(super) segment_predicted: Vec<u8>,
    /// `PaletteColors` of Y and U.
    pub(super) palette: [Vec<[u16; 8]>; 2],
}

impl AboveContext {
    /// Blocks overhang the tile by less than one superblock.
    pub(super) fn new(cols: usize) -> Result<Self, OutOfMemory> {
        let cells = cols + 32;
        let coefficients = || filled(0, cells);
        let palette = || filled([0; 8], cells);
        Ok(Self {
            coefficients: [coefficients()?, coefficients()?, coefficients()?],
            segment_predicted: filled(0, cells)?,
            palette: [palette()?, palette()?],
        })
    }
}

/// The column to the left, over the height of a superblock.
pub(super) struct LeftContext {
    pub(super) coefficients: [[u8; 64]; 3],
    /// `LeftSegPredContext`.
    pub(super) segment_predicted: [u8; 64],
    /// `PaletteColors` of Y and U.
    pub(super) palette: [[[u16; 8]; 64]; 2],
}

impl LeftContext {
    pub(super) fn new() -> Self {
        Self {
            coefficients: [[0; 64]; 3],
            segment_predicted: [0; 64],
            palette: [[[0; 8]; 64]; 2],
        }
    }

    /// §6.10.3 `clear_left_context`.
    pub(super) fn clear(&mut self) {
        self.coefficients = [[0; 64]; 3];
        self.segment_predicted = [0; 64];
    }
}
