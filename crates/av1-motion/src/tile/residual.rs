//! §5.11.34 Residual, §5.11.35 Transform block, §5.11.36 Transform tree.

use super::{Block, BlockContext, TileDecoder, TileResult};
use crate::tables::block_size::{
    BLOCK_64X64, BLOCK_HEIGHT, BLOCK_WIDTH, MAX_TX_SIZE_RECT, NUM_4X4_BLOCKS_HIGH,
    NUM_4X4_BLOCKS_WIDE, SUBSAMPLED_SIZE,
};
use crate::tables::tx_size::{
    TX_4X4, TX_16X32, TX_32X16, TX_32X32, TX_HEIGHT, TX_HEIGHT_LOG2, TX_WIDTH, TX_WIDTH_LOG2,
};
use crate::tile::tx_size::tx_size4;

/// §5.11.36 `find_tx_size`, by the binary logarithms of width and height less 2. Shapes that do not
/// exist are never asked for.
const TX_SIZE_OF_SHAPE: [[u8; 5]; 5] = {
    let mut sizes = [[TX_4X4; 5]; 5];
    let mut size = 0;
    while size < TX_WIDTH_LOG2.len() {
        let (w, h) = (
            TX_WIDTH_LOG2[size] as usize - 2,
            TX_HEIGHT_LOG2[size] as usize - 2,
        );
        sizes[w][h] = size as u8;
        size += 1;
    }
    sizes
};

impl TileDecoder<'_> {
    /// §5.11.34 `residual`, of a block that is not skipped.
    pub(super) fn residual(&mut self, block: &mut Block, context: &BlockContext) -> TileResult<()> {
        let size = block.size as usize;
        let width_chunks = (u32::from(BLOCK_WIDTH[size]) >> 6).max(1);
        let height_chunks = (u32::from(BLOCK_HEIGHT[size]) >> 6).max(1);
        let chunk = if width_chunks * height_chunks > 1 {
            BLOCK_64X64
        } else {
            block.size
        };
        for chunk_y in 0..height_chunks {
            for chunk_x in 0..width_chunks {
                self.residual_chunk(block, context, chunk, chunk_x << 4, chunk_y << 4)?;
            }
        }
        Ok(())
    }

    /// §5.11.34: at most 64x64 luma samples, plane by plane; the offset is in units of 4 luma samples.
    fn residual_chunk(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
        chunk: u8,
        offset_x: u32,
        offset_y: u32,
    ) -> TileResult<()> {
        let color = &self.frame.sequence.color;
        let (ss_x, ss_y) = (color.subsampling_x, color.subsampling_y);
        let frame = &self.frame.header.size;
        let (mi_rows, mi_cols) = (frame.mi_rows, frame.mi_cols);
        for plane in 0..if block.has_chroma { 3 } else { 1 } {
            let (x, y) = if plane > 0 { (ss_x, ss_y) } else { (0, 0) };
            let plane_size = SUBSAMPLED_SIZE[chunk as usize][x as usize][y as usize] as usize;
            let width4 = u32::from(NUM_4X4_BLOCKS_WIDE[plane_size]);
            let height4 = u32::from(NUM_4X4_BLOCKS_HIGH[plane_size]);
            let start_x = (block.mi_col >> x) + (offset_x >> x);
            let start_y = (block.mi_row >> y) + (offset_y >> y);
            if block.is_inter && !context.lossless && plane == 0 {
                self.transform_tree(block, context, start_x, start_y, width4, height4)?;
                continue;
            }
            let tx_size = if context.lossless {
                TX_4X4
            } else {
                plane_tx_size(block, plane, x as usize, y as usize)
            };
            // §5.11.35: transform blocks that start outside the frame are not coded.
            let end_x = (start_x + width4).min(mi_cols >> x);
            let end_y = (start_y + height4).min(mi_rows >> y);
            let (step_x, step_y) = tx_size4(tx_size);
            let mut y4 = start_y;
            while y4 < end_y {
                let mut x4 = start_x;
                while x4 < end_x {
                    self.coefficients(block, context, plane, tx_size, x4, y4)?;
                    x4 += step_x;
                }
                y4 += step_y;
            }
        }
        Ok(())
    }

    /// §5.11.36 `transform_tree`, in units of 4 luma samples.
    fn transform_tree(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
        x4: u32,
        y4: u32,
        width4: u32,
        height4: u32,
    ) -> TileResult<()> {
        let frame = &self.frame.header.size;
        if x4 >= frame.mi_cols || y4 >= frame.mi_rows {
            return Ok(());
        }
        let tx_size = self.grid.tx_size[self.grid.cell(y4, x4)] as usize;
        let (tx_width4, tx_height4) = (
            u32::from(TX_WIDTH[tx_size]) >> 2,
            u32::from(TX_HEIGHT[tx_size]) >> 2,
        );
        if width4 <= tx_width4 && height4 <= tx_height4 {
            let size = TX_SIZE_OF_SHAPE[width4.ilog2() as usize][height4.ilog2() as usize];
            return self.coefficients(block, context, 0, size, x4, y4);
        }
        let half_width = if width4 >= height4 {
            width4 / 2
        } else {
            width4
        };
        let half_height = if height4 >= width4 {
            height4 / 2
        } else {
            height4
        };
        let mut y = 0;
        while y < height4 {
            let mut x = 0;
            while x < width4 {
                self.transform_tree(block, context, x4 + x, y4 + y, half_width, half_height)?;
                x += half_width;
            }
            y += half_height;
        }
        Ok(())
    }
}

/// §5.11.37 `get_tx_size`.
fn plane_tx_size(block: &Block, plane: usize, x: usize, y: usize) -> u8 {
    if plane == 0 {
        return block.tx_size;
    }
    let size = MAX_TX_SIZE_RECT[SUBSAMPLED_SIZE[block.size as usize][x][y] as usize];
    match (TX_WIDTH[size as usize], TX_HEIGHT[size as usize]) {
        (16, 64) => TX_16X32,
        (64, 16) => TX_32X16,
        (64, _) | (_, 64) => TX_32X32,
        _ => size,
    }
}
