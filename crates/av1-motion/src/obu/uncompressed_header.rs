//! §5.9.2: reads a frame header, in the order of the specification.

use crate::bits::BitReader;
use crate::error::Result;
use crate::limits::Limits;
use crate::refs::{ReferenceSlots, SlotState};

use super::cdef::CdefParams;
use super::delta::{DeltaLfParams, DeltaQParams};
use super::film_grain::FilmGrainParams;
use super::frame_header::{
    ALL_FRAMES, FrameHeader, FrameType, PRIMARY_REF_NONE, REFS_PER_FRAME, SWITCHABLE, TxMode,
};
use super::frame_references::{check_scaling, parse_frame_references, parse_ref_order_hints};
use super::frame_size::FrameSize;
use super::global_motion::{DEFAULT_GM_PARAMS, parse_global_motion};
use super::header::ObuHeader;
use super::loop_filter::LoopFilterParams;
use super::loop_restoration::LoopRestorationParams;
use super::quantization::QuantizationParams;
use super::segmentation::SegmentationParams;
use super::sequence_header::{SELECT_INTEGER_MV, SELECT_SCREEN_CONTENT_TOOLS, SequenceHeader};
use super::skip_mode::skip_mode_frames;
use super::tile_info::TileInfo;

impl FrameHeader {
    /// §5.9.2: reads `uncompressed_header`; trailing or alignment bits are left to the caller.
    ///
    /// Changes `slots` as the header demands before the frame is decoded: a shown key frame
    /// invalidates them, frame ids and `ref_order_hint` reveal lost frames. On an error they are
    /// left as they were. [`ReferenceSlots::update`] stores the frame afterwards.
    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "borrowed like the other facts about the frame"
    )]
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        sequence: &SequenceHeader,
        slots: &mut ReferenceSlots,
        obu: &ObuHeader,
        limits: &Limits,
    ) -> Result<Self> {
        let mut working = slots.clone();
        let mut parser = HeaderParser {
            reader,
            sequence,
            slots: &mut working,
            obu,
            limits,
            header: Self::default(),
        };
        parser.parse()?;
        let header = parser.header;
        *slots = working;
        Ok(header)
    }
}

struct HeaderParser<'p, 'd> {
    reader: &'p mut BitReader<'d>,
    sequence: &'p SequenceHeader,
    slots: &'p mut ReferenceSlots,
    obu: &'p ObuHeader,
    limits: &'p Limits,
    header: FrameHeader,
}

impl HeaderParser<'_, '_> {
    fn parse(&mut self) -> Result<()> {
        if !self.sequence.reduced_still_picture_header {
            self.header.show_existing_frame = self.reader.flag()?;
            if self.header.show_existing_frame {
                return self.parse_shown_frame();
            }
            self.parse_frame_type()?;
        }
        if self.header.is_shown_key() {
            self.slots.invalidate();
        }
        self.header.disable_cdf_update = self.reader.flag()?;
        self.parse_screen_content()?;
        self.parse_identity()?;
        self.skip_buffer_removal_times()?;
        self.parse_refresh()?;
        if self.header.frame_is_intra {
            self.parse_intra_setup()?;
        } else {
            self.parse_inter_setup()?;
        }
        self.header.disable_frame_end_update_cdf = self.sequence.reduced_still_picture_header
            || self.header.disable_cdf_update
            || self.reader.flag()?;
        self.parse_quantization()?;
        self.parse_filters()?;
        self.parse_prediction_modes()?;
        self.parse_film_grain()
    }

    /// The branch of `show_existing_frame` = 1.
    fn parse_shown_frame(&mut self) -> Result<()> {
        let index = self.reader.f8(3)?;
        self.parse_presentation_time()?;
        let slot = &self.slots[index.into()];
        if slot.state != SlotState::Filled {
            let reason = format!("the frame to show, in slot {index}, is not there");
            return Err(self.reader.missing("6.8.2", reason));
        }
        if self.sequence.frame_id_numbers_present {
            let display_frame_id = self.reader.f(self.sequence.frame_id_bits.into())?;
            if display_frame_id != slot.frame_id || !slot.valid {
                let reason = format!(
                    "the frame to show has id {display_frame_id}, but slot {index} holds id {}",
                    slot.frame_id
                );
                return Err(self.reader.missing("6.8.2", reason));
            }
        }
        if !slot.showable_frame {
            let reason = format!("the frame in slot {index} may not be shown");
            return Err(self.reader.malformed("6.8.2", reason));
        }
        slot.load_into(&mut self.header);
        self.header.frame_to_show_map_idx = index;
        self.header.refresh_frame_flags = if self.header.frame_type == FrameType::Key {
            ALL_FRAMES
        } else {
            0
        };
        Ok(())
    }

    /// §5.9.31 `temporal_point_info`, where the sequence demands it.
    fn parse_presentation_time(&mut self) -> Result<()> {
        if let Some(bits) = self.sequence.presentation_time_bits() {
            self.header.frame_presentation_time = Some(self.reader.f(bits)?);
        }
        Ok(())
    }

