//! §5.11.4 Decode partition.

use super::{TileDecoder, TileError, TileResult};
use crate::entropy::cdf::Cdf;
use crate::tables::block_size::{
    BLOCK_8X8, BLOCK_128X128, BLOCK_INVALID, MI_HEIGHT_LOG2, MI_WIDTH_LOG2, NUM_4X4_BLOCKS_WIDE,
    PARTITION_HORZ, PARTITION_HORZ_4, PARTITION_HORZ_A, PARTITION_HORZ_B, PARTITION_NONE,
    PARTITION_SPLIT, PARTITION_SUBSIZE, PARTITION_VERT, PARTITION_VERT_4, PARTITION_VERT_A,
    PARTITION_VERT_B, SUBSAMPLED_SIZE,
};

impl TileDecoder<'_> {
    /// §5.11.4 `decode_partition`.
    pub(super) fn decode_partition(&mut self, r: u32, c: u32, size: u8) -> TileResult<()> {
        let (mi_rows, mi_cols) = (
            self.frame.header.size.mi_rows,
            self.frame.header.size.mi_cols,
        );
        if r >= mi_rows || c >= mi_cols {
            return Ok(());
        }
        let half = u32::from(NUM_4X4_BLOCKS_WIDE[size as usize]) >> 1;
        let (has_rows, has_cols) = (r + half < mi_rows, c + half < mi_cols);
        let partition = if size < BLOCK_8X8 {
            PARTITION_NONE
        } else if has_rows || has_cols {
            self.read_partition(r, c, size, has_rows, has_cols)
        } else {
            PARTITION_SPLIT
        };
        let sub_size = PARTITION_SUBSIZE[partition as usize][size as usize];
        let color = &self.frame.sequence.color;
        let (x, y) = (color.subsampling_x as usize, color.subsampling_y as usize);
        if sub_size == BLOCK_INVALID || SUBSAMPLED_SIZE[sub_size as usize][x][y] == BLOCK_INVALID {
            let reason = "a partition gives chroma blocks of a shape that does not exist";
            return Err(TileError {
                section: "6.10.4",
                reason,
            });
        }
        if partition == PARTITION_SPLIT && size > BLOCK_8X8 {
            for (dr, dc) in [(0, 0), (0, half), (half, 0), (half, half)] {
                self.decode_partition(r + dr, c + dc, sub_size)?;
            }
            return Ok(());
        }
        let split_size = PARTITION_SUBSIZE[PARTITION_SPLIT as usize][size as usize];
        self.decode_parts(r, c, [sub_size, split_size], partition, half)
    }

    /// §5.11.4: the blocks of a node that is not split further.
    fn decode_parts(
        &mut self,
        r: u32,
        c: u32,
        [sub, split]: [u8; 2],
        partition: u8,
        half: u32,
    ) -> TileResult<()> {
        let (mi_rows, mi_cols) = (
            self.frame.header.size.mi_rows,
            self.frame.header.size.mi_cols,
        );
        let quarter = half >> 1;
        // A 4x4 block is a node of its own.
        let node = if partition == PARTITION_SPLIT {
            PARTITION_NONE
        } else {
            partition
        };
        let parts: [Option<(u32, u32, u8)>; 4] = match partition {
            PARTITION_NONE => [Some((0, 0, sub)), None, None, None],
            PARTITION_HORZ => [Some((0, 0, sub)), Some((half, 0, sub)), None, None],
            PARTITION_VERT => [Some((0, 0, sub)), Some((0, half, sub)), None, None],
            PARTITION_SPLIT => {
                [(0, 0), (0, half), (half, 0), (half, half)].map(|(y, x)| Some((y, x, sub)))
            }
            PARTITION_HORZ_A => [
                Some((0, 0, split)),
                Some((0, half, split)),
                Some((half, 0, sub)),
                None,
            ],
            PARTITION_HORZ_B => [
                Some((0, 0, sub)),
                Some((half, 0, split)),
                Some((half, half, split)),
                None,
            ],
            PARTITION_VERT_A => [
                Some((0, 0, split)),
                Some((half, 0, split)),
                Some((0, half, sub)),
                None,
            ],
            PARTITION_VERT_B => [
                Some((0, 0, sub)),
                Some((0, half, split)),
                Some((half, half, split)),
                None,
            ],
            PARTITION_HORZ_4 => [0, 1, 2, 3].map(|i| Some((quarter * i, 0, sub))),
            _ => [0, 1, 2, 3].map(|i| Some((0, quarter * i, sub))),
        };
        for (dr, dc, size) in parts.into_iter().flatten() {
            // Parts outside the frame are not coded; only HORZ, VERT, 4-way and 8x8 splits have any.
            if r + dr < mi_rows && c + dc < mi_cols {
                self.decode_block(r + dr, c + dc, size, node)?;
            }
        }
        Ok(())
    }

    /// §5.11.4, §8.3.2: `partition`, `split_or_horz` or `split_or_vert`.
    fn read_partition(&mut self, r: u32, c: u32, size: u8, has_rows: bool, has_cols: bool) -> u8 {
        let bsl = MI_WIDTH_LOG2[size as usize];
        let above = r > self.bounds.mi_row_start
            && MI_WIDTH_LOG2[self.block_at(r - 1, c).size as usize] < bsl;
        let left = c > self.bounds.mi_col_start
            && MI_HEIGHT_LOG2[self.block_at(r, c - 1).size as usize] < bsl;
        let context = usize::from(left) * 2 + usize::from(above);
        if has_rows && has_cols {
            let (symbols, cdfs) = (&mut self.symbols, &mut *self.cdfs);
            return match bsl {
                1 => symbols.symbol(&mut cdfs.partition_w8[context]),
                2 => symbols.symbol(&mut cdfs.partition_w16[context]),
                3 => symbols.symbol(&mut cdfs.partition_w32[context]),
                4 => symbols.symbol(&mut cdfs.partition_w64[context]),
                _ => symbols.symbol(&mut cdfs.partition_w128[context]),
            };
        }
        let cdfs = &self.cdfs;
        let has_4_way = size != BLOCK_128X128;
        let probability = match bsl {
            1 => edge_probability(&cdfs.partition_w8[context], has_cols, false),
            2 => edge_probability(&cdfs.partition_w16[context], has_cols, has_4_way),
            3 => edge_probability(&cdfs.partition_w32[context], has_cols, has_4_way),
            4 => edge_probability(&cdfs.partition_w64[context], has_cols, has_4_way),
            _ => edge_probability(&cdfs.partition_w128[context], has_cols, has_4_way),
        };
        match (self.symbols.split(probability), has_cols) {
            (true, _) => PARTITION_SPLIT,
            (false, true) => PARTITION_HORZ,
            (false, false) => PARTITION_VERT,
        }
    }
}

