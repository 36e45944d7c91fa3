//! §5.9.2: which slots an inter frame names as `LAST_FRAME` to `ALTREF_FRAME`.

use crate::bits::BitReader;
use crate::error::Result;
use crate::refs::{ReferenceSlots, SlotState};

use super::frame_header::{FrameHeader, NUM_REF_FRAMES, REFS_PER_FRAME};
use super::sequence_header::SequenceHeader;
use super::set_frame_refs::set_frame_refs;

/// `ref_order_hint[ i ]`: tells which frames were lost.
pub(crate) fn parse_ref_order_hints(
    reader: &mut BitReader<'_>,
    sequence: &SequenceHeader,
    slots: &mut ReferenceSlots,
) -> Result<()> {
    for slot in 0..NUM_REF_FRAMES {
        let ref_order_hint = reader.f(sequence.order_hint_bits.into())?;
        slots.expect_order_hint(slot, ref_order_hint, sequence);
    }
    Ok(())
}

/// Reads `frame_refs_short_signaling` to `delta_frame_id_minus_1` into `header`, and checks the
/// slots named.
pub(crate) fn parse_frame_references(
    reader: &mut BitReader<'_>,
    sequence: &SequenceHeader,
    slots: &ReferenceSlots,
    header: &mut FrameHeader,
) -> Result<()> {
    header.frame_refs_short_signaling = sequence.enable_order_hint && reader.flag()?;
    if header.frame_refs_short_signaling {
        header.ref_frame_idx = read_short_references(reader, sequence, slots, header.order_hint)?;
    }
    for name in 0..REFS_PER_FRAME {
        if !header.frame_refs_short_signaling {
            header.ref_frame_idx[name] = reader.f8(3)?;
        }
        let index = header.ref_frame_idx[name];
        check_slot(reader, sequence, slots, index)?;
        if sequence.frame_id_numbers_present {
            let delta_frame_id_minus_1 = reader.f(sequence.delta_frame_id_bits.into())?;
            let mask = (1_u32 << sequence.frame_id_bits) - 1;
            let expected = header
                .current_frame_id
                .wrapping_sub(delta_frame_id_minus_1 + 1)
                & mask;
            check_frame_id(reader, slots, index, expected)?;
        }
    }
    Ok(())
}

fn read_short_references(
    reader: &mut BitReader<'_>,
    sequence: &SequenceHeader,
    slots: &ReferenceSlots,
    order_hint: u32,
) -> Result<[u8; REFS_PER_FRAME]> {
    let last_frame_idx = reader.f8(3)?;
    let gold_frame_idx = reader.f8(3)?;
    let hints = slots.order_hints();
    let distances = hints.map(|hint| sequence.relative_dist(hint, order_hint));
    for index in [last_frame_idx, gold_frame_idx] {
        if distances[usize::from(index)] >= 0 {
            return Err(reader.malformed(
                "7.8",
                format!("slot {index}, named as LAST or GOLDEN, is not an earlier picture"),
            ));
        }
    }
    Ok(set_frame_refs(last_frame_idx, gold_frame_idx, distances))
}

/// §6.8.2: a reference must be there and have the planes of the current frame.
fn check_slot(
    reader: &BitReader<'_>,
    sequence: &SequenceHeader,
    slots: &ReferenceSlots,
    index: u8,
) -> Result<()> {
    let slot = &slots[index.into()];
    if slot.state == SlotState::Empty {
        let reason = format!("the frame refers to slot {index}, which is empty");
        return Err(reader.missing("6.8.2", reason));
    }
    if slot.state == SlotState::Filled && !slot.valid {
        let reason = format!("the frame refers to slot {index}, whose frame is out of date");
        return Err(reader.missing("6.8.2", reason));
    }
    if !slot.matches_color(sequence) {
        let reason = format!("the picture in slot {index} has another bit depth or subsampling");
        return Err(reader.malformed("6.8.2", reason));
    }
    Ok(())
}

/// §6.8.2: `expectedFrameId` must be the id in the slot.
fn check_frame_id(
    reader: &BitReader<'_>,
    slots: &ReferenceSlots,
    index: u8,
    expected: u32,
) -> Result<()> {
    let slot = &slots[index.into()];
    if slot.state == SlotState::Filled && slot.frame_id != expected {
        let reason = format!(
            "slot {index} should hold the frame with id {expected}, but holds id {}",
            slot.frame_id
        );
        return Err(reader.missing("6.8.2", reason));
    }
    Ok(())
}

/// §6.8.6: no reference may be too large or too small for the frame.
pub(crate) fn check_scaling(
    reader: &BitReader<'_>,
    slots: &ReferenceSlots,
    header: &FrameHeader,
) -> Result<()> {
    for &index in &header.ref_frame_idx {
        let slot = &slots[index.into()];
        if slot.state == SlotState::Filled && !header.size.can_scale_from(slot) {
            return Err(reader.malformed(
                "6.8.6",
                format!(
                    "a frame of {}x{} cannot refer to slot {index} of {}x{}",
                    header.size.frame_width,
                    header.size.frame_height,
                    slot.upscaled_width,
                    slot.frame_height
                ),
            ));
        }
    }
    Ok(())
}
