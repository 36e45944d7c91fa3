//! §5.2: a stream of OBUs that carry their own sizes, split at temporal delimiters.

use std::io::Read;

use crate::bits::BitReader;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::memory;
use crate::obu::header::{ObuHeader, ObuType};

use super::Unit;
use super::source::Source;

/// Longest OBU header: two bytes and an `obu_size` of eight.
const MAX_HEADER_BYTES: usize = 10;

/// Reads OBUs up to the next temporal delimiter or the end.
pub(super) fn next_unit<R: Read>(source: &mut Source<R>, limits: &Limits) -> Result<Option<Unit>> {
    let byte_offset = source.position();
    let mut data = Vec::new();
    while let Some(next) = peek_obu(source)? {
        if next.is_temporal_delimiter && !data.is_empty() {
            break;
        }
        limits.check_unit_bytes(data.len() as u64 + next.bytes)?;
        let obu = source.take(next.bytes, "5.3.1", "an OBU")?;
        memory::reserve(&mut data, obu.len())?;
        data.extend_from_slice(&obu);
    }
    if data.is_empty() {
        return Ok(None);
    }
    Ok(Some(Unit {
        data,
        pts: None,
        byte_offset,
    }))
}

/// What the header of the next OBU says.
struct NextObu {
    is_temporal_delimiter: bool,
    /// Length with header.
    bytes: u64,
}

fn peek_obu<R: Read>(source: &mut Source<R>) -> Result<Option<NextObu>> {
    let position = source.position();
    let start = source.peek(MAX_HEADER_BYTES)?;
    if start.is_empty() {
        return Ok(None);
    }
    let mut reader = BitReader::new(start, position);
    let header = ObuHeader::parse(&mut reader)?;
    if !header.has_size {
        return Err(Error::malformed(
            "5.2",
            position,
            "an OBU has no size field",
        ));
    }
    let payload = u64::from(reader.leb128()?);
    Ok(Some(NextObu {
        is_temporal_delimiter: header.obu_type == ObuType::TemporalDelimiter,
        bytes: reader.byte_offset() - position + payload,
    }))
}
