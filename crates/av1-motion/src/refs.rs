//! §7.20, §7.21: what the eight reference slots keep of frame headers.

use std::ops::Index;

use crate::obu::film_grain::FilmGrainParams;
use crate::obu::frame_header::{
    FrameHeader, FrameType, NUM_REF_FRAMES, REFS_PER_FRAME, TOTAL_REFS_PER_FRAME,
};
use crate::obu::frame_size::FrameSize;
use crate::obu::global_motion::{DEFAULT_GM_PARAMS, GmParams};
use crate::obu::loop_filter::LoopFilterDeltas;
use crate::obu::segmentation::SegmentationFeatures;
use crate::obu::sequence_header::SequenceHeader;

/// What stands in a slot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum SlotState {
    /// Never filled.
    #[default]
    Empty,
    /// A frame that was lost: an error resilient header told its order hint, nothing else is
    /// known. It has no motion, no CDFs and no decode index, but it may be named as a reference.
    Substitute,
    /// A frame of this stream.
    Filled,
}

/// §7.20: header facts of one reference slot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ReferenceSlot {
    pub(crate) state: SlotState,
    /// `RefValid`. Only a conformance check: a slot can be filled and not valid.
    pub(crate) valid: bool,
    /// `RefFrameId`.
    pub(crate) frame_id: u32,
    /// `RefFrameType`.
    pub(crate) frame_type: FrameType,
    pub(crate) showable_frame: bool,
    /// `RefOrderHint`.
    pub(crate) order_hint: u32,
    /// `SavedOrderHints`, by reference name.
    pub(crate) saved_order_hints: [u32; TOTAL_REFS_PER_FRAME],
    /// `RefUpscaledWidth`.
    pub(crate) upscaled_width: u32,
    /// `RefFrameWidth`: coded width.
    pub(crate) frame_width: u32,
    /// `RefFrameHeight`.
    pub(crate) frame_height: u32,
    pub(crate) render_width: u32,
    pub(crate) render_height: u32,
    /// `RefMiCols`.
    pub(crate) mi_cols: u32,
    /// `RefMiRows`.
    pub(crate) mi_rows: u32,
    pub(crate) bit_depth: u8,
    pub(crate) mono_chrome: bool,
    pub(crate) subsampling_x: u8,
    pub(crate) subsampling_y: u8,
    /// `SavedGmParams`, by reference name.
    pub(crate) gm_params: GmParams,
    pub(crate) loop_filter_deltas: LoopFilterDeltas,
    pub(crate) segmentation_features: SegmentationFeatures,
    pub(crate) film_grain: FilmGrainParams,
}

impl Default for ReferenceSlot {
    fn default() -> Self {
        Self {
            state: SlotState::Empty,
            valid: false,
            frame_id: 0,
            frame_type: FrameType::Key,
            showable_frame: false,
            order_hint: 0,
            saved_order_hints: [0; TOTAL_REFS_PER_FRAME],
            upscaled_width: 0,
            frame_width: 0,
            frame_height: 0,
            render_width: 0,
            render_height: 0,
            mi_cols: 0,
            mi_rows: 0,
            bit_depth: 8,
            mono_chrome: false,
            subsampling_x: 1,
            subsampling_y: 1,
            gm_params: DEFAULT_GM_PARAMS,
            loop_filter_deltas: LoopFilterDeltas::default(),
            segmentation_features: SegmentationFeatures::default(),
            film_grain: FilmGrainParams::default(),
        }
    }
}

impl ReferenceSlot {
    /// §7.20 for one slot.
    fn from_header(header: &FrameHeader, sequence: &SequenceHeader) -> Self {
        Self {
            state: SlotState::Filled,
            valid: true,
            frame_id: header.current_frame_id,
            frame_type: header.frame_type,
            showable_frame: header.showable_frame,
            order_hint: header.order_hint,
            saved_order_hints: header.order_hints,
            gm_params: header.gm_params,
            loop_filter_deltas: header.loop_filter.deltas(),
            segmentation_features: header.segmentation.features(),
            film_grain: header.film_grain.clone(),
            ..Self::default()
        }
        .with_size(&header.size)
        .with_color(sequence)
    }

