//! §5.9.15, §5.9.16: the grid of tiles.

use crate::bits::BitReader;
use crate::error::Result;
use crate::limits::Limits;

use super::frame_size::FrameSize;

/// §3 `MAX_TILE_WIDTH`, luma samples.
const MAX_TILE_WIDTH: u32 = 4096;
/// §3 `MAX_TILE_AREA`, luma samples.
const MAX_TILE_AREA: u32 = 4096 * 2304;
/// §3 `MAX_TILE_COLS`.
const MAX_TILE_COLS: u32 = 64;
/// §3 `MAX_TILE_ROWS`.
const MAX_TILE_ROWS: u32 = 64;

/// §5.9.15 `tile_info`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct TileInfo {
    /// `TileCols`, 1 to 64.
    pub(crate) tile_cols: u32,
    /// `TileRows`, 1 to 64.
    pub(crate) tile_rows: u32,
    /// `TileColsLog2`.
    pub(crate) tile_cols_log2: u8,
    /// `TileRowsLog2`.
    pub(crate) tile_rows_log2: u8,
    pub(crate) uniform_tile_spacing: bool,
    /// `MiColStarts`: `tile_cols + 1` entries, the last one is `MiCols`.
    pub(crate) mi_col_starts: Vec<u32>,
    /// `MiRowStarts`: `tile_rows + 1` entries, the last one is `MiRows`.
    pub(crate) mi_row_starts: Vec<u32>,
    pub(crate) context_update_tile_id: u32,
    /// `TileSizeBytes`, 1 to 4; 0 if there is one tile and the field is absent.
    pub(crate) tile_size_bytes: u8,
}

/// §5.9.16 `tile_log2`.
fn tile_log2(block_size: u32, target: u32) -> u8 {
    (0..32)
        .find(|&k| u64::from(block_size) << k >= u64::from(target))
        .unwrap_or(32)
}

/// Frame and tile bounds in superblocks.
struct SuperblockGrid {
    /// log2 of the superblock size in 4x4 cells.
    shift: u32,
    columns: u32,
    rows: u32,
    max_tile_width: u32,
    min_log2_cols: u8,
    max_log2_cols: u8,
    max_log2_rows: u8,
    min_log2_tiles: u8,
}

impl SuperblockGrid {
    fn new(size: &FrameSize, use_128x128_superblock: bool) -> Self {
        let shift = if use_128x128_superblock { 5 } else { 4 };
        let columns = size.mi_cols.div_ceil(1 << shift);
        let rows = size.mi_rows.div_ceil(1 << shift);
        let size_log2 = shift + 2;
        let max_tile_width = MAX_TILE_WIDTH >> size_log2;
        let max_tile_area = MAX_TILE_AREA >> (2 * size_log2);
        let min_log2_cols = tile_log2(max_tile_width, columns);
        Self {
            shift,
            columns,
            rows,
            max_tile_width,
            min_log2_cols,
            max_log2_cols: tile_log2(1, columns.min(MAX_TILE_COLS)),
            max_log2_rows: tile_log2(1, rows.min(MAX_TILE_ROWS)),
            min_log2_tiles: min_log2_cols.max(tile_log2(max_tile_area, rows * columns)),
        }
    }
}

