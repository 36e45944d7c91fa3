//! IVF: a 32-byte header, then packets with size and time.

use std::io::Read;

use crate::error::{Error, Result};
use crate::limits::Limits;

use super::Unit;
use super::source::Source;

/// Name of the format in error messages, in place of a section.
const SECTION: &str = "IVF";
const HEADER_BYTES: u64 = 32;
const PACKET_HEADER_BYTES: u64 = 12;

/// The file header.
#[derive(Debug)]
pub(super) struct Ivf {
    width: u16,
    height: u16,
    /// Time units per second, as a fraction.
    rate: u32,
    scale: u32,
}

impl Ivf {
    /// Reads the file header; `source` starts with its magic.
    pub(super) fn read_header<R: Read>(source: &mut Source<R>) -> Result<Self> {
        let bytes = source.take(HEADER_BYTES, SECTION, "the IVF header")?;
        let header_length = u64::from(u16_at(&bytes, 6));
        if header_length < HEADER_BYTES {
            let reason = format!("the IVF header claims {header_length} bytes");
            return Err(Error::malformed(SECTION, 6, reason));
        }
        if &bytes[8..12] != b"AV01" {
            return Err(Error::Unsupported {
                feature: format!("codec {:?}", String::from_utf8_lossy(&bytes[8..12])),
                section: SECTION,
            });
        }
        source.take(header_length - HEADER_BYTES, SECTION, "the IVF header")?;
        Ok(Self {
            width: u16_at(&bytes, 12),
            height: u16_at(&bytes, 14),
            rate: u32_at(&bytes, 16),
            scale: u32_at(&bytes, 20),
        })
    }

    /// Seconds per time unit, as a fraction; `None` if the header has zeros.
    pub(super) fn time_base(&self) -> Option<(u32, u32)> {
        (self.rate > 0 && self.scale > 0).then_some((self.scale, self.rate))
    }

    pub(super) fn size(&self) -> (u32, u32) {
        (self.width.into(), self.height.into())
    }
}

/// Reads one packet.
pub(super) fn next_unit<R: Read>(source: &mut Source<R>, limits: &Limits) -> Result<Option<Unit>> {
    if source.peek(1)?.is_empty() {
        return Ok(None);
    }
    let header = source.take(PACKET_HEADER_BYTES, SECTION, "an IVF packet header")?;
    let size = u64::from(u32_at(&header, 0));
    limits.check_unit_bytes(size)?;
    let pts = u64::from(u32_at(&header, 8)) << 32 | u64::from(u32_at(&header, 4));
    let byte_offset = source.position();
    Ok(Some(Unit {
        data: source.take(size, SECTION, "an IVF packet")?,
        pts: Some(pts.cast_signed()),
        byte_offset,
    }))
}

fn u16_at(bytes: &[u8], offset: usize) -> u16 {
    u16::from_le_bytes([bytes[offset], bytes[offset + 1]])
}

fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    u32::from(u16_at(bytes, offset + 2)) << 16 | u32::from(u16_at(bytes, offset))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(codec: [u8; 4], length: u8) -> Vec<u8> {
        let mut bytes = b"DKIF\0\0".to_vec();
        bytes.extend([length, 0]);
        bytes.extend(codec);
        bytes.resize(usize::from(length.max(32)), 0);
        bytes
    }

    #[test]
    fn other_codecs_are_unsupported() {
        let bytes = header(*b"VP90", 32);
        let error = Ivf::read_header(&mut Source::new(&bytes[..])).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }));
        assert!(error.to_string().contains("VP90"));
    }

    #[test]
    fn a_longer_header_is_skipped_and_a_shorter_one_refused() {
        let bytes = header(*b"AV01", 40);
        let mut source = Source::new(&bytes[..]);
        let ivf = Ivf::read_header(&mut source).unwrap();
        assert_eq!(source.position(), 40);
        assert_eq!(ivf.time_base(), None);
        let bytes = header(*b"AV01", 31);
        assert!(Ivf::read_header(&mut Source::new(&bytes[..])).is_err());
    }
}