/// §8.3.2 `split_or_horz`, `split_or_vert`: the (inverse) probability that a node at the edge of the
/// frame is not split, from the live partition distribution.
fn edge_probability<const N: usize, const W: usize>(
    cdf: &Cdf<N, W>,
    is_horz: bool,
    has_4_way: bool,
) -> u16 {
    // Inverse storage: the probability of symbol s is inverse[s - 1] - inverse[s].
    let share = |symbol: u8| {
        let s = symbol as usize;
        if s >= N {
            return 0;
        }
        let lower = if s == N - 1 { 0 } else { cdf.inverse(s) };
        cdf.inverse(s - 1) - lower
    };
    let parts: &[u8] = if is_horz {
        &[
            PARTITION_VERT,
            PARTITION_SPLIT,
            PARTITION_HORZ_A,
            PARTITION_VERT_A,
            PARTITION_VERT_B,
        ]
    } else {
        &[
            PARTITION_HORZ,
            PARTITION_SPLIT,
            PARTITION_HORZ_A,
            PARTITION_HORZ_B,
            PARTITION_VERT_A,
        ]
    };
    let four_way = if is_horz {
        PARTITION_VERT_4
    } else {
        PARTITION_HORZ_4
    };
    let sum: u16 = parts.iter().map(|&part| share(part)).sum();
    // cdf[0] = 32768 - psum, kept inversely: psum.
    sum + if has_4_way { share(four_way) } else { 0 }
}