impl TileInfo {
    /// Reads `tile_info` of a frame of `size`.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        size: &FrameSize,
        use_128x128_superblock: bool,
        limits: &Limits,
    ) -> Result<Self> {
        let grid = SuperblockGrid::new(size, use_128x128_superblock);
        let mut tiles = Self {
            uniform_tile_spacing: reader.flag()?,
            ..Self::default()
        };
        if tiles.uniform_tile_spacing {
            tiles.parse_uniform(reader, &grid)?;
        } else {
            tiles.parse_explicit(reader, &grid)?;
        }
        tiles.tile_cols = count(&tiles.mi_col_starts);
        tiles.tile_rows = count(&tiles.mi_row_starts);
        tiles.mi_col_starts.push(size.mi_cols);
        tiles.mi_row_starts.push(size.mi_rows);
        if !tiles.uniform_tile_spacing {
            tiles.tile_cols_log2 = tile_log2(1, tiles.tile_cols);
            tiles.tile_rows_log2 = tile_log2(1, tiles.tile_rows);
        }
        limits.check_tiles(tiles.num_tiles())?;
        tiles.parse_context_update(reader)?;
        Ok(tiles)
    }

    /// `NumTiles`.
    pub(crate) fn num_tiles(&self) -> u32 {
        self.tile_cols * self.tile_rows
    }

    fn parse_uniform(&mut self, reader: &mut BitReader<'_>, grid: &SuperblockGrid) -> Result<()> {
        let cols_log2 = read_log2(reader, grid.min_log2_cols, grid.max_log2_cols)?;
        let min_log2_rows = grid.min_log2_tiles.saturating_sub(cols_log2);
        let rows_log2 = read_log2(reader, min_log2_rows, grid.max_log2_rows)?;
        self.tile_cols_log2 = cols_log2;
        self.tile_rows_log2 = rows_log2;
        self.mi_col_starts = uniform_starts(grid.columns, cols_log2, grid.shift);
        self.mi_row_starts = uniform_starts(grid.rows, rows_log2, grid.shift);
        Ok(())
    }

    fn parse_explicit(&mut self, reader: &mut BitReader<'_>, grid: &SuperblockGrid) -> Result<()> {
        let (starts, widest_tile) = explicit_starts(reader, grid.columns, grid.max_tile_width)?;
        self.mi_col_starts = starts.iter().map(|start| start << grid.shift).collect();
        let area = grid.rows * grid.columns;
        let max_tile_area = if grid.min_log2_tiles > 0 {
            area >> (grid.min_log2_tiles + 1)
        } else {
            area
        };
        let max_tile_height = (max_tile_area / widest_tile).max(1);
        let (starts, _) = explicit_starts(reader, grid.rows, max_tile_height)?;
        self.mi_row_starts = starts.iter().map(|start| start << grid.shift).collect();
        Ok(())
    }

    fn parse_context_update(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        let bits = u32::from(self.tile_rows_log2 + self.tile_cols_log2);
        if bits == 0 {
            return Ok(());
        }
        self.context_update_tile_id = reader.f(bits)?;
        if self.context_update_tile_id >= self.num_tiles() {
            return Err(reader.malformed("6.8.14", "context_update_tile_id names no tile"));
        }
        self.tile_size_bytes = reader.f8(2)? + 1;
        Ok(())
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "there are at most 64 tiles in one direction"
)]
fn count(starts: &[u32]) -> u32 {
    starts.len() as u32
}

/// Reads increments of a log2 from `minimum` until one is 0 or `maximum` is reached.
fn read_log2(reader: &mut BitReader<'_>, minimum: u8, maximum: u8) -> Result<u8> {
    let mut log2 = minimum;
    while log2 < maximum && reader.flag()? {
        log2 += 1;
    }
    Ok(log2)
}

/// First cells of equal tiles; the last tile may be smaller.
fn uniform_starts(superblocks: u32, log2: u8, shift: u32) -> Vec<u32> {
    let tile_size = superblocks.div_ceil(1 << log2).max(1);
    (0..superblocks)
        .step_by(tile_size as usize)
        .map(|start| start << shift)
        .collect()
}

