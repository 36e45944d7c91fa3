//! §5.9.22: the two references of skip mode.

use super::frame_header::REFS_PER_FRAME;
use super::sequence_header::SequenceHeader;

/// The part of §5.9.22 `skip_mode_params` that finds `SkipModeFrame`: the nearest reference before
/// and the nearest after the frame, or else the two nearest before it. `ref_order_hints` are those
/// of `LAST_FRAME` to `ALTREF_FRAME`. `None` means `skipModeAllowed` = 0.
pub(crate) fn skip_mode_frames(
    sequence: &SequenceHeader,
    ref_order_hints: &[u32; REFS_PER_FRAME],
    order_hint: u32,
) -> Option<[u8; 2]> {
    let nearest_before = |limit: u32| {
        let mut nearest: Option<(u8, u32)> = None;
        for (name, &hint) in (1..).zip(ref_order_hints) {
            let is_nearer = nearest.is_none_or(|(_, best)| sequence.relative_dist(hint, best) > 0);
            if sequence.relative_dist(hint, limit) < 0 && is_nearer {
                nearest = Some((name, hint));
            }
        }
        nearest
    };
    let mut backward: Option<(u8, u32)> = None;
    for (name, &hint) in (1..).zip(ref_order_hints) {
        let is_nearer = backward.is_none_or(|(_, best)| sequence.relative_dist(hint, best) < 0);
        if sequence.relative_dist(hint, order_hint) > 0 && is_nearer {
            backward = Some((name, hint));
        }
    }
    let (forward, forward_hint) = nearest_before(order_hint)?;
    let (other, _) = match backward {
        Some(found) => found,
        None => nearest_before(forward_hint)?,
    };
    Some([forward.min(other), forward.max(other)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence() -> SequenceHeader {
        SequenceHeader {
            enable_order_hint: true,
            order_hint_bits: 5,
            ..SequenceHeader::default()
        }
    }

    #[test]
    fn the_nearest_on_either_side_are_taken_in_order_of_name() {
        let hints = [6, 4, 2, 0, 9, 12, 16];
        assert_eq!(skip_mode_frames(&sequence(), &hints, 8), Some([1, 5]));
        // BWDREF is behind and ALTREF2 ahead in the list; the names are sorted.
        let hints = [12, 4, 2, 0, 6, 12, 16];
        assert_eq!(skip_mode_frames(&sequence(), &hints, 8), Some([1, 5]));
    }

    #[test]
    fn without_a_later_frame_the_second_nearest_earlier_one_is_taken() {
        let hints = [6, 6, 2, 3, 6, 6, 0];
        assert_eq!(skip_mode_frames(&sequence(), &hints, 8), Some([1, 4]));
    }

    #[test]
    fn one_earlier_picture_alone_does_not_allow_skip_mode() {
        assert_eq!(skip_mode_frames(&sequence(), &[7; 7], 8), None);
        assert_eq!(skip_mode_frames(&sequence(), &[9; 7], 8), None);
    }

    #[test]
    fn distances_wrap_around() {
        let hints = [31, 30, 30, 30, 2, 3, 3];
        assert_eq!(skip_mode_frames(&sequence(), &hints, 1), Some([1, 5]));
    }
}
