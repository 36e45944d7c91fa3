//! Whole headers of real streams, intact and damaged.

use crate::bits::BitReader;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::refs::{ReferenceSlots, SlotState};

use super::frame_header::{FrameHeader, FrameType, TxMode};
use super::header::{ObuHeader, ObuType};
use super::sequence_header::SequenceHeader;

/// libaom 3.6, 512x288, tile groups: sequence header and the headers of the first three frames.
const SEQUENCE: [u8; 11] = [
    0x00, 0x00, 0x00, 0x04, 0x47, 0xfe, 0x3e, 0x6d, 0x7c, 0x80, 0x20,
];
const KEY: [u8; 12] = [
    0x10, 0x00, 0xe9, 0xe8, 0xa0, 0xc2, 0x08, 0x20, 0x71, 0x20, 0x00, 0x50,
];
const HIDDEN: [u8; 20] = [
    0x28, 0x06, 0xe0, 0x40, 0x00, 0x00, 0x23, 0x74, 0xf5, 0x40, 0x61, 0x86, 0x08, 0x38, 0x94, 0x00,
    0x02, 0x22, 0x80, 0x40,
];
const SECOND_HIDDEN: [u8; 18] = [
    0x28, 0x03, 0xe0, 0x80, 0x00, 0x00, 0xa3, 0x74, 0xf6, 0x60, 0x0c, 0x30, 0x81, 0xc4, 0x80, 0x05,
    0xa0, 0x10,
];

/// libaom 3.6, real time, error resilient, with frame ids: sequence header, and the
/// beginnings of the first two frames.
const RESILIENT_SEQUENCE: [u8; 12] = [
    0x00, 0x00, 0x00, 0x04, 0x3c, 0xff, 0xbf, 0x81, 0xb5, 0xf2, 0x00, 0x80,
];
const RESILIENT_KEY: [u8; 40] = [
    0x12, 0xbb, 0x00, 0x01, 0x00, 0x40, 0x00, 0x01, 0x00, 0x00, 0x40, 0xdd, 0x5c, 0x84, 0xb6, 0x9a,
    0x26, 0x54, 0x60, 0xd8, 0x00, 0x7a, 0x93, 0x7b, 0xac, 0xa2, 0x8c, 0x56, 0x74, 0x92, 0xa5, 0x35,
    0xf6, 0x1b, 0xbe, 0x00, 0x36, 0xb0, 0x93, 0xc3,
];
const RESILIENT_INTER: [u8; 60] = [
    0x39, 0x5d, 0x84, 0x04, 0x08, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x20, 0x00,
    0x70, 0x00, 0x30, 0x00, 0x1c, 0x00, 0x0e, 0x00, 0x00, 0x00, 0x00, 0x14, 0xa4, 0x08, 0x07, 0x76,
    0x03, 0xae, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x49, 0x24, 0x92, 0x14, 0x10, 0x24, 0x00, 0xd8,
    0x92, 0x22, 0x09, 0xea, 0x44, 0xd3, 0xad, 0x94, 0x9d, 0xb3, 0x7e, 0x88,
];

const OBU: ObuHeader = ObuHeader {
    obu_type: ObuType::FrameHeader,
    has_extension: false,
    has_size: true,
    temporal_id: 0,
    spatial_id: 0,
};

fn sequence(bytes: &[u8]) -> SequenceHeader {
    SequenceHeader::parse(&mut BitReader::new(bytes, 0)).unwrap()
}

/// Reads a header with its trailing bits.
fn parse(
    bytes: &[u8],
    sequence: &SequenceHeader,
    slots: &mut ReferenceSlots,
) -> Result<FrameHeader> {
    let mut reader = BitReader::new(bytes, 0);
    let header = FrameHeader::parse(&mut reader, sequence, slots, &OBU, &Limits::default())?;
    reader.trailing_bits()?;
    Ok(header)
}

/// Reads a header and stores its frame.
fn decode(bytes: &[u8], sequence: &SequenceHeader, slots: &mut ReferenceSlots) -> FrameHeader {
    let mut reader = BitReader::new(bytes, 0);
    let header =
        FrameHeader::parse(&mut reader, sequence, slots, &OBU, &Limits::default()).unwrap();
    slots.update(&header, sequence);
    header
}

#[test]
fn real_headers_are_read_to_their_last_bit() {
    let sequence = sequence(&SEQUENCE);
    assert_eq!(sequence.color.bit_depth, 8);
    assert_eq!(sequence.order_hint_bits, 7);
    let mut slots = ReferenceSlots::default();
    let key = parse(&KEY, &sequence, &mut slots).unwrap();
    slots.update(&key, &sequence);
    assert_eq!(key.frame_type, FrameType::Key);
    assert_eq!((key.size.mi_cols, key.size.mi_rows), (128, 72));
    assert_eq!(key.quantization.base_q_idx, 69);
    let hidden = parse(&HIDDEN, &sequence, &mut slots).unwrap();
    slots.update(&hidden, &sequence);
    assert!(!hidden.show_frame && hidden.showable_frame);
    assert_eq!(hidden.order_hint, 6);
    assert_eq!(hidden.refresh_frame_flags, 0b10);
    let second = parse(&SECOND_HIDDEN, &sequence, &mut slots).unwrap();
    assert_eq!(second.order_hint, 3);
    assert_eq!(second.tx_mode, TxMode::Select);
    assert_eq!(second.order_hints[7], 6);
    assert!(second.ref_frame_sign_bias[7] && !second.ref_frame_sign_bias[1]);
}