/// First superblocks of tiles with coded sizes, and the largest size.
fn explicit_starts(
    reader: &mut BitReader<'_>,
    superblocks: u32,
    max_size: u32,
) -> Result<(Vec<u32>, u32)> {
    let mut starts = Vec::new();
    let mut largest = 1;
    let mut start = 0;
    while start < superblocks {
        if count(&starts) >= MAX_TILE_COLS {
            return Err(reader.malformed("6.8.14", "more than 64 tiles in one direction"));
        }
        starts.push(start);
        let size = reader.ns((superblocks - start).min(max_size))? + 1;
        largest = largest.max(size);
        start += size;
    }
    Ok((starts, largest))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(width: u32, height: u32) -> FrameSize {
        FrameSize {
            mi_cols: 2 * width.div_ceil(8),
            mi_rows: 2 * height.div_ceil(8),
            ..FrameSize::default()
        }
    }

    fn parse(bits: &[u8], size: &FrameSize, use_128: bool) -> Result<(TileInfo, usize)> {
        let mut reader = BitReader::new(bits, 0);
        let tiles = TileInfo::parse(&mut reader, size, use_128, &Limits::default())?;
        Ok((tiles, reader.position()))
    }

    #[test]
    fn tile_log2_rounds_up() {
        assert_eq!(tile_log2(1, 1), 0);
        assert_eq!(tile_log2(1, 5), 3);
        assert_eq!(tile_log2(64, 64), 0);
        assert_eq!(tile_log2(64, 65), 1);
    }

    #[test]
    fn a_single_superblock_needs_one_bit_only() {
        let (tiles, bits) = parse(&[0x80], &size(64, 64), false).unwrap();
        assert_eq!((tiles.tile_cols, tiles.tile_rows), (1, 1));
        assert_eq!(tiles.mi_col_starts, [0, 16]);
        assert_eq!(bits, 1);
    }

    #[test]
    fn uniform_spacing_can_give_fewer_tiles_than_its_power_of_two() {
        // 5 superblock columns, log2 2: tiles of 2, 2 and 1.
        // uniform 1, cols 110, (one row) context id 01, size bytes 11.
        let (tiles, bits) = parse(&[0b1110_0111], &size(320, 64), false).unwrap();
        assert_eq!(tiles.tile_cols, 3);
        assert_eq!(tiles.tile_cols_log2, 2);
        assert_eq!(tiles.mi_col_starts, [0, 32, 64, 80]);
        assert_eq!(tiles.context_update_tile_id, 1);
        assert_eq!(tiles.tile_size_bytes, 4);
        assert_eq!(bits, 8);
    }

    #[test]
    fn explicit_tiles_add_up_to_the_frame() {
        // 3x2 superblocks of 128. uniform 0; width ns(3) = 1 ("10"), width ns(1);
        // height ns(2) = 0 ("0"), height ns(1); id 2 bits, bytes 2 bits.
        let (tiles, bits) = parse(&[0b0100_1000], &size(384, 256), true).unwrap();
        assert_eq!(tiles.mi_col_starts, [0, 64, 96]);
        assert_eq!(tiles.mi_row_starts, [0, 32, 64]);
        assert_eq!((tiles.tile_cols_log2, tiles.tile_rows_log2), (1, 1));
        assert_eq!(tiles.context_update_tile_id, 2);
        assert_eq!(tiles.tile_size_bytes, 1);
        assert_eq!(bits, 8);
    }

    #[test]
    fn a_context_tile_outside_the_grid_is_malformed() {
        // As in the test above on spacing, with id 3 of 3 tiles.
        assert!(parse(&[0b1110_1111], &size(320, 64), false).is_err());
    }

    #[test]
    fn very_wide_frames_are_split_whatever_the_bits_say() {
        let (tiles, _) = parse(&[0x80, 0, 0], &size(8192, 64), false).unwrap();
        assert_eq!(tiles.tile_cols, 2);
    }

    #[test]
    fn too_many_tiles_exceed_the_limit() {
        let limits = Limits {
            max_tiles: 2,
            ..Limits::default()
        };
        let mut reader = BitReader::new(&[0b1110_0111], 0);
        let result = TileInfo::parse(&mut reader, &size(320, 64), false, &limits);
        assert!(matches!(
            result,
            Err(crate::error::Error::LimitExceeded { value: 3, .. })
        ));
    }
}
