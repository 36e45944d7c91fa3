//! Sequence and frame headers: each part of the input becomes the payload of one OBU.
//!
//! A part is a byte with the OBU type (low bits) and whether a new unit begins (high bit), a length,
//! and the payload.
#![no_main]

use av1_motion::Parser;
use fuzz_support::damage::stream::leb128;
use libfuzzer_sys::fuzz_target;

/// Temporal delimiter, sequence header, frame header, tile group, frame, redundant frame header.
const KINDS: [u8; 8] = [1, 6, 6, 3, 4, 7, 2, 6];

fuzz_target!(|data: &[u8]| {
    let mut parser = Parser::new(fuzz_support::limits());
    let (mut frames, mut unit, mut rest) = (Vec::new(), Vec::new(), data);
    while let [control, length, tail @ ..] = rest {
        let (payload, tail) = tail.split_at(usize::from(*length).min(tail.len()));
        rest = tail;
        if control & 0x80 != 0 {
            parser.push(std::mem::take(&mut unit), 0);
            fuzz_support::drain(&mut parser, &mut frames);
        }
        let has_extension = control & 0x40 != 0;
        unit.push(KINDS[usize::from(control & 7)] << 3 | u8::from(has_extension) << 2 | 2);
        if has_extension {
            unit.push((control & 0x38) << 2);
        }
        unit.extend(leb128(payload.len()));
        unit.extend_from_slice(payload);
    }
    parser.push(unit, 0);
    fuzz_support::drain(&mut parser, &mut frames);
});
