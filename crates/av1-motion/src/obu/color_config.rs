//! §5.5.2: bit depth, planes and chroma subsampling.

use crate::bits::BitReader;
use crate::error::Result;

/// §6.4.2 `CP_BT_709`.
const CP_BT_709: u8 = 1;
/// §6.4.2 `CP_UNSPECIFIED`, `TC_UNSPECIFIED` and `MC_UNSPECIFIED`.
const UNSPECIFIED: u8 = 2;
/// §6.4.2 `TC_SRGB`.
const TC_SRGB: u8 = 13;
/// §6.4.2 `MC_IDENTITY`.
const MC_IDENTITY: u8 = 0;

/// §5.5.2 `color_config`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ColorConfig {
    /// 8, 10 or 12.
    pub(crate) bit_depth: u8,
    pub(crate) mono_chrome: bool,
    /// `NumPlanes`: 1 or 3.
    pub(crate) num_planes: u8,
    /// Code points of ISO/IEC 23091-4.
    pub(crate) color_primaries: u8,
    pub(crate) transfer_characteristics: u8,
    pub(crate) matrix_coefficients: u8,
    /// `color_range`: full swing.
    pub(crate) full_range: bool,
    /// 0 or 1.
    pub(crate) subsampling_x: u8,
    /// 0 or 1.
    pub(crate) subsampling_y: u8,
    pub(crate) chroma_sample_position: u8,
    pub(crate) separate_uv_delta_q: bool,
}

impl ColorConfig {
    /// Reads `color_config` of a sequence of profile `seq_profile` (0 to 2).
    pub(crate) fn parse(reader: &mut BitReader<'_>, seq_profile: u8) -> Result<Self> {
        let mut color = Self::default();
        let high_bitdepth = reader.flag()?;
        color.bit_depth = match (seq_profile, high_bitdepth) {
            (2, true) => [10, 12][usize::from(reader.flag()?)],
            (_, true) => 10,
            (_, false) => 8,
        };
        color.mono_chrome = seq_profile != 1 && reader.flag()?;
        color.num_planes = if color.mono_chrome { 1 } else { 3 };
        color.parse_description(reader)?;
        if color.mono_chrome {
            color.full_range = reader.flag()?;
            (color.subsampling_x, color.subsampling_y) = (1, 1);
            return Ok(color);
        }
        if color.is_srgb() {
            color.full_range = true;
        } else {
            color.full_range = reader.flag()?;
            (color.subsampling_x, color.subsampling_y) =
                subsampling(reader, seq_profile, color.bit_depth)?;
            if color.subsampling_x == 1 && color.subsampling_y == 1 {
                color.chroma_sample_position = reader.f8(2)?;
            }
        }
        color.separate_uv_delta_q = reader.flag()?;
        Ok(color)
    }

    fn parse_description(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        let color_description_present = reader.flag()?;
        if color_description_present {
            self.color_primaries = reader.f8(8)?;
            self.transfer_characteristics = reader.f8(8)?;
            self.matrix_coefficients = reader.f8(8)?;
        } else {
            self.color_primaries = UNSPECIFIED;
            self.transfer_characteristics = UNSPECIFIED;
            self.matrix_coefficients = UNSPECIFIED;
        }
        Ok(())
    }

    fn is_srgb(&self) -> bool {
        self.color_primaries == CP_BT_709
            && self.transfer_characteristics == TC_SRGB
            && self.matrix_coefficients == MC_IDENTITY
    }
}

/// Subsampling of x and y, read only where the profile leaves a choice.
fn subsampling(reader: &mut BitReader<'_>, seq_profile: u8, bit_depth: u8) -> Result<(u8, u8)> {
    Ok(match (seq_profile, bit_depth) {
        (0, _) => (1, 1),
        (1, _) => (0, 0),
        (_, 12) => {
            let subsampling_x = reader.f8(1)?;
            let subsampling_y = if subsampling_x == 1 { reader.f8(1)? } else { 0 };
            (subsampling_x, subsampling_y)
        }
        _ => (1, 0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_identity_is_full_range_444_without_further_bits() {
        // high_bitdepth 0, description 1, primaries 1, transfer 13, matrix 0, separate_uv 1.
        let bits = [0b0100_0000, 0b0100_0011, 0b0100_0000, 0b0010_0000];
        let mut reader = BitReader::new(&bits, 0);
        let color = ColorConfig::parse(&mut reader, 1).unwrap();
        assert_eq!((color.subsampling_x, color.subsampling_y), (0, 0));
        assert!(color.full_range && color.separate_uv_delta_q);
        assert_eq!(reader.position(), 27);
    }

    #[test]
    fn profile_2_with_12_bits_codes_its_subsampling() {
        // high 1, twelve 1, mono 0, description 0, range 0, sub_x 1, sub_y 0, separate 0.
        let mut reader = BitReader::new(&[0b1100_0100], 0);
        let color = ColorConfig::parse(&mut reader, 2).unwrap();
        assert_eq!(color.bit_depth, 12);
        assert_eq!((color.subsampling_x, color.subsampling_y), (1, 0));
        assert_eq!(reader.position(), 8);
    }
}