    fn parse_frame_type(&mut self) -> Result<()> {
        self.header.frame_type = FrameType::from(self.reader.f8(2)?);
        self.header.frame_is_intra = self.header.frame_type.is_intra();
        self.header.show_frame = self.reader.flag()?;
        if self.header.show_frame {
            self.parse_presentation_time()?;
            self.header.showable_frame = self.header.frame_type != FrameType::Key;
        } else {
            self.header.showable_frame = self.reader.flag()?;
        }
        self.header.error_resilient_mode = self.header.frame_type == FrameType::Switch
            || self.header.is_shown_key()
            || self.reader.flag()?;
        Ok(())
    }

    fn parse_screen_content(&mut self) -> Result<()> {
        let choice = self.sequence.seq_force_screen_content_tools;
        self.header.allow_screen_content_tools = if choice == SELECT_SCREEN_CONTENT_TOOLS {
            self.reader.flag()?
        } else {
            choice == 1
        };
        if self.header.allow_screen_content_tools {
            let choice = self.sequence.seq_force_integer_mv;
            self.header.force_integer_mv = if choice == SELECT_INTEGER_MV {
                self.reader.flag()?
            } else {
                choice == 1
            };
        }
        self.header.force_integer_mv |= self.header.frame_is_intra;
        Ok(())
    }

    /// Frame id, size override, order hint and primary reference frame.
    fn parse_identity(&mut self) -> Result<()> {
        if self.sequence.frame_id_numbers_present {
            let id = self.reader.f(self.sequence.frame_id_bits.into())?;
            self.header.current_frame_id = id;
            self.slots.mark_ref_frames(id, self.sequence);
        }
        self.header.frame_size_override = self.header.frame_type == FrameType::Switch
            || (!self.sequence.reduced_still_picture_header && self.reader.flag()?);
        self.header.order_hint = self.reader.f(self.sequence.order_hint_bits.into())?;
        self.header.primary_ref_frame =
            if self.header.frame_is_intra || self.header.error_resilient_mode {
                PRIMARY_REF_NONE
            } else {
                self.reader.f8(3)?
            };
        Ok(())
    }

    fn skip_buffer_removal_times(&mut self) -> Result<()> {
        let Some(model) = &self.sequence.decoder_model_info else {
            return Ok(());
        };
        let buffer_removal_time_present = self.reader.flag()?;
        if !buffer_removal_time_present {
            return Ok(());
        }
        for point in &self.sequence.operating_points {
            let in_temporal_layer = (point.idc >> self.obu.temporal_id) & 1 == 1;
            let in_spatial_layer = (point.idc >> (self.obu.spatial_id + 8)) & 1 == 1;
            if point.decoder_model_present
                && (point.idc == 0 || (in_temporal_layer && in_spatial_layer))
            {
                let _buffer_removal_time =
                    self.reader.f(model.buffer_removal_time_length.into())?;
            }
        }
        Ok(())
    }

    fn parse_refresh(&mut self) -> Result<()> {
        let header = &mut self.header;
        header.refresh_frame_flags =
            if header.frame_type == FrameType::Switch || header.is_shown_key() {
                ALL_FRAMES
            } else {
                self.reader.f8(8)?
            };
        if header.frame_type == FrameType::IntraOnly && header.refresh_frame_flags == ALL_FRAMES {
            return Err(self
                .reader
                .malformed("6.8.2", "an intra-only frame refreshes every slot"));
        }
        let has_survivors = !header.frame_is_intra || header.refresh_frame_flags != ALL_FRAMES;
        if has_survivors && header.error_resilient_mode && self.sequence.enable_order_hint {
            parse_ref_order_hints(self.reader, self.sequence, self.slots)?;
        }
        Ok(())
    }

    fn parse_intra_setup(&mut self) -> Result<()> {
        let header = &mut self.header;
        header.size = FrameSize::parse(
            self.reader,
            self.sequence,
            header.frame_size_override,
            self.limits,
        )?;
        let unscaled = header.size.upscaled_width == header.size.frame_width;
        header.allow_intrabc =
            header.allow_screen_content_tools && unscaled && self.reader.flag()?;
        Ok(())
    }

    fn parse_inter_setup(&mut self) -> Result<()> {
        let (reader, header) = (&mut *self.reader, &mut self.header);
        parse_frame_references(reader, self.sequence, self.slots, header)?;
        header.size = if header.frame_size_override && !header.error_resilient_mode {
            let references = self.slots.named(&header.ref_frame_idx);
            FrameSize::parse_with_refs(reader, self.sequence, references, self.limits)?
        } else {
            FrameSize::parse(
                reader,
                self.sequence,
                header.frame_size_override,
                self.limits,
            )?
        };
        check_scaling(reader, self.slots, header)?;
        header.allow_high_precision_mv = !header.force_integer_mv && reader.flag()?;
        let is_filter_switchable = reader.flag()?;
        header.interpolation_filter = if is_filter_switchable {
            SWITCHABLE
        } else {
            reader.f8(2)?
        };
        header.is_motion_mode_switchable = reader.flag()?;
        header.use_ref_frame_mvs =
            !header.error_resilient_mode && self.sequence.enable_ref_frame_mvs && reader.flag()?;
        self.derive_order_hints();
        self.check_primary_reference()
    }

