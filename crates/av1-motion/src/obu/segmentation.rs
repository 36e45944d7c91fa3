//! §5.9.14: segments and their features.

use crate::bits::BitReader;
use crate::error::Result;
pub(crate) use crate::tables::symbols::{
    MAX_SEGMENTS, SEG_LVL_ALT_Q, SEG_LVL_MAX, SEG_LVL_REF_FRAME,
};

/// The segments' numbers.
pub(crate) const SEGMENTS: [u8; MAX_SEGMENTS] = [0, 1, 2, 3, 4, 5, 6, 7];

/// §5.9.14 `Segmentation_Feature_Bits`.
const FEATURE_BITS: [u32; SEG_LVL_MAX] = [8, 6, 6, 6, 6, 3, 0, 0];
/// §5.9.14 `Segmentation_Feature_Signed`.
const FEATURE_SIGNED: [bool; SEG_LVL_MAX] = [true, true, true, true, true, false, false, false];
/// §5.9.14 `Segmentation_Feature_Max`.
const FEATURE_MAX: [i16; SEG_LVL_MAX] = [255, 63, 63, 63, 63, 7, 0, 0];

/// `FeatureEnabled` and `FeatureData`, `[segment][feature]`: what slots save.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct SegmentationFeatures {
    pub(crate) enabled: [[bool; SEG_LVL_MAX]; MAX_SEGMENTS],
    pub(crate) data: [[i16; SEG_LVL_MAX]; MAX_SEGMENTS],
}

/// §5.9.14 `segmentation_params`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the specification, one to one"
)]
pub(crate) struct SegmentationParams {
    /// `segmentation_enabled`.
    pub(crate) enabled: bool,
    /// `segmentation_update_map`.
    pub(crate) update_map: bool,
    /// `segmentation_temporal_update`.
    pub(crate) temporal_update: bool,
    /// `segmentation_update_data`.
    pub(crate) update_data: bool,
    /// `FeatureEnabled[segment][feature]`.
    pub(crate) feature_enabled: [[bool; SEG_LVL_MAX]; MAX_SEGMENTS],
    /// `FeatureData[segment][feature]`, clipped to the feature's range.
    pub(crate) feature_data: [[i16; SEG_LVL_MAX]; MAX_SEGMENTS],
    /// `SegIdPreSkip`.
    pub(crate) seg_id_pre_skip: bool,
    /// `LastActiveSegId`.
    pub(crate) last_active_seg_id: u8,
}

impl SegmentationParams {
    /// Reads `segmentation_params`. `previous` are the features of the primary reference frame;
    /// `None` stands for `PRIMARY_REF_NONE`.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        previous: Option<&SegmentationFeatures>,
    ) -> Result<Self> {
        let mut params = Self {
            enabled: reader.flag()?,
            ..Self::default()
        };
        if !params.enabled {
            return Ok(params);
        }
        if let Some(features) = previous {
            params.update_map = reader.flag()?;
            params.temporal_update = params.update_map && reader.flag()?;
            params.update_data = reader.flag()?;
            params.feature_enabled = features.enabled;
            params.feature_data = features.data;
        } else {
            params.update_map = true;
            params.update_data = true;
        }
        if params.update_data {
            params.parse_features(reader)?;
        }
        params.derive_segment_id_rules();
        Ok(params)
    }

    fn parse_features(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        for segment in 0..MAX_SEGMENTS {
            for feature in 0..SEG_LVL_MAX {
                let enabled = reader.flag()?;
                self.feature_enabled[segment][feature] = enabled;
                self.feature_data[segment][feature] = if enabled {
                    read_feature_value(reader, feature)?
                } else {
                    0
                };
            }
        }
        Ok(())
    }

    fn derive_segment_id_rules(&mut self) {
        for (segment, enabled) in SEGMENTS.iter().zip(&self.feature_enabled) {
            if enabled.contains(&true) {
                self.last_active_seg_id = *segment;
            }
            self.seg_id_pre_skip |= enabled[SEG_LVL_REF_FRAME..].contains(&true);
        }
    }

    /// §5.11.14 `seg_feature_active_idx`.
    pub(crate) fn feature_active(&self, segment: u8, feature: usize) -> bool {
        self.enabled && self.feature_enabled[usize::from(segment)][feature]
    }

    /// What §7.20 saves.
    pub(crate) fn features(&self) -> SegmentationFeatures {
        SegmentationFeatures {
            enabled: self.feature_enabled,
            data: self.feature_data,
        }
    }
}

fn read_feature_value(reader: &mut BitReader<'_>, feature: usize) -> Result<i16> {
    let maximum = FEATURE_MAX[feature];
    let value = if FEATURE_SIGNED[feature] {
        reader.su(1 + FEATURE_BITS[feature])?
    } else {
        reader.f(FEATURE_BITS[feature])?.cast_signed()
    };
    // At most nine bits, so the conversion holds.
    Ok(i16::try_from(value)
        .unwrap_or(maximum)
        .clamp(-maximum, maximum))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clipped_and_the_reference_feature_sets_pre_skip() {
        // enabled; segment 0: alt_q coded -256 (clips to -255), then 7 absent;
        // segment 1: five absent, reference 5 coded, two absent; six segments absent.
        let mut bits = String::from("1");
        bits += "1100000000";
        bits += "0000000";
        bits += "00000";
        bits += "1101";
        bits += "00";
        bits += &"0".repeat(48);
        let bytes = bytes_of(&bits);
        let mut reader = BitReader::new(&bytes, 0);
        let params = SegmentationParams::parse(&mut reader, None).unwrap();
        assert_eq!(reader.position(), bits.len());
        assert_eq!(params.feature_data[0][SEG_LVL_ALT_Q], -255);
        assert_eq!(params.feature_data[1][SEG_LVL_REF_FRAME], 5);
        assert!(params.feature_active(1, SEG_LVL_REF_FRAME));
        assert!(!params.feature_active(0, SEG_LVL_REF_FRAME));
        assert!(params.seg_id_pre_skip && params.update_map);
        assert_eq!(params.last_active_seg_id, 1);
    }

    #[test]
    fn features_persist_unless_updated_and_vanish_when_disabled() {
        let mut previous = SegmentationFeatures::default();
        previous.enabled[3][SEG_LVL_ALT_Q] = true;
        previous.data[3][SEG_LVL_ALT_Q] = 9;
        // enabled 1, update_map 0, update_data 0.
        let mut reader = BitReader::new(&[0b1000_0000], 0);
        let kept = SegmentationParams::parse(&mut reader, Some(&previous)).unwrap();
        assert_eq!(reader.position(), 3);
        assert_eq!(kept.features(), previous);
        assert_eq!(kept.last_active_seg_id, 3);
        let mut reader = BitReader::new(&[0], 0);
        let disabled = SegmentationParams::parse(&mut reader, Some(&previous)).unwrap();
        assert_eq!(disabled.features(), SegmentationFeatures::default());
    }

    fn bytes_of(bits: &str) -> Vec<u8> {
        bits.as_bytes()
            .chunks(8)
            .map(|chunk| {
                let ones = chunk.iter().enumerate();
                ones.fold(0, |byte, (i, &bit)| byte | ((bit - b'0') << (7 - i)))
            })
            .collect()
    }
}
