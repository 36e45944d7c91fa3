//! §7.18, §7.20: from order hints, which wrap around, to positions in display order.

use crate::obu::frame_header::FrameHeader;
use crate::obu::sequence_header::SequenceHeader;

/// Unwraps order hints against the frame before.
#[derive(Debug, Default)]
pub(crate) struct DisplayOrder {
    /// Order hint of the frame that distances are counted from.
    anchor_hint: u32,
    /// Its position in display order.
    anchor_index: i64,
    /// One more than the last position shown.
    next_index: i64,
    /// Spatial layer and position of the last frame shown in this temporal unit.
    shown: Option<(u8, i64)>,
}

impl DisplayOrder {
    /// A temporal unit begins. Containers may omit the OBU that says so.
    pub(crate) fn begin_unit(&mut self) {
        self.shown = None;
    }

    /// The position of a frame. A shown key frame begins anew after everything that was shown, and
    /// so does every frame without order hints; only a higher layer of the same picture does not.
    pub(crate) fn place(
        &mut self,
        sequence: &SequenceHeader,
        header: &FrameHeader,
        spatial_id: u8,
    ) -> i64 {
        let same_picture = self
            .shown
            .filter(|&(below, _)| below < spatial_id)
            .map(|(_, index)| index);
        let index = if header.is_shown_key() || !sequence.enable_order_hint {
            same_picture.unwrap_or(self.next_index)
        } else {
            let distance = sequence.relative_dist(header.order_hint, self.anchor_hint);
            self.anchor_index + i64::from(distance)
        };
        self.anchor_hint = header.order_hint;
        self.anchor_index = index;
        if header.show_frame {
            self.shown = Some((spatial_id, index));
            self.next_index = self.next_index.max(index + 1);
        }
        index
    }

    /// An earlier frame is shown.
    pub(crate) fn show(&mut self, order_hint: u32, index: i64) {
        self.anchor_hint = order_hint;
        self.anchor_index = index;
        self.next_index = self.next_index.max(index + 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::obu::frame_header::FrameType;

    #[test]
    fn positions_go_on_when_order_hints_wrap_around() {
        let sequence = SequenceHeader {
            enable_order_hint: true,
            order_hint_bits: 7,
            ..SequenceHeader::default()
        };
        let mut order = DisplayOrder::default();
        for index in 0..400 {
            let header = FrameHeader {
                frame_type: if index == 0 {
                    FrameType::Key
                } else {
                    FrameType::Inter
                },
                order_hint: (index + 100) % 128,
                show_frame: true,
                ..FrameHeader::default()
            };
            assert_eq!(order.place(&sequence, &header, 0), i64::from(index));
        }
    }

    #[test]
    fn layers_of_one_picture_share_its_position_even_without_order_hints() {
        let sequence = SequenceHeader::default();
        let inter = FrameHeader {
            frame_type: FrameType::Inter,
            ..FrameHeader::default()
        };
        let mut order = DisplayOrder::default();
        let mut place = |header: &FrameHeader, layer: u8| order.place(&sequence, header, layer);
        assert_eq!(place(&FrameHeader::default(), 0), 0);
        assert_eq!(place(&FrameHeader::default(), 1), 0);
        assert_eq!(place(&inter, 0), 1);
        assert_eq!(place(&inter, 1), 1);
        // Not every picture needs every layer.
        assert_eq!(place(&inter, 1), 2);
        order.begin_unit();
        assert_eq!(order.place(&sequence, &inter, 2), 3);
    }
}