#[test]
fn a_header_cut_anywhere_is_malformed() {
    for length in 0..SEQUENCE.len() {
        let mut reader = BitReader::new(&SEQUENCE[..length], 0);
        assert!(SequenceHeader::parse(&mut reader).is_err(), "{length}");
    }
    let sequence = sequence(&SEQUENCE);
    let mut slots = ReferenceSlots::default();
    for frame in [&KEY[..], &HIDDEN, &SECOND_HIDDEN] {
        for length in 0..frame.len() {
            let cut = parse(&frame[..length], &sequence, &mut slots.clone());
            assert!(matches!(cut, Err(Error::Malformed { .. })), "{length}");
        }
        decode(frame, &sequence, &mut slots);
    }
}

#[test]
fn a_header_that_fails_leaves_the_slots_alone() {
    let sequence = sequence(&SEQUENCE);
    let mut slots = ReferenceSlots::default();
    decode(&KEY, &sequence, &mut slots);
    let before = slots.clone();
    let mut reader = BitReader::new(&KEY[..6], 0);
    let cut = FrameHeader::parse(&mut reader, &sequence, &mut slots, &OBU, &Limits::default());
    assert!(cut.is_err());
    assert_eq!(slots, before);
}

#[test]
fn flipped_bits_never_panic() {
    let streams = [
        (&SEQUENCE[..], [&KEY[..], &HIDDEN, &SECOND_HIDDEN].to_vec()),
        (&RESILIENT_SEQUENCE, vec![&RESILIENT_KEY, &RESILIENT_INTER]),
    ];
    let mut accepted = 0;
    for (sequence_bytes, frames) in streams {
        let sequence = sequence(sequence_bytes);
        let mut slots = ReferenceSlots::default();
        for frame in frames {
            for bit in 0..frame.len() * 8 {
                let mut damaged = frame.to_vec();
                damaged[bit / 8] ^= 0x80 >> (bit % 8);
                let mut after = slots.clone();
                let mut reader = BitReader::new(&damaged, 0);
                let limits = Limits::default();
                let result = FrameHeader::parse(&mut reader, &sequence, &mut after, &OBU, &limits);
                if let Ok(header) = result {
                    after.update(&header, &sequence);
                    accepted += 1;
                }
            }
            decode(frame, &sequence, &mut slots);
        }
    }
    assert!(accepted > 0);
}

#[test]
fn an_inter_frame_without_its_references_misses_them() {
    let sequence = sequence(&SEQUENCE);
    let result = parse(&HIDDEN, &sequence, &mut ReferenceSlots::default());
    assert!(matches!(
        result,
        Err(Error::MissingReference {
            section: "6.8.2",
            ..
        })
    ));
}

#[test]
fn showing_an_empty_slot_misses_it_and_showing_a_shown_key_frame_is_malformed() {
    let sequence = sequence(&SEQUENCE);
    let mut slots = ReferenceSlots::default();
    // show_existing_frame 1, slot 2, trailing one.
    let show = [0b1010_1000];
    let missing = parse(&show, &sequence, &mut slots);
    assert!(matches!(missing, Err(Error::MissingReference { .. })));
    decode(&KEY, &sequence, &mut slots);
    let forbidden = parse(&show, &sequence, &mut slots);
    assert!(matches!(forbidden, Err(Error::Malformed { .. })));
}

#[test]
fn a_hidden_frame_can_be_shown_later_with_its_own_facts() {
    let sequence = sequence(&SEQUENCE);
    let mut slots = ReferenceSlots::default();
    decode(&KEY, &sequence, &mut slots);
    decode(&HIDDEN, &sequence, &mut slots);
    let shown = parse(&[0b1001_1000], &sequence, &mut slots).unwrap();
    assert!(shown.show_existing_frame);
    assert_eq!(shown.frame_type, FrameType::Inter);
    assert_eq!((shown.order_hint, shown.refresh_frame_flags), (6, 0));
    assert_eq!(shown.size.mi_cols, 128);
}

#[test]
fn an_error_resilient_frame_names_lost_frames_by_their_order_hints() {
    let sequence = sequence(&RESILIENT_SEQUENCE);
    assert!(sequence.frame_id_numbers_present);
    let mut slots = ReferenceSlots::default();
    // Without its key frame: every slot becomes a substitute, so the header can be read.
    let header = decode(&RESILIENT_INTER, &sequence, &mut slots.clone());
    assert!(header.error_resilient_mode);
    let mut reader = BitReader::new(&RESILIENT_INTER, 0);
    let limits = Limits::default();
    FrameHeader::parse(&mut reader, &sequence, &mut slots, &OBU, &limits).unwrap();
    assert_eq!(slots[0].state, SlotState::Substitute);
    // With it, none does.
    let mut slots = ReferenceSlots::default();
    decode(&RESILIENT_KEY, &sequence, &mut slots);
    decode(&RESILIENT_INTER, &sequence, &mut slots);
    assert!((0..8).all(|slot| slots[slot].state == SlotState::Filled));
}

#[test]
fn a_frame_beyond_the_area_limit_is_refused() {
    let sequence = sequence(&SEQUENCE);
    let limits = Limits {
        max_frame_area: 512 * 288 - 1,
        ..Limits::default()
    };
    let mut reader = BitReader::new(&KEY, 0);
    let mut slots = ReferenceSlots::default();
    let result = FrameHeader::parse(&mut reader, &sequence, &mut slots, &OBU, &limits);
    assert!(matches!(
        result,
        Err(Error::LimitExceeded {
            limit: "max_frame_area",
            value: 147_456,
            ..
        })
    ));
}
