//! §5.11.15 TX size, §5.11.16 Block TX size, §5.11.17 Var TX size.

use super::{Block, BlockContext, TileDecoder};
use crate::obu::frame_header::TxMode;
use crate::tables::block_size::{
    BLOCK_4X4, BLOCK_HEIGHT, BLOCK_WIDTH, MAX_TX_DEPTH, MAX_TX_SIZE_RECT,
};
use crate::tables::symbols::MAX_VARTX_DEPTH;
use crate::tables::tx_size::{
    SPLIT_TX_SIZE, TX_4X4, TX_8X8, TX_16X16, TX_32X32, TX_64X64, TX_HEIGHT, TX_SIZE_SQR_UP,
    TX_SIZES, TX_WIDTH,
};

impl TileDecoder<'_> {
    /// §5.11.16 `read_block_tx_size`.
    pub(super) fn read_block_tx_size(&mut self, block: &mut Block, context: &BlockContext) {
        let is_select = self.frame.header.tx_mode == TxMode::Select;
        if is_select
            && block.size != BLOCK_4X4
            && block.is_inter
            && !block.skip
            && !context.lossless
        {
            let max = MAX_TX_SIZE_RECT[block.size as usize];
            let (width4, height4) = tx_size4(max);
            let mut row = 0;
            while row < block.height4() as u32 {
                let mut col = 0;
                while col < block.width4() as u32 {
                    self.read_var_tx_size(block, block.mi_row + row, block.mi_col + col, max, 0);
                    col += width4;
                }
                row += height4;
            }
        } else {
            let allow_select = !block.skip || !block.is_inter;
            block.tx_size = self.read_tx_size(block, context, allow_select && is_select);
            let area = self
                .grid
                .area(block.mi_row, block.mi_col, block.width4(), block.height4());
            area.fill(&mut self.grid.tx_size, block.tx_size);
        }
    }

    /// §5.11.15 `read_tx_size`.
    fn read_tx_size(&mut self, block: &Block, context: &BlockContext, is_coded: bool) -> u8 {
        if context.lossless {
            return TX_4X4;
        }
        let max = MAX_TX_SIZE_RECT[block.size as usize];
        if !is_coded || block.size == BLOCK_4X4 {
            return max;
        }
        let cdf_context = self.tx_depth_context(block, context, max);
        let (symbols, cdfs) = (&mut self.symbols, &mut *self.cdfs);
        let depth = match MAX_TX_DEPTH[block.size as usize] {
            4 => symbols.symbol(&mut cdfs.tx_64x64[cdf_context]),
            3 => symbols.symbol(&mut cdfs.tx_32x32[cdf_context]),
            2 => symbols.symbol(&mut cdfs.tx_16x16[cdf_context]),
            _ => symbols.flag(&mut cdfs.tx_8x8[cdf_context]).into(),
        };
        (0..depth).fold(max, |size, _| SPLIT_TX_SIZE[size as usize])
    }

    /// §8.3.2: the context of `tx_depth`.
    fn tx_depth_context(&self, block: &Block, context: &BlockContext, max: u8) -> usize {
        let above = context.above.as_ref().map_or(0, |above| {
            if above.is_inter {
                BLOCK_WIDTH[above.size as usize]
            } else {
                self.above_tx_width(block, block.mi_row, block.mi_col)
            }
        });
        let left = context.left.as_ref().map_or(0, |left| {
            if left.is_inter {
                BLOCK_HEIGHT[left.size as usize]
            } else {
                self.left_tx_height(block, block.mi_row, block.mi_col)
            }
        });
        usize::from(above >= TX_WIDTH[max as usize]) + usize::from(left >= TX_HEIGHT[max as usize])
    }

    /// §5.11.17 `read_var_tx_size`.
    fn read_var_tx_size(&mut self, block: &mut Block, row: u32, col: u32, size: u8, depth: u8) {
        let frame = &self.frame.header.size;
        if row >= frame.mi_rows || col >= frame.mi_cols {
            return;
        }
        let is_split = size != TX_4X4 && depth < MAX_VARTX_DEPTH && {
            let cdf_context = self.txfm_split_context(block, row, col, size);
            self.symbols.flag(&mut self.cdfs.txfm_split[cdf_context])
        };
        let (width4, height4) = tx_size4(size);
        if is_split {
            let sub_size = SPLIT_TX_SIZE[size as usize];
            let (step_col, step_row) = tx_size4(sub_size);
            let mut i = 0;
            while i < height4 {
                let mut j = 0;
                while j < width4 {
                    self.read_var_tx_size(block, row + i, col + j, sub_size, depth + 1);
                    j += step_col;
                }
                i += step_row;
            }
        } else {
            let area = self.grid.area(row, col, width4 as usize, height4 as usize);
            area.fill(&mut self.grid.tx_size, size);
            block.tx_size = size;
        }
    }

    /// §8.3.2: the context of `txfm_split`.
    fn txfm_split_context(&self, block: &Block, row: u32, col: u32, size: u8) -> usize {
        let above = self.above_tx_width(block, row, col) < TX_WIDTH[size as usize];
        let left = self.left_tx_height(block, row, col) < TX_HEIGHT[size as usize];
        let longest = BLOCK_WIDTH[block.size as usize].max(BLOCK_HEIGHT[block.size as usize]);
        let max = match longest {
            4 => TX_4X4,
            8 => TX_8X8,
            16 => TX_16X16,
            32 => TX_32X32,
            _ => TX_64X64,
        };
        usize::from(TX_SIZE_SQR_UP[size as usize] != max) * 3
            + (TX_SIZES - 1 - max as usize) * 6
            + usize::from(above)
            + usize::from(left)
    }

    /// §8.3.2 `get_above_tx_width`.
    fn above_tx_width(&self, block: &Block, row: u32, col: u32) -> u8 {
        if row == block.mi_row {
            if row == self.bounds.mi_row_start {
                return 64;
            }
            let above = self.block_at(row - 1, col);
            if above.skip && above.is_inter {
                return BLOCK_WIDTH[above.size as usize];
            }
        }
        TX_WIDTH[self.grid.tx_size[self.grid.cell(row - 1, col)] as usize]
    }

    /// §8.3.2 `get_left_tx_height`.
    fn left_tx_height(&self, block: &Block, row: u32, col: u32) -> u8 {
        if col == block.mi_col {
            if col == self.bounds.mi_col_start {
                return 64;
            }
            let left = self.block_at(row, col - 1);
            if left.skip && left.is_inter {
                return BLOCK_HEIGHT[left.size as usize];
            }
        }
        TX_HEIGHT[self.grid.tx_size[self.grid.cell(row, col - 1)] as usize]
    }
}

/// Width and height of a transform in units of 4 samples.
#[inline]
pub(super) fn tx_size4(size: u8) -> (u32, u32) {
    (
        u32::from(TX_WIDTH[size as usize]) >> 2,
        u32::from(TX_HEIGHT[size as usize]) >> 2,
    )
}
