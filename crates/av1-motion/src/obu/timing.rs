//! §5.5.3 to §5.5.5: timing and decoder model. Only field lengths matter to the rest of the
//! headers; nothing here affects motion vectors.

use crate::bits::BitReader;
use crate::error::Result;

/// §5.5.3 `timing_info`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TimingInfo {
    pub(crate) num_units_in_display_tick: u32,
    pub(crate) time_scale: u32,
    /// `num_ticks_per_picture_minus_1` if `equal_picture_interval` is set.
    pub(crate) num_ticks_per_picture_minus_1: Option<u32>,
}

impl TimingInfo {
    /// Reads `timing_info`.
    pub(crate) fn parse(reader: &mut BitReader<'_>) -> Result<Self> {
        let num_units_in_display_tick = reader.f(32)?;
        let time_scale = reader.f(32)?;
        let equal_picture_interval = reader.flag()?;
        Ok(Self {
            num_units_in_display_tick,
            time_scale,
            num_ticks_per_picture_minus_1: if equal_picture_interval {
                Some(reader.uvlc()?)
            } else {
                None
            },
        })
    }
}

/// §5.5.4 `decoder_model_info`; lengths in bits, 1 to 32.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct DecoderModelInfo {
    pub(crate) buffer_delay_length: u8,
    pub(crate) num_units_in_decoding_tick: u32,
    pub(crate) buffer_removal_time_length: u8,
    pub(crate) frame_presentation_time_length: u8,
}

impl DecoderModelInfo {
    /// Reads `decoder_model_info`.
    pub(crate) fn parse(reader: &mut BitReader<'_>) -> Result<Self> {
        Ok(Self {
            buffer_delay_length: reader.f8(5)? + 1,
            num_units_in_decoding_tick: reader.f(32)?,
            buffer_removal_time_length: reader.f8(5)? + 1,
            frame_presentation_time_length: reader.f8(5)? + 1,
        })
    }

    /// §5.5.5: skips `operating_parameters_info`. It may differ between otherwise identical
    /// sequence headers (§7.5), so it is not kept.
    pub(crate) fn skip_operating_parameters(&self, reader: &mut BitReader<'_>) -> Result<()> {
        let length = u32::from(self.buffer_delay_length);
        let _decoder_buffer_delay = reader.f(length)?;
        let _encoder_buffer_delay = reader.f(length)?;
        let _low_delay_mode = reader.flag()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_per_picture_are_read_only_for_equal_intervals() {
        let equal = [0, 0, 0, 1, 0, 0, 0, 30, 0b1010_0000];
        let mut reader = BitReader::new(&equal, 0);
        let timing = TimingInfo::parse(&mut reader).unwrap();
        assert_eq!(timing.time_scale, 30);
        assert_eq!(timing.num_ticks_per_picture_minus_1, Some(1));
        assert_eq!(reader.position(), 68);
        let free = [0, 0, 0, 1, 0, 0, 0, 30, 0];
        let mut reader = BitReader::new(&free, 0);
        let timing = TimingInfo::parse(&mut reader).unwrap();
        assert_eq!(timing.num_ticks_per_picture_minus_1, None);
        assert_eq!(reader.position(), 65);
    }
}
