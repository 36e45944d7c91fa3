//! Which container a file is, from its first bytes.

use crate::bits::BitReader;
use crate::error::{Error, Result};
use crate::obu::header::{ObuHeader, ObuType};

use super::ContainerKind;

/// Bytes that [`probe`] wants to see: three sizes of at most 8 bytes and an OBU header with its
/// own.
pub(super) const PROBE_BYTES: usize = 64;

/// Kind of the file that starts with `start` (fewer than [`PROBE_BYTES`] bytes if it is shorter).
pub(super) fn probe(start: &[u8]) -> Result<ContainerKind> {
    if start.is_empty() {
        return Err(Error::malformed("5.2", 0, "the file is empty"));
    }
    if start.starts_with(b"DKIF") {
        return Ok(ContainerKind::Ivf);
    }
    if is_section5(start).unwrap_or(false) {
        return Ok(ContainerKind::Section5);
    }
    if is_annexb(start).unwrap_or(false) {
        return Ok(ContainerKind::AnnexB);
    }
    if let Some(name) = foreign_container(start) {
        return Err(Error::Unsupported {
            feature: format!("the {name} container (demultiplex it into packets first)"),
            section: "5.2",
        });
    }
    Err(Error::malformed(
        "5.2",
        0,
        "this is no AV1 stream: neither IVF, nor an OBU stream (Section 5), nor Annex B",
    ))
}

/// §7.5: a stream starts with a temporal delimiter, which is empty and has a size field.
fn is_section5(start: &[u8]) -> Result<bool> {
    let mut reader = BitReader::new(start, 0);
    let header = ObuHeader::parse(&mut reader)?;
    Ok(header.obu_type == ObuType::TemporalDelimiter && header.has_size && reader.leb128()? == 0)
}

/// Annex B: three nested sizes, then a temporal delimiter.
fn is_annexb(start: &[u8]) -> Result<bool> {
    let mut reader = BitReader::new(start, 0);
    let temporal_unit_size = u64::from(reader.leb128()?);
    let unit_start = reader.byte_offset();
    let frame_unit_size = u64::from(reader.leb128()?);
    let frame_start = reader.byte_offset();
    let obu_length = u64::from(reader.leb128()?);
    let obu_start = reader.byte_offset();
    let header = ObuHeader::parse(&mut reader)?;
    let size = if header.has_size { reader.leb128()? } else { 0 };
    let header_length = reader.byte_offset() - obu_start;
    Ok(header.obu_type == ObuType::TemporalDelimiter
        && size == 0
        && obu_length == header_length
        && frame_start + frame_unit_size <= unit_start + temporal_unit_size
        && obu_start + obu_length <= frame_start + frame_unit_size)
}

/// Containers that are not read here, to say so instead of calling them damaged.
fn foreign_container(start: &[u8]) -> Option<&'static str> {
    if start.get(4..8) == Some(b"ftyp") {
        return Some("MP4");
    }
    if start.starts_with(&[0x1a, 0x45, 0xdf, 0xa3]) {
        return Some("Matroska or WebM");
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_containers_are_named() {
        let error = probe(b"\0\0\0\x20ftypisom").unwrap_err();
        assert!(error.to_string().contains("MP4"), "{error}");
        let error = probe(&[0x1a, 0x45, 0xdf, 0xa3, 0x01]).unwrap_err();
        assert!(error.to_string().contains("Matroska"), "{error}");
    }

    #[test]
    fn text_and_nothing_are_no_streams() {
        assert!(matches!(probe(b""), Err(Error::Malformed { .. })));
        let text = probe(b"frame,x,y\n0,1,2\n");
        assert!(matches!(text, Err(Error::Malformed { .. })));
    }
}