    /// A lost frame of which only the order hint is known: an intra frame of the largest size.
    fn substitute(order_hint: u32, sequence: &SequenceHeader) -> Self {
        let (width, height) = (sequence.max_frame_width, sequence.max_frame_height);
        let size = FrameSize {
            frame_width: width,
            frame_height: height,
            upscaled_width: width,
            render_width: width,
            render_height: height,
            mi_cols: 2 * width.div_ceil(8),
            mi_rows: 2 * height.div_ceil(8),
            ..FrameSize::default()
        };
        Self {
            state: SlotState::Substitute,
            frame_type: FrameType::IntraOnly,
            order_hint,
            ..Self::default()
        }
        .with_size(&size)
        .with_color(sequence)
    }

    fn with_size(self, size: &FrameSize) -> Self {
        Self {
            upscaled_width: size.upscaled_width,
            frame_width: size.frame_width,
            frame_height: size.frame_height,
            render_width: size.render_width,
            render_height: size.render_height,
            mi_cols: size.mi_cols,
            mi_rows: size.mi_rows,
            ..self
        }
    }

    fn with_color(self, sequence: &SequenceHeader) -> Self {
        Self {
            bit_depth: sequence.color.bit_depth,
            mono_chrome: sequence.color.mono_chrome,
            subsampling_x: sequence.color.subsampling_x,
            subsampling_y: sequence.color.subsampling_y,
            ..self
        }
    }

    /// Whether the picture has the bit depth and planes of `sequence` (§6.8.2).
    pub(crate) fn matches_color(&self, sequence: &SequenceHeader) -> bool {
        self.bit_depth == sequence.color.bit_depth
            && self.mono_chrome == sequence.color.mono_chrome
            && self.subsampling_x == sequence.color.subsampling_x
            && self.subsampling_y == sequence.color.subsampling_y
    }

    /// §7.21 for the fields of a header that `show_existing_frame` reports.
    pub(crate) fn load_into(&self, header: &mut FrameHeader) {
        header.frame_type = self.frame_type;
        header.frame_is_intra = self.frame_type.is_intra();
        header.current_frame_id = self.frame_id;
        header.order_hint = self.order_hint;
        header.order_hints = self.saved_order_hints;
        header.gm_params = self.gm_params;
        header.film_grain = self.film_grain.clone();
        header.size = FrameSize {
            frame_width: self.frame_width,
            frame_height: self.frame_height,
            upscaled_width: self.upscaled_width,
            render_width: self.render_width,
            render_height: self.render_height,
            use_superres: self.frame_width != self.upscaled_width,
            mi_cols: self.mi_cols,
            mi_rows: self.mi_rows,
            ..FrameSize::default()
        };
    }
}

/// The eight reference slots, as far as headers describe them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ReferenceSlots {
    slots: [ReferenceSlot; NUM_REF_FRAMES],
}

impl Index<usize> for ReferenceSlots {
    type Output = ReferenceSlot;

    fn index(&self, slot: usize) -> &ReferenceSlot {
        &self.slots[slot]
    }
}

impl ReferenceSlots {
    /// §7.20, the part that derives from headers: stores the frame into the slots of
    /// `refresh_frame_flags`. A key frame shown again is loaded (§7.21) and stored everywhere; it
    /// may not be shown a third time (§6.8.2).
    pub(crate) fn update(&mut self, header: &FrameHeader, sequence: &SequenceHeader) {
        let content = if header.show_existing_frame {
            ReferenceSlot {
                valid: true,
                showable_frame: false,
                ..self.slots[usize::from(header.frame_to_show_map_idx)].clone()
            }
        } else {
            ReferenceSlot::from_header(header, sequence)
        };
        for (index, slot) in self.slots.iter_mut().enumerate() {
            if (header.refresh_frame_flags >> index) & 1 == 1 {
                slot.clone_from(&content);
            }
        }
    }

    /// Empties the slots of `refresh_frame_flags`, for a frame that could not be decoded.
    pub(crate) fn clear(&mut self, refresh_frame_flags: u8) {
        for (index, slot) in self.slots.iter_mut().enumerate() {
            if (refresh_frame_flags >> index) & 1 == 1 {
                *slot = ReferenceSlot::default();
            }
        }
    }

    /// `RefOrderHint` of every slot.
    pub(crate) fn order_hints(&self) -> [u32; NUM_REF_FRAMES] {
        std::array::from_fn(|index| self.slots[index].order_hint)
    }

