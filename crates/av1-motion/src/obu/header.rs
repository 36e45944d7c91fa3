//! §5.3: OBU headers and the walk over the OBUs of one unit.

use std::ops::Range;

use crate::bits::BitReader;
use crate::error::{Error, Result};

/// §6.2.2 `obu_type`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ObuType {
    SequenceHeader,
    TemporalDelimiter,
    FrameHeader,
    TileGroup,
    Metadata,
    Frame,
    RedundantFrameHeader,
    TileList,
    Padding,
    /// 0 and 9 to 14: ignored by decoders.
    Reserved(u8),
}

impl From<u8> for ObuType {
    fn from(number: u8) -> Self {
        match number {
            1 => Self::SequenceHeader,
            2 => Self::TemporalDelimiter,
            3 => Self::FrameHeader,
            4 => Self::TileGroup,
            5 => Self::Metadata,
            6 => Self::Frame,
            7 => Self::RedundantFrameHeader,
            8 => Self::TileList,
            15 => Self::Padding,
            other => Self::Reserved(other),
        }
    }
}

/// §5.3.2, §5.3.3: `obu_header` and `obu_extension_header`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ObuHeader {
    pub(crate) obu_type: ObuType,
    /// `obu_extension_flag`.
    pub(crate) has_extension: bool,
    /// `obu_has_size_field`.
    pub(crate) has_size: bool,
    /// 0 without an extension.
    pub(crate) temporal_id: u8,
    /// 0 without an extension.
    pub(crate) spatial_id: u8,
}

impl ObuHeader {
    /// Reads one or two bytes.
    pub(crate) fn parse(reader: &mut BitReader<'_>) -> Result<Self> {
        if reader.flag()? {
            return Err(reader.malformed("6.2.2", "obu_forbidden_bit is 1"));
        }
        let obu_type = ObuType::from(reader.f8(4)?);
        let has_extension = reader.flag()?;
        let has_size = reader.flag()?;
        let _obu_reserved_1bit = reader.flag()?;
        let (mut temporal_id, mut spatial_id) = (0, 0);
        if has_extension {
            temporal_id = reader.f8(3)?;
            spatial_id = reader.f8(2)?;
            let _extension_header_reserved_3bits = reader.f(3)?;
        }
        Ok(Self {
            obu_type,
            has_extension,
            has_size,
            temporal_id,
            spatial_id,
        })
    }

    /// Length in bytes of the header, without `obu_size`.
    pub(crate) fn length(self) -> usize {
        1 + usize::from(self.has_extension)
    }

    /// §5.3.1: whether the operating point `idc` leaves this OBU out (`drop_obu`).
    pub(crate) fn is_dropped(self, idc: u16) -> bool {
        let layer_independent = matches!(
            self.obu_type,
            ObuType::SequenceHeader | ObuType::TemporalDelimiter
        );
        if layer_independent || idc == 0 || !self.has_extension {
            return false;
        }
        let in_temporal_layer = (idc >> self.temporal_id) & 1 == 1;
        let in_spatial_layer = (idc >> (self.spatial_id + 8)) & 1 == 1;
        !in_temporal_layer || !in_spatial_layer
    }
}

/// One OBU of a unit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Obu {
    pub(crate) header: ObuHeader,
    /// Position of the payload inside the unit.
    pub(crate) payload: Range<usize>,
    /// Offset of the OBU's first byte: the unit's base offset plus its place in the unit.
    pub(crate) byte_offset: u64,
}

/// §5.3.1: walks over the OBUs of a unit in the low-overhead format. `obu_size` may be absent from
/// the last one, which then reaches to the unit's end. Stops after the first error.
#[derive(Debug, Clone)]
pub(crate) struct ObuIterator<'a> {
    data: &'a [u8],
    position: usize,
    base_offset: u64,
}

impl<'a> ObuIterator<'a> {
    /// Walks over `data`, whose first byte is byte `base_offset` in error messages.
    pub(crate) fn new(data: &'a [u8], base_offset: u64) -> Self {
        Self {
            data,
            position: 0,
            base_offset,
        }
    }

    /// Begins at `position`, where an OBU starts.
    pub(crate) fn starting_at(self, position: usize) -> Self {
        Self { position, ..self }
    }

    /// The end of the last OBU, or of the data after an error.
    pub(crate) fn position(&self) -> usize {
        self.position
    }

    fn read(&mut self) -> Result<Obu> {
        let byte_offset = self.base_offset + self.position as u64;
        let rest = &self.data[self.position..];
        let mut reader = BitReader::new(rest, byte_offset);
        let header = ObuHeader::parse(&mut reader)?;
        let size = if header.has_size {
            reader.leb128()? as usize
        } else {
            rest.len() - header.length()
        };
        let start = self.position + reader.position() / 8;
        if size > self.data.len() - start {
            return Err(Error::malformed(
                "5.3.1",
                byte_offset,
                format!(
                    "obu_size is {size}, but only {} bytes follow",
                    self.data.len() - start
                ),
            ));
        }
        self.position = start + size;
        Ok(Obu {
            header,
            payload: start..start + size,
            byte_offset,
        })
    }
}

impl Iterator for ObuIterator<'_> {
    type Item = Result<Obu>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.position >= self.data.len() {
            return None;
        }
        let obu = self.read();
        if obu.is_err() {
            self.position = self.data.len();
        }
        Some(obu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_obu_may_omit_its_size() {
        let unit = [0x12, 0x00, 0x36, 0x48, 0x02, 0xaa, 0xbb, 0x30, 0xcc, 0xdd];
        let obus: Vec<Obu> = ObuIterator::new(&unit, 7).map(Result::unwrap).collect();
        assert_eq!(obus.len(), 3);
        assert_eq!(obus[0].header.obu_type, ObuType::TemporalDelimiter);
        assert_eq!(obus[0].payload, 2..2);
        assert_eq!(obus[1].header.temporal_id, 2);
        assert_eq!(obus[1].header.spatial_id, 1);
        assert_eq!(obus[1].payload, 5..7);
        assert_eq!(obus[2].header.obu_type, ObuType::Frame);
        assert_eq!(obus[2].payload, 8..10);
        assert_eq!(obus[2].byte_offset, 14);
    }

    #[test]
    fn the_walk_ends_at_the_first_error() {
        let too_long = [0x12, 0x00, 0x32, 0x05, 0x00];
        let mut walk = ObuIterator::new(&too_long, 0);
        assert!(walk.next().unwrap().is_ok());
        assert!(walk.next().unwrap().is_err());
        assert!(walk.next().is_none());
        assert!(ObuIterator::new(&[0x92, 0x00], 0).next().unwrap().is_err());
    }

    #[test]
    fn an_operating_point_drops_only_obus_with_other_layers() {
        let mut header = ObuHeader {
            obu_type: ObuType::Frame,
            has_extension: true,
            has_size: true,
            temporal_id: 1,
            spatial_id: 0,
        };
        assert!(!header.is_dropped(0));
        assert!(!header.is_dropped(0x103));
        assert!(header.is_dropped(0x101));
        assert!(header.is_dropped(0x202));
        header.has_extension = false;
        assert!(!header.is_dropped(0x101));
        header.has_extension = true;
        header.obu_type = ObuType::SequenceHeader;
        assert!(!header.is_dropped(0x101));
    }
}
