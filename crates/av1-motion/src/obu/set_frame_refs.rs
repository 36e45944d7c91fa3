//! §7.8: the set frame refs process, which derives seven references from two.

use super::frame_header::{NUM_REF_FRAMES, REFS_PER_FRAME};

/// `refFrame - LAST_FRAME` of some reference names.
const LAST: usize = 0;
const LAST2: usize = 1;
const LAST3: usize = 2;
const GOLDEN: usize = 3;
const BWDREF: usize = 4;
const ALTREF2: usize = 5;
const ALTREF: usize = 6;

/// §7.8 `Ref_Frame_List`.
const REF_FRAME_LIST: [usize; REFS_PER_FRAME - 2] = [LAST2, LAST3, BWDREF, ALTREF2, ALTREF];

/// Slots that are still free to be named, with their places in display order.
struct Candidates {
    /// Distance of each slot's picture from the current one: negative is earlier.
    distances: [i32; NUM_REF_FRAMES],
    used: [bool; NUM_REF_FRAMES],
}

impl Candidates {
    fn unused(&self, backward: bool) -> impl Iterator<Item = (u8, i32)> + '_ {
        let slots = (0..).zip(self.distances);
        slots.filter(move |&(slot, distance)| {
            !self.used[usize::from(slot)] && (distance >= 0) == backward
        })
    }

    /// `find_latest_backward`: the later slot wins a tie.
    fn latest_backward(&self) -> Option<u8> {
        let best = self.unused(true).max_by_key(|&(_, distance)| distance);
        best.map(|(slot, _)| slot)
    }

    /// `find_earliest_backward`: the earlier slot wins a tie.
    fn earliest_backward(&self) -> Option<u8> {
        let best = self.unused(true).min_by_key(|&(_, distance)| distance);
        best.map(|(slot, _)| slot)
    }

    /// `find_latest_forward`: the later slot wins a tie.
    fn latest_forward(&self) -> Option<u8> {
        let best = self.unused(false).max_by_key(|&(_, distance)| distance);
        best.map(|(slot, _)| slot)
    }

    /// The earliest of all slots, used or not; the earlier slot wins a tie.
    fn earliest(&self) -> u8 {
        let best = (0..)
            .zip(self.distances)
            .min_by_key(|&(_, distance)| distance);
        best.map_or(0, |(slot, _)| slot)
    }
}

/// §7.8: `ref_frame_idx` from `last_frame_idx` and `gold_frame_idx`. `distances[i]` is
/// `get_relative_dist( RefOrderHint[ i ], OrderHint )`, that is `shiftedOrderHints` without its
/// constant.
pub(crate) fn set_frame_refs(
    last_frame_idx: u8,
    gold_frame_idx: u8,
    distances: [i32; NUM_REF_FRAMES],
) -> [u8; REFS_PER_FRAME] {
    let mut candidates = Candidates {
        distances,
        used: [false; NUM_REF_FRAMES],
    };
    let mut slots: [Option<u8>; REFS_PER_FRAME] = [None; REFS_PER_FRAME];
    slots[LAST] = Some(last_frame_idx);
    slots[GOLDEN] = Some(gold_frame_idx);
    candidates.used[usize::from(last_frame_idx)] = true;
    candidates.used[usize::from(gold_frame_idx)] = true;

    let mut name = |reference: usize, find: fn(&Candidates) -> Option<u8>| {
        if slots[reference].is_none()
            && let Some(slot) = find(&candidates)
        {
            slots[reference] = Some(slot);
            candidates.used[usize::from(slot)] = true;
        }
    };
    name(ALTREF, Candidates::latest_backward);
    name(BWDREF, Candidates::earliest_backward);
    name(ALTREF2, Candidates::earliest_backward);
    for reference in REF_FRAME_LIST {
        name(reference, Candidates::latest_forward);
    }
    let earliest = candidates.earliest();
    slots.map(|slot| slot.unwrap_or(earliest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pyramid_gets_its_backward_references_by_distance() {
        // Slots: 0 is 8 back, 1 is 4 back, 2 is 2 back, 3 is 1 back, 4 at +8, 5 at +4, 6 at +2.
        let distances = [-8, -4, -2, -1, 8, 4, 2, -16];
        let refs = set_frame_refs(3, 0, distances);
        //               LAST LAST2 LAST3 GOLD BWD ALT2 ALT
        assert_eq!(refs, [3, 2, 1, 0, 6, 5, 4]);
    }

    #[test]
    fn without_backward_references_the_names_fill_with_earlier_frames() {
        let distances = [-1, -2, -3, -4, -5, -6, -7, -8];
        let refs = set_frame_refs(0, 3, distances);
        assert_eq!(refs, [0, 1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn ties_go_to_the_later_slot_for_latest_and_to_the_earlier_for_earliest() {
        let distances = [-1, -1, -1, -1, 3, 3, 3, 3];
        let refs = set_frame_refs(0, 0, distances);
        // ALTREF latest: 7; BWDREF earliest: 4; ALTREF2 earliest: 5; LAST2, LAST3 latest: 3, 2.
        assert_eq!(refs, [0, 3, 2, 0, 4, 5, 7]);
    }

    #[test]
    fn names_left_over_point_at_the_earliest_frame_of_all() {
        let distances = [-1, -9, 0, 0, 0, 0, 0, 0];
        let refs = set_frame_refs(0, 1, distances);
        // All later slots count as backward; LAST2 and LAST3 find no earlier frame.
        assert_eq!(refs, [0, 1, 1, 1, 2, 3, 7]);
    }
}
