//! §5.5: the sequence header.

use crate::bits::BitReader;
use crate::error::{Error, Result};

use super::color_config::ColorConfig;
use super::timing::{DecoderModelInfo, TimingInfo};

/// §3 `SELECT_SCREEN_CONTENT_TOOLS`: each frame chooses.
pub(crate) const SELECT_SCREEN_CONTENT_TOOLS: u8 = 2;
/// §3 `SELECT_INTEGER_MV`: each frame chooses.
pub(crate) const SELECT_INTEGER_MV: u8 = 2;

/// §5.5.1: one entry of the list of operating points.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct OperatingPoint {
    /// `operating_point_idc`: bits 0 to 7 temporal layers, bits 8 to 11 spatial layers; 0 means
    /// everything.
    pub(crate) idc: u16,
    pub(crate) seq_level_idx: u8,
    pub(crate) seq_tier: u8,
    /// `decoder_model_present_for_this_op`.
    pub(crate) decoder_model_present: bool,
    /// `initial_display_delay_minus_1`, if present.
    pub(crate) initial_display_delay_minus_1: Option<u8>,
}

/// §5.5.1 `sequence_header_obu`. Two headers compare equal if and only if they may belong to one
/// coded video sequence (§7.5: all but `operating_parameters_info` must be identical).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the enable flags of the specification, one to one"
)]
pub(crate) struct SequenceHeader {
    /// 0 to 2.
    pub(crate) seq_profile: u8,
    pub(crate) still_picture: bool,
    pub(crate) reduced_still_picture_header: bool,
    pub(crate) timing_info: Option<TimingInfo>,
    pub(crate) decoder_model_info: Option<DecoderModelInfo>,
    /// 1 to 32 entries.
    pub(crate) operating_points: Vec<OperatingPoint>,
    /// Bits used for coded frame widths, 1 to 16.
    pub(crate) frame_width_bits: u8,
    /// Bits used for coded frame heights, 1 to 16.
    pub(crate) frame_height_bits: u8,
    /// `max_frame_width_minus_1 + 1`, luma samples.
    pub(crate) max_frame_width: u32,
    /// `max_frame_height_minus_1 + 1`, luma samples.
    pub(crate) max_frame_height: u32,
    pub(crate) frame_id_numbers_present: bool,
    /// `delta_frame_id_length_minus_2 + 2`; 0 without frame ids.
    pub(crate) delta_frame_id_bits: u8,
    /// `idLen`, at most 16; 0 without frame ids.
    pub(crate) frame_id_bits: u8,
    pub(crate) use_128x128_superblock: bool,
    pub(crate) enable_filter_intra: bool,
    pub(crate) enable_intra_edge_filter: bool,
    pub(crate) enable_interintra_compound: bool,
    pub(crate) enable_masked_compound: bool,
    pub(crate) enable_warped_motion: bool,
    pub(crate) enable_dual_filter: bool,
    pub(crate) enable_order_hint: bool,
    pub(crate) enable_jnt_comp: bool,
    pub(crate) enable_ref_frame_mvs: bool,
    /// 0, 1 or [`SELECT_SCREEN_CONTENT_TOOLS`].
    pub(crate) seq_force_screen_content_tools: u8,
    /// 0, 1 or [`SELECT_INTEGER_MV`].
    pub(crate) seq_force_integer_mv: u8,
    /// `OrderHintBits`, 0 to 8.
    pub(crate) order_hint_bits: u8,
    pub(crate) enable_superres: bool,
    pub(crate) enable_cdef: bool,
    pub(crate) enable_restoration: bool,
    pub(crate) color: ColorConfig,
    pub(crate) film_grain_params_present: bool,
}

impl SequenceHeader {
    /// Reads the payload of a sequence header OBU up to and including its trailing bits.
    pub(crate) fn parse(reader: &mut BitReader<'_>) -> Result<Self> {
        let mut sequence = Self {
            seq_profile: reader.f8(3)?,
            ..Self::default()
        };
        if sequence.seq_profile > 2 {
            return Err(Error::Unsupported {
                feature: format!("reserved profile {}", sequence.seq_profile),
                section: "6.4.1",
            });
        }
        sequence.still_picture = reader.flag()?;
        sequence.reduced_still_picture_header = reader.flag()?;
        if sequence.reduced_still_picture_header && !sequence.still_picture {
            return Err(reader.malformed("6.4.1", "a reduced header needs still_picture"));
        }
        sequence.parse_operating_points(reader)?;
        sequence.parse_sizes(reader)?;
        sequence.use_128x128_superblock = reader.flag()?;
        sequence.enable_filter_intra = reader.flag()?;
        sequence.enable_intra_edge_filter = reader.flag()?;
        sequence.parse_inter_tools(reader)?;
        sequence.enable_superres = reader.flag()?;
        sequence.enable_cdef = reader.flag()?;
        sequence.enable_restoration = reader.flag()?;
        sequence.color = ColorConfig::parse(reader, sequence.seq_profile)?;
        sequence.film_grain_params_present = reader.flag()?;
        reader.trailing_bits()?;
        Ok(sequence)
    }