    fn derive_order_hints(&mut self) {
        let header = &mut self.header;
        for (name, slot) in (1..).zip(self.slots.named(&header.ref_frame_idx)) {
            let distance = self
                .sequence
                .relative_dist(slot.order_hint, header.order_hint);
            header.order_hints[name] = slot.order_hint;
            header.ref_frame_sign_bias[name] = distance > 0;
        }
    }

    /// CDFs and other state can only be loaded from a frame that was decoded.
    fn check_primary_reference(&self) -> Result<()> {
        let Some(slot) = self.header.primary_slot() else {
            return Ok(());
        };
        if self.slots[slot].state != SlotState::Filled {
            let reason = format!("the primary reference frame, in slot {slot}, was lost");
            return Err(self.reader.missing("6.8.2", reason));
        }
        Ok(())
    }

    /// From `tile_info` to `AllLossless`.
    fn parse_quantization(&mut self) -> Result<()> {
        let (reader, header) = (&mut *self.reader, &mut self.header);
        header.tile_info = TileInfo::parse(
            reader,
            &header.size,
            self.sequence.use_128x128_superblock,
            self.limits,
        )?;
        header.quantization = QuantizationParams::parse(reader, &self.sequence.color)?;
        let primary = header.primary_slot().map(|slot| &self.slots[slot]);
        let features = primary.map(|slot| &slot.segmentation_features);
        header.segmentation = SegmentationParams::parse(reader, features)?;
        let delta_q = DeltaQParams::parse(reader, header.quantization.base_q_idx)?;
        let delta_lf = DeltaLfParams::parse(reader, delta_q.present, header.allow_intrabc)?;
        header.set_deltas(delta_q, delta_lf);
        header.derive_lossless();
        if header.coded_lossless && header.delta_q_present {
            return Err(reader.malformed("6.8.2", "a lossless frame has quantizer deltas"));
        }
        Ok(())
    }

    /// Loop filter, CDEF and loop restoration.
    fn parse_filters(&mut self) -> Result<()> {
        let (reader, header) = (&mut *self.reader, &mut self.header);
        let color = &self.sequence.color;
        if !header.coded_lossless && !header.allow_intrabc {
            let primary = header.primary_slot().map(|slot| &self.slots[slot]);
            let deltas = primary.map_or_else(Default::default, |slot| slot.loop_filter_deltas);
            header.loop_filter = LoopFilterParams::parse(reader, color.num_planes, deltas)?;
            if self.sequence.enable_cdef {
                header.cdef = CdefParams::parse(reader, color.num_planes)?;
            }
        }
        if !header.all_lossless && !header.allow_intrabc && self.sequence.enable_restoration {
            let use_128 = self.sequence.use_128x128_superblock;
            header.loop_restoration = LoopRestorationParams::parse(reader, color, use_128)?;
        }
        Ok(())
    }

    /// From `read_tx_mode` to `global_motion_params`.
    fn parse_prediction_modes(&mut self) -> Result<()> {
        let (reader, header) = (&mut *self.reader, &mut self.header);
        header.tx_mode = if header.coded_lossless {
            TxMode::Only4x4
        } else if reader.flag()? {
            TxMode::Select
        } else {
            TxMode::Largest
        };
        header.reference_select = !header.frame_is_intra && reader.flag()?;
        if header.reference_select && self.sequence.enable_order_hint {
            let hints: [u32; REFS_PER_FRAME] =
                std::array::from_fn(|index| header.order_hints[index + 1]);
            if let Some(frames) = skip_mode_frames(self.sequence, &hints, header.order_hint) {
                header.skip_mode_frame = frames;
                header.skip_mode_present = reader.flag()?;
            }
        }
        header.allow_warped_motion = !header.frame_is_intra
            && !header.error_resilient_mode
            && self.sequence.enable_warped_motion
            && reader.flag()?;
        header.reduced_tx_set = reader.flag()?;
        if !header.frame_is_intra {
            let primary = header.primary_slot().map(|slot| &self.slots[slot]);
            let previous = primary.map_or(&DEFAULT_GM_PARAMS, |slot| &slot.gm_params);
            (header.gm_type, header.gm_params) =
                parse_global_motion(reader, header.allow_high_precision_mv, previous)?;
        }
        Ok(())
    }

    /// §5.9.30 `film_grain_params`.
    fn parse_film_grain(&mut self) -> Result<()> {
        let (reader, header) = (&mut *self.reader, &mut self.header);
        let may_be_shown = header.show_frame || header.showable_frame;
        if !self.sequence.film_grain_params_present || !may_be_shown {
            return Ok(());
        }
        let is_inter_frame = header.frame_type == FrameType::Inter;
        let saved = |slot: u8| {
            let is_named = header.ref_frame_idx.contains(&slot);
            is_named.then(|| &self.slots[slot.into()].film_grain)
        };
        header.film_grain =
            FilmGrainParams::parse(reader, &self.sequence.color, is_inter_frame, saved)?;
        Ok(())
    }
}
