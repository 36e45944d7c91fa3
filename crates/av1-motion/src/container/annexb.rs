//! Annex B: temporal units, frame units and OBUs with lengths.

use std::io::Read;

use crate::bits::BitReader;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::memory;
use crate::obu::header::ObuHeader;

use super::Unit;
use super::source::Source;

/// §4.10.5: longest leb128 number.
const MAX_LEB128_BYTES: usize = 8;

/// `obu_has_size_field` in the first byte of an OBU.
const HAS_SIZE_FIELD: u8 = 1 << 1;

/// Reads one temporal unit and gives each OBU a size field.
pub(super) fn next_unit<R: Read>(source: &mut Source<R>, limits: &Limits) -> Result<Option<Unit>> {
    let position = source.position();
    let start = source.peek(MAX_LEB128_BYTES)?;
    if start.is_empty() {
        return Ok(None);
    }
    let mut reader = BitReader::new(start, position);
    let size = u64::from(reader.leb128()?);
    let size_bytes = reader.position() / 8;
    source.skip(size_bytes);
    limits.check_unit_bytes(size)?;
    let byte_offset = source.position();
    let unit = source.take(size, "B.2", "a temporal unit")?;
    Ok(Some(Unit {
        data: add_size_fields(&unit, byte_offset)?,
        pts: None,
        byte_offset,
    }))
}

/// The OBUs of a temporal unit in the low-overhead format.
fn add_size_fields(unit: &[u8], byte_offset: u64) -> Result<Vec<u8>> {
    // The result is no longer: sizes of frame units go, and a size field replaces `obu_length`.
    let mut normalized = Vec::new();
    memory::reserve(&mut normalized, unit.len())?;
    let mut rest = unit;
    while !rest.is_empty() {
        let offset = byte_offset + (unit.len() - rest.len()) as u64;
        let (mut frame, after) = split_sized(rest, offset, "frame_unit_size")?;
        rest = after;
        let frame_end = byte_offset + (unit.len() - rest.len()) as u64;
        while !frame.is_empty() {
            let offset = frame_end - frame.len() as u64;
            let (obu, after) = split_sized(frame, offset, "obu_length")?;
            frame = after;
            let offset = frame_end - (frame.len() + obu.len()) as u64;
            append_obu(&mut normalized, obu, offset)?;
        }
    }
    Ok(normalized)
}

/// Splits `data` after the part whose length stands in front of it.
fn split_sized<'d>(
    data: &'d [u8],
    byte_offset: u64,
    name: &'static str,
) -> Result<(&'d [u8], &'d [u8])> {
    let mut reader = BitReader::new(data, byte_offset);
    let size = reader.leb128()? as usize;
    let rest = &data[reader.position() / 8..];
    rest.split_at_checked(size).ok_or_else(|| {
        let reason = format!("{name} is {size}, but {} bytes are left", rest.len());
        Error::malformed("B.2", byte_offset, reason)
    })
}

fn append_obu(normalized: &mut Vec<u8>, obu: &[u8], byte_offset: u64) -> Result<()> {
    let mut reader = BitReader::new(obu, byte_offset);
    let header = ObuHeader::parse(&mut reader)?;
    let (header_bytes, mut payload) = obu.split_at(header.length());
    if header.has_size {
        let size = reader.leb128()? as usize;
        payload = &obu[reader.position() / 8..];
        if payload.len() != size {
            let reason = format!(
                "obu_length leaves {} bytes of payload, but obu_size is {size}",
                payload.len()
            );
            return Err(Error::malformed("B.3", byte_offset, reason));
        }
    }
    normalized.push(header_bytes[0] | HAS_SIZE_FIELD);
    normalized.extend_from_slice(&header_bytes[1..]);
    append_leb128(normalized, payload.len());
    normalized.extend_from_slice(payload);
    Ok(())
}

/// §4.10.5, backwards.
#[expect(clippy::cast_possible_truncation, reason = "seven bits at a time")]
fn append_leb128(bytes: &mut Vec<u8>, value: usize) {
    let mut rest = value;
    while rest >= 0x80 {
        bytes.push((rest & 0x7f) as u8 | 0x80);
        rest >>= 7;
    }
    bytes.push((rest & 0x7f) as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obus_of_several_frame_units_follow_each_other() {
        // Two frame units: [delimiter, padding with an extension], [padding of 1 byte].
        let unit = [6, 1, 0x10, 3, 0x7c, 0x08, 0x80, 3, 2, 0x78, 0x80];
        let normalized = add_size_fields(&unit, 0).unwrap();
        assert_eq!(
            normalized,
            [
                0x12, 0x00, // delimiter
                0x7e, 0x08, 0x01, 0x80, // padding with an extension
                0x7a, 0x01, 0x80
            ]
        );
    }

    #[test]
    fn contradicting_sizes_are_malformed() {
        assert!(add_size_fields(&[4, 3, 0x7a, 0x02, 0x80], 0).is_err());
        assert!(add_size_fields(&[4, 9, 0x78, 0x80, 0x80], 0).is_err());
        assert!(add_size_fields(&[9, 3, 0x78], 0).is_err());
        assert!(add_size_fields(&[1, 0], 0).is_err());
    }

    #[test]
    fn long_payloads_get_long_sizes() {
        let mut bytes = Vec::new();
        append_leb128(&mut bytes, 300);
        assert_eq!(bytes, [0xac, 0x02]);
    }
}