    fn parse_operating_points(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        if self.reduced_still_picture_header {
            self.operating_points = vec![OperatingPoint {
                seq_level_idx: reader.f8(5)?,
                ..OperatingPoint::default()
            }];
            return Ok(());
        }
        if reader.flag()? {
            self.timing_info = Some(TimingInfo::parse(reader)?);
            if reader.flag()? {
                self.decoder_model_info = Some(DecoderModelInfo::parse(reader)?);
            }
        }
        let initial_display_delay_present = reader.flag()?;
        let count = reader.f(5)? + 1;
        for _ in 0..count {
            let point = self.parse_operating_point(reader, initial_display_delay_present)?;
            self.operating_points.push(point);
        }
        Ok(())
    }

    fn parse_operating_point(
        &self,
        reader: &mut BitReader<'_>,
        initial_display_delay_present: bool,
    ) -> Result<OperatingPoint> {
        let mut point = OperatingPoint {
            idc: reader.f16(12)?,
            seq_level_idx: reader.f8(5)?,
            ..OperatingPoint::default()
        };
        if point.seq_level_idx > 7 {
            point.seq_tier = reader.f8(1)?;
        }
        if let Some(model) = &self.decoder_model_info {
            point.decoder_model_present = reader.flag()?;
            if point.decoder_model_present {
                model.skip_operating_parameters(reader)?;
            }
        }
        if initial_display_delay_present && reader.flag()? {
            point.initial_display_delay_minus_1 = Some(reader.f8(4)?);
        }
        Ok(point)
    }

    fn parse_sizes(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        self.frame_width_bits = reader.f8(4)? + 1;
        self.frame_height_bits = reader.f8(4)? + 1;
        self.max_frame_width = reader.f(self.frame_width_bits.into())? + 1;
        self.max_frame_height = reader.f(self.frame_height_bits.into())? + 1;
        if self.reduced_still_picture_header {
            return Ok(());
        }
        self.frame_id_numbers_present = reader.flag()?;
        if self.frame_id_numbers_present {
            self.delta_frame_id_bits = reader.f8(4)? + 2;
            self.frame_id_bits = self.delta_frame_id_bits + reader.f8(3)? + 1;
            if self.frame_id_bits > 16 {
                return Err(reader.malformed("6.8.2", "frame ids are longer than 16 bits"));
            }
        }
        Ok(())
    }

    fn parse_inter_tools(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        self.seq_force_screen_content_tools = SELECT_SCREEN_CONTENT_TOOLS;
        self.seq_force_integer_mv = SELECT_INTEGER_MV;
        if self.reduced_still_picture_header {
            return Ok(());
        }
        self.enable_interintra_compound = reader.flag()?;
        self.enable_masked_compound = reader.flag()?;
        self.enable_warped_motion = reader.flag()?;
        self.enable_dual_filter = reader.flag()?;
        self.enable_order_hint = reader.flag()?;
        if self.enable_order_hint {
            self.enable_jnt_comp = reader.flag()?;
            self.enable_ref_frame_mvs = reader.flag()?;
        }
        let seq_choose_screen_content_tools = reader.flag()?;
        if !seq_choose_screen_content_tools {
            self.seq_force_screen_content_tools = reader.f8(1)?;
        }
        if self.seq_force_screen_content_tools > 0 {
            let seq_choose_integer_mv = reader.flag()?;
            if !seq_choose_integer_mv {
                self.seq_force_integer_mv = reader.f8(1)?;
            }
        }
        if self.enable_order_hint {
            self.order_hint_bits = reader.f8(3)? + 1;
        }
        Ok(())
    }

    /// §5.9.3 `get_relative_dist`: how many pictures `a` comes after `b`; 0 without order hints.
    pub(crate) fn relative_dist(&self, a: u32, b: u32) -> i32 {
        if !self.enable_order_hint {
            return 0;
        }
        let difference = a.wrapping_sub(b).cast_signed();
        let sign_bit = 1 << (self.order_hint_bits - 1);
        (difference & (sign_bit - 1)) - (difference & sign_bit)
    }

    /// Whether frame headers carry `temporal_point_info` (§5.9.2); if so, its length in bits.
    pub(crate) fn presentation_time_bits(&self) -> Option<u32> {
        let model = self.decoder_model_info.as_ref()?;
        let timing = self.timing_info.as_ref()?;
        let equal_picture_interval = timing.num_ticks_per_picture_minus_1.is_some();
        (!equal_picture_interval).then_some(model.frame_presentation_time_length.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_distances_wrap_around() {
        let sequence = SequenceHeader {
            enable_order_hint: true,
            order_hint_bits: 4,
            ..SequenceHeader::default()
        };
        assert_eq!(sequence.relative_dist(3, 1), 2);
        assert_eq!(sequence.relative_dist(1, 15), 2);
        assert_eq!(sequence.relative_dist(15, 1), -2);
        assert_eq!(sequence.relative_dist(8, 0), -8);
        let unordered = SequenceHeader::default();
        assert_eq!(unordered.relative_dist(9, 2), 0);
    }

    #[test]
    fn a_reserved_profile_is_unsupported() {
        let mut reader = BitReader::new(&[0b0110_0000], 0);
        assert!(matches!(
            SequenceHeader::parse(&mut reader),
            Err(Error::Unsupported { .. })
        ));
    }
}