    /// The slots of `LAST_FRAME` to `ALTREF_FRAME`.
    pub(crate) fn named<'s>(
        &'s self,
        ref_frame_idx: &'s [u8; REFS_PER_FRAME],
    ) -> impl Iterator<Item = &'s ReferenceSlot> + 's {
        ref_frame_idx.iter().map(|&index| &self[index.into()])
    }

    /// §5.9.2: what the header of a shown key frame does to all slots.
    pub(crate) fn invalidate(&mut self) {
        for slot in &mut self.slots {
            slot.valid = false;
            slot.order_hint = 0;
        }
    }

    /// §5.9.2: the header says that slot `index` holds `ref_order_hint`. If it does not, the frame
    /// was lost, and a substitute takes its place.
    pub(crate) fn expect_order_hint(
        &mut self,
        index: usize,
        ref_order_hint: u32,
        sequence: &SequenceHeader,
    ) {
        let slot = &mut self.slots[index];
        if slot.state == SlotState::Empty || slot.order_hint != ref_order_hint {
            *slot = ReferenceSlot::substitute(ref_order_hint, sequence);
        }
    }

    /// §5.9.4 `mark_ref_frames`: slots whose frame id is too old are no longer valid.
    pub(crate) fn mark_ref_frames(&mut self, current_frame_id: u32, sequence: &SequenceHeader) {
        let window = 1_u32 << sequence.delta_frame_id_bits;
        let modulus = 1_u32 << sequence.frame_id_bits;
        for slot in &mut self.slots {
            let id = slot.frame_id;
            let is_stale = if current_frame_id > window {
                id > current_frame_id || id < current_frame_id - window
            } else {
                id > current_frame_id && id < (modulus + current_frame_id).saturating_sub(window)
            };
            slot.valid &= !is_stale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key_frame() -> FrameHeader {
        FrameHeader {
            refresh_frame_flags: 0b0000_0101,
            order_hint: 9,
            current_frame_id: 40,
            showable_frame: true,
            ..FrameHeader::default()
        }
    }

    #[test]
    fn a_frame_fills_the_slots_it_refreshes() {
        let mut slots = ReferenceSlots::default();
        slots.update(&key_frame(), &SequenceHeader::default());
        let states = [0, 1, 2].map(|index| slots[index].state);
        assert_eq!(
            states,
            [SlotState::Filled, SlotState::Empty, SlotState::Filled]
        );
        assert_eq!(slots.order_hints(), [9, 0, 9, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn showing_a_key_frame_again_stores_it_everywhere_and_only_once() {
        let mut slots = ReferenceSlots::default();
        slots.update(&key_frame(), &SequenceHeader::default());
        let shown = FrameHeader {
            show_existing_frame: true,
            frame_to_show_map_idx: 2,
            refresh_frame_flags: 0xff,
            ..FrameHeader::default()
        };
        slots.update(&shown, &SequenceHeader::default());
        assert_eq!(slots.order_hints(), [9; 8]);
        assert!((0..8).all(|index| !slots[index].showable_frame));
    }

    #[test]
    fn a_wrong_order_hint_turns_a_slot_into_a_substitute() {
        let mut slots = ReferenceSlots::default();
        let sequence = SequenceHeader {
            max_frame_width: 100,
            max_frame_height: 50,
            ..SequenceHeader::default()
        };
        slots.update(&key_frame(), &sequence);
        slots.expect_order_hint(0, 9, &sequence);
        slots.expect_order_hint(2, 3, &sequence);
        assert_eq!(slots[0].state, SlotState::Filled);
        assert_eq!(slots[2].state, SlotState::Substitute);
        assert_eq!(slots[2].order_hint, 3);
        assert!(slots[2].frame_type.is_intra());
        assert_eq!(slots[2].upscaled_width, 100);
    }

    #[test]
    fn frame_ids_out_of_the_window_are_no_longer_valid() {
        let sequence = SequenceHeader {
            delta_frame_id_bits: 4,
            frame_id_bits: 8,
            ..SequenceHeader::default()
        };
        let is_valid_after = |current: u32| {
            let mut slots = ReferenceSlots::default();
            slots.update(&key_frame(), &sequence);
            slots.mark_ref_frames(current, &sequence);
            slots[0].valid
        };
        assert!(is_valid_after(41));
        assert!(is_valid_after(56));
        assert!(!is_valid_after(57));
        assert!(!is_valid_after(39));
        // Near 0 the window wraps: ids 241 and up would still be recent, 40 is not.
        assert!(!is_valid_after(1));
    }
}
