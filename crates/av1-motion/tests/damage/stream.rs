//! Just enough of IVF and OBUs to take a stream apart and put it together again.

use std::ops::Range;

/// Bytes of an IVF file header and of a packet header.
const IVF_HEADER: usize = 32;
const PACKET_HEADER: usize = 12;

/// `obu_has_size_field` and `obu_extension_flag` in the first byte of an OBU.
const HAS_SIZE: u8 = 2;
const HAS_EXTENSION: u8 = 4;

/// §5.3.1: one OBU without its size.
#[derive(Clone, Debug)]
pub struct Obu {
    /// The first byte.
    pub header: u8,
    pub extension: Option<u8>,
    pub payload: Vec<u8>,
}

impl Obu {
    pub fn kind(&self) -> u8 {
        (self.header >> 3) & 15
    }

    /// Sequence header, frame header, redundant frame header or frame.
    pub fn has_header_fields(&self) -> bool {
        matches!(self.kind(), 1 | 3 | 6 | 7)
    }
}

/// An IVF stream in parts.
#[derive(Clone, Debug)]
pub struct Stream {
    pub ivf_header: Vec<u8>,
    pub units: Vec<Vec<Obu>>,
}

/// How a stream is written.
#[derive(Clone, Copy, Debug)]
pub enum Form {
    Ivf,
    Section5,
    AnnexB,
}

/// Where the data of each packet of an IVF file lies.
pub fn packet_ranges(bytes: &[u8]) -> Vec<Range<usize>> {
    let (mut ranges, mut at) = (Vec::new(), IVF_HEADER);
    while let Some(size) = bytes.get(at..at + 4) {
        let size = u32::from_le_bytes(size.try_into().expect("four bytes")) as usize;
        let start = at + PACKET_HEADER;
        if start + size > bytes.len() {
            break;
        }
        ranges.push(start..start + size);
        at = start + size;
    }
    ranges
}

/// Takes an IVF file apart; nothing if it is not one with whole OBUs.
pub fn split(bytes: &[u8]) -> Option<Stream> {
    if !bytes.starts_with(b"DKIF") || bytes.len() < IVF_HEADER {
        return None;
    }
    let units: Option<Vec<_>> = packet_ranges(bytes)
        .into_iter()
        .map(|range| split_obus(&bytes[range]))
        .collect();
    Some(Stream {
        ivf_header: bytes[..IVF_HEADER].to_vec(),
        units: units.filter(|units| !units.is_empty())?,
    })
}

fn split_obus(mut data: &[u8]) -> Option<Vec<Obu>> {
    let mut obus = Vec::new();
    while let Some((&header, rest)) = data.split_first() {
        let (extension, rest) = if header & HAS_EXTENSION == 0 {
            (None, rest)
        } else {
            let (&extension, rest) = rest.split_first()?;
            (Some(extension), rest)
        };
        let (size, rest) = if header & HAS_SIZE == 0 {
            (rest.len(), rest)
        } else {
            read_leb128(rest)?
        };
        let (payload, rest) = rest.split_at_checked(size)?;
        data = rest;
        obus.push(Obu {
            header,
            extension,
            payload: payload.to_vec(),
        });
    }
    Some(obus)
}

fn read_leb128(data: &[u8]) -> Option<(usize, &[u8])> {
    let mut value = 0;
    for (index, &byte) in data.iter().take(4).enumerate() {
        value |= usize::from(byte & 0x7f) << (7 * index);
        if byte & 0x80 == 0 {
            return Some((value, &data[index + 1..]));
        }
    }
    None
}

pub fn leb128(mut value: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    loop {
        let low = u8::try_from(value & 0x7f).expect("seven bits");
        value >>= 7;
        bytes.push(low | if value > 0 { 0x80 } else { 0 });
        if value == 0 {
            return bytes;
        }
    }
}

fn write_obu(obu: &Obu, has_size: bool) -> Vec<u8> {
    let size_flag = if has_size { HAS_SIZE } else { 0 };
    let extension_flag = obu.extension.map_or(0, |_| HAS_EXTENSION);
    let mut bytes = vec![obu.header & !(HAS_SIZE | HAS_EXTENSION) | size_flag | extension_flag];
    bytes.extend(obu.extension);
    if has_size {
        bytes.extend(leb128(obu.payload.len()));
    }
    bytes.extend(&obu.payload);
    bytes
}

/// Puts a stream together, with all sizes right.
pub fn join(stream: &Stream, form: Form) -> Vec<u8> {
    let mut bytes = match form {
        Form::Ivf => stream.ivf_header.clone(),
        Form::Section5 | Form::AnnexB => Vec::new(),
    };
    for (number, unit) in stream.units.iter().enumerate() {
        match form {
            Form::Ivf => {
                let data: Vec<u8> = unit.iter().flat_map(|obu| write_obu(obu, true)).collect();
                bytes.extend(u32::try_from(data.len()).expect("a size").to_le_bytes());
                bytes.extend((number as u64).to_le_bytes());
                bytes.extend(data);
            }
            Form::Section5 => bytes.extend(unit.iter().flat_map(|obu| write_obu(obu, true))),
            Form::AnnexB => {
                let sized = |data: Vec<u8>| [leb128(data.len()), data].concat();
                let obus = unit.iter().flat_map(|obu| sized(write_obu(obu, false)));
                bytes.extend(sized(sized(obus.collect())));
            }
        }
    }
    bytes
}
