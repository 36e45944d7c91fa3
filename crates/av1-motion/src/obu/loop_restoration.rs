//! §5.9.20: loop restoration. Types and unit sizes decide which symbols tiles carry.

use crate::bits::BitReader;
use crate::error::Result;
use crate::tables::symbols::{
    RESTORATION_TILESIZE_MAX, RESTORE_NONE, RESTORE_SGRPROJ, RESTORE_SWITCHABLE, RESTORE_WIENER,
};

use super::color_config::ColorConfig;

/// §5.9.20 `Remap_Lr_Type`.
const REMAP_LR_TYPE: [u8; 4] = [
    RESTORE_NONE,
    RESTORE_SWITCHABLE,
    RESTORE_WIENER,
    RESTORE_SGRPROJ,
];

/// §5.9.20 `lr_params`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct LoopRestorationParams {
    /// `UsesLr`: some plane is restored.
    pub(crate) uses_lr: bool,
    /// `FrameRestorationType`, by plane.
    pub(crate) frame_restoration_type: [u8; 3],
    /// `LoopRestorationSize`, by plane, samples of that plane; 0 without restoration.
    pub(crate) loop_restoration_size: [u32; 3],
}

impl LoopRestorationParams {
    /// Reads `lr_params` of a frame that does not exclude restoration.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        color: &ColorConfig,
        use_128x128_superblock: bool,
    ) -> Result<Self> {
        let mut params = Self::default();
        for plane in 0..usize::from(color.num_planes) {
            let lr_type = reader.f(2)? as usize;
            params.frame_restoration_type[plane] = REMAP_LR_TYPE[lr_type];
        }
        params.uses_lr = params.frame_restoration_type != [RESTORE_NONE; 3];
        if !params.uses_lr {
            return Ok(params);
        }
        let uses_chroma_lr = params.frame_restoration_type[1..] != [RESTORE_NONE; 2];
        let mut lr_unit_shift = reader.f(1)?;
        if use_128x128_superblock {
            lr_unit_shift += 1;
        } else if lr_unit_shift == 1 {
            let lr_unit_extra_shift = reader.f(1)?;
            lr_unit_shift += lr_unit_extra_shift;
        }
        let is_420 = color.subsampling_x == 1 && color.subsampling_y == 1;
        let lr_uv_shift = if is_420 && uses_chroma_lr {
            reader.f(1)?
        } else {
            0
        };
        let luma_size = RESTORATION_TILESIZE_MAX >> (2 - lr_unit_shift);
        let chroma_size = luma_size >> lr_uv_shift;
        params.loop_restoration_size = [luma_size, chroma_size, chroma_size];
        Ok(params)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color_420() -> ColorConfig {
        ColorConfig {
            num_planes: 3,
            subsampling_x: 1,
            subsampling_y: 1,
            ..ColorConfig::default()
        }
    }

    #[test]
    fn coded_types_are_renumbered_and_units_halve_in_chroma() {
        // Y switchable, U none, V self-guided; shift 1, extra 1, uv shift 1.
        let mut reader = BitReader::new(&[0b0100_1111, 0b1000_0000], 0);
        let params = LoopRestorationParams::parse(&mut reader, &color_420(), false).unwrap();
        assert_eq!(params.frame_restoration_type, [3, 0, 2]);
        assert_eq!(params.loop_restoration_size, [256, 128, 128]);
        assert_eq!(reader.position(), 9);
    }

    #[test]
    fn units_are_never_smaller_than_a_128_superblock() {
        // Y Wiener, chroma none; shift 0.
        let mut reader = BitReader::new(&[0b1000_0000], 0);
        let params = LoopRestorationParams::parse(&mut reader, &color_420(), true).unwrap();
        assert_eq!(params.frame_restoration_type[0], RESTORE_WIENER);
        assert_eq!(params.loop_restoration_size[0], 128);
        assert_eq!(reader.position(), 7);
    }
}
