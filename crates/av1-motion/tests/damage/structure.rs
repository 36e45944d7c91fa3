//! Damage that leaves the sizes right, so that it reaches the parts behind the container.

use super::Random;
use super::stream::{Form, Obu, Stream, join, split};

/// Bytes at the start of an OBU that hold a header in most streams.
const HEADER_BYTES: usize = 24;

/// Damages a stream at some places, and writes it in some container; `other` lends units and OBUs.
/// Nothing if `bytes` is not an IVF file with whole OBUs.
pub fn mutate(bytes: &[u8], other: &[u8], random: &mut Random) -> Option<Vec<u8>> {
    let mut stream = split(bytes)?;
    let other = split(other);
    for _ in 0..=random.below(3) {
        damage(&mut stream, other.as_ref(), random);
        if stream.units.is_empty() {
            break;
        }
    }
    let form = match random.below(8) {
        0 => Form::Section5,
        1 => Form::AnnexB,
        _ => Form::Ivf,
    };
    Some(join(&stream, form))
}

fn damage(stream: &mut Stream, other: Option<&Stream>, random: &mut Random) {
    let units = stream.units.len();
    let (a, b) = (random.below(units), random.below(units));
    match random.below(12) {
        0 => stream.units.swap(a, b),
        1 => {
            let copy = stream.units[a].clone();
            stream.units.insert(b, copy);
        }
        2 => drop(stream.units.remove(a)),
        3 => {
            // A splice: the first part of one stream, the last part of another.
            if let Some(other) = other {
                stream.units.truncate(a + 1);
                let from = random.below(other.units.len());
                stream.units.extend_from_slice(&other.units[from..]);
            }
        }
        4 => {
            if let Some(obu) = other.and_then(|other| pick(other, random)) {
                let at = random.below(stream.units[a].len() + 1);
                stream.units[a].insert(at, obu);
            }
        }
        _ => damage_unit(&mut stream.units[a], random),
    }
}

fn pick(stream: &Stream, random: &mut Random) -> Option<Obu> {
    let unit = &stream.units[random.below(stream.units.len())];
    unit.get(random.below(unit.len())).cloned()
}

fn damage_unit(unit: &mut Vec<Obu>, random: &mut Random) {
    if unit.is_empty() {
        return;
    }
    let (a, b) = (random.below(unit.len()), random.below(unit.len()));
    match random.below(10) {
        0 => unit.swap(a, b),
        1 => {
            let copy = unit[a].clone();
            unit.insert(b, copy);
        }
        2 => drop(unit.remove(a)),
        3 => {
            let length = random.below(unit[a].payload.len() + 1);
            unit[a].payload.truncate(length);
        }
        4 => {
            let kind = u8::try_from(random.below(16)).expect("four bits");
            unit[a].header = unit[a].header & 0x87 | kind << 3;
        }
        5 => unit[a].extension = [None, Some(random.byte())][random.below(2)],
        _ => damage_obu(unit, random),
    }
}

/// Changes bits of a header, or bytes of the tiles behind it.
fn damage_obu(unit: &mut [Obu], random: &mut Random) {
    let with_headers = unit.iter().filter(|obu| obu.has_header_fields()).count();
    let nth = random.below(with_headers);
    let mut candidates = unit.iter_mut().filter(|obu| obu.has_header_fields());
    let Some(obu) = candidates.nth(nth).filter(|obu| !obu.payload.is_empty()) else {
        return;
    };
    let length = obu.payload.len();
    if random.below(2) == 0 {
        for _ in 0..=random.below(3) {
            obu.payload[random.below(length.min(HEADER_BYTES))] ^= 1 << random.below(8);
        }
    } else {
        let at = random.below(length);
        let end = length.min(at + 1 + random.below(40));
        for byte in &mut obu.payload[at..end] {
            *byte = random.byte();
        }
    }
}
