//! What only the feature `trace` tells: the transform of every cell, and how many symbols were read.

use av1_motion::Frame;

const TX_WIDTH4: [usize; 19] = [1, 2, 4, 8, 16, 1, 2, 2, 4, 4, 8, 8, 16, 1, 4, 2, 8, 4, 16];
const TX_HEIGHT4: [usize; 19] = [1, 2, 4, 8, 16, 2, 1, 4, 2, 8, 4, 16, 8, 4, 1, 8, 2, 16, 4];
const BLOCK_WIDTH4: [usize; 22] = [
    1, 1, 2, 2, 2, 4, 4, 4, 8, 8, 8, 16, 16, 16, 32, 32, 1, 4, 2, 8, 4, 16,
];
const BLOCK_HEIGHT4: [usize; 22] = [
    1, 2, 1, 2, 4, 2, 4, 8, 4, 8, 16, 8, 16, 32, 16, 32, 4, 1, 8, 2, 16, 4,
];

/// Cells of a frame in raster order.
struct Cells {
    rows: usize,
    cols: usize,
    values: Vec<i64>,
}

impl Cells {
    fn fill(&mut self, [row, col]: [u32; 2], [height, width]: [usize; 2], value: i64) {
        let (row, col) = (row as usize, col as usize);
        let end = self.cols.min(col + width);
        for row in row..self.rows.min(row + height) {
            self.values[row * self.cols + col..row * self.cols + end].fill(value);
        }
    }
}

/// Everything that the trace of a coded frame tells, in the order of `record_line`.
pub(crate) fn values(frame: &Frame) -> Vec<i64> {
    let (info, trace) = (frame.info(), frame.trace());
    let (rows, cols) = (info.mi_rows as usize, info.mi_cols as usize);
    let values = vec![-1; rows * cols];
    let mut sizes = Cells { rows, cols, values };
    let mut types = Cells {
        values: sizes.values.clone(),
        ..sizes
    };
    let mut histogram = [0; 16];
    for block in trace
        .transform_blocks
        .iter()
        .filter(|block| block.plane == 0)
    {
        let (size, place) = (usize::from(block.tx_size), [block.y4, block.x4]);
        let extent = [TX_HEIGHT4[size], TX_WIDTH4[size]];
        sizes.fill(place, extent, block.tx_size.into());
        types.fill(place, extent, block.tx_type.into());
        histogram[usize::from(block.tx_type)] += i64::from(!block.all_zero);
    }
    for block in frame.blocks().iter().filter(|block| block.skip) {
        let size = usize::from(block.size);
        let (place, extent) = (
            [block.mi_row, block.mi_col],
            [BLOCK_HEIGHT4[size], BLOCK_WIDTH4[size]],
        );
        sizes.fill(place, extent, block.tx_size.into());
        types.fill(place, extent, -1);
    }
    let slots = trace
        .slots
        .map(|slot| slot.map_or(-1, |slot| slot.decode_index.cast_signed()));
    let symbols = [trace.symbols.multi, trace.symbols.binary].map(u64::cast_signed);
    [
        &sizes.values[..],
        &types.values,
        &[trace.num_tile_groups.into()],
        &symbols,
        &histogram,
        &slots,
    ]
    .concat()
}
