//! §5.11.1: where the tiles of a tile group lie.

use std::ops::Range;

use crate::bits::BitReader;
use crate::error::Result;

use super::tile_info::TileInfo;

/// One tile: its number and its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TileData {
    /// `TileNum`, in raster order.
    pub(crate) tile_num: u32,
    /// Position of the coded tile inside the data handed to [`TileGroup::parse`].
    pub(crate) range: Range<usize>,
}

/// §5.11.1 `tile_group_obu` without the tiles' content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TileGroup {
    pub(crate) tg_start: u32,
    pub(crate) tg_end: u32,
    pub(crate) tiles: Vec<TileData>,
}

impl TileGroup {
    /// Reads a tile group. `data` is the payload of a tile group OBU, or what follows the header
    /// and its byte alignment in a frame OBU; `byte_offset` is the offset of its first byte for
    /// error messages. `next_tile` is the tile that must come next in this frame.
    pub(crate) fn parse(
        data: &[u8],
        byte_offset: u64,
        tile_info: &TileInfo,
        next_tile: u32,
    ) -> Result<Self> {
        let mut reader = BitReader::new(data, byte_offset);
        let num_tiles = tile_info.num_tiles();
        let tile_start_and_end_present = num_tiles > 1 && reader.flag()?;
        let (tg_start, tg_end) = if tile_start_and_end_present {
            let bits = u32::from(tile_info.tile_cols_log2 + tile_info.tile_rows_log2);
            (reader.f(bits)?, reader.f(bits)?)
        } else {
            (0, num_tiles.saturating_sub(1))
        };
        if tg_start != next_tile || tg_end < tg_start || tg_end >= num_tiles {
            return Err(reader.malformed(
                "6.10.1",
                format!(
                    "a tile group has tiles {tg_start} to {tg_end}, but tile {next_tile} of \
                     {num_tiles} comes next"
                ),
            ));
        }
        reader.byte_alignment()?;
        let mut tiles = Vec::new();
        for tile_num in tg_start..=tg_end {
            let is_last = tile_num == tg_end;
            let range = read_tile(&mut reader, tile_info, is_last)?;
            tiles.push(TileData { tile_num, range });
        }
        Ok(Self {
            tg_start,
            tg_end,
            tiles,
        })
    }

    /// Whether the frame is complete after this group.
    pub(crate) fn is_last(&self, tile_info: &TileInfo) -> bool {
        self.tg_end + 1 == tile_info.num_tiles()
    }
}

/// Bytes of one tile; the last one of a group has the rest.
fn read_tile(
    reader: &mut BitReader<'_>,
    tile_info: &TileInfo,
    is_last: bool,
) -> Result<Range<usize>> {
    let size = if is_last {
        reader.remaining() / 8
    } else {
        let tile_size_minus_1 = reader.le(tile_info.tile_size_bytes.into())?;
        tile_size_minus_1 as usize + 1
    };
    if size == 0 || size > reader.remaining() / 8 {
        return Err(reader.malformed(
            "5.11.1",
            format!(
                "a tile of {size} bytes, but {} bytes are left",
                reader.remaining() / 8
            ),
        ));
    }
    let start = reader.position() / 8;
    reader.skip_bytes(size);
    Ok(start..start + size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn four_tiles() -> TileInfo {
        TileInfo {
            tile_cols: 2,
            tile_rows: 2,
            tile_cols_log2: 1,
            tile_rows_log2: 1,
            tile_size_bytes: 2,
            ..TileInfo::default()
        }
    }

    #[test]
    fn sizes_are_little_endian_minus_one_and_absent_from_the_last_tile() {
        // start_and_end 0, alignment; sizes 1, 2, 1, then the rest.
        let data = [
            0, 0, 0, 0xa0, 1, 0, 0xb0, 0xb1, 0, 0, 0xc0, 0xd0, 0xd1, 0xd2,
        ];
        let group = TileGroup::parse(&data, 0, &four_tiles(), 0).unwrap();
        let ranges: Vec<_> = group.tiles.iter().map(|tile| tile.range.clone()).collect();
        assert_eq!(ranges, [3..4, 6..8, 10..11, 11..14]);
        assert!(group.is_last(&four_tiles()));
    }

    #[test]
    fn a_group_continues_where_the_previous_one_ended() {
        // start_and_end 1, start 01, end 10.
        let data = [0b1011_0000, 0, 0, 0xb0, 0xc0];
        let group = TileGroup::parse(&data, 0, &four_tiles(), 1).unwrap();
        assert_eq!((group.tg_start, group.tg_end), (1, 2));
        assert_eq!(group.tiles[1].tile_num, 2);
        assert!(!group.is_last(&four_tiles()));
        assert!(TileGroup::parse(&data, 0, &four_tiles(), 2).is_err());
    }

    #[test]
    fn empty_and_overlong_tiles_are_malformed() {
        assert!(TileGroup::parse(&[0, 9, 0, 0xa0], 0, &four_tiles(), 0).is_err());
        let one_tile = TileInfo {
            tile_cols: 1,
            tile_rows: 1,
            ..TileInfo::default()
        };
        assert!(TileGroup::parse(&[], 0, &one_tile, 0).is_err());
        let whole = TileGroup::parse(&[1, 2], 0, &one_tile, 0).unwrap();
        assert_eq!(whole.tiles[0].range, 0..2);
    }
}
