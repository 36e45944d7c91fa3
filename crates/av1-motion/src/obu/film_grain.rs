//! §5.9.30: film grain. Nothing here affects motion, but it must be read to find the end of the
//! header, and slots carry it from frame to frame.

use crate::bits::BitReader;
use crate::error::Result;

use super::color_config::ColorConfig;

/// §6.8.20: most points of the luma scaling function.
const MAX_Y_POINTS: u8 = 14;
/// §6.8.20: most points of a chroma scaling function.
const MAX_CHROMA_POINTS: u8 = 10;

/// One point of a piecewise linear scaling function.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct ScalingPoint {
    pub(crate) value: u8,
    pub(crate) scaling: u8,
}

/// Chroma mixing factors (`cb_mult` and so on); zeros if the plane has no points.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct ChromaMix {
    pub(crate) mult: u8,
    pub(crate) luma_mult: u8,
    /// 9 bits.
    pub(crate) offset: u16,
}

/// §5.9.30 `film_grain_params`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the specification, one to one"
)]
pub(crate) struct FilmGrainParams {
    pub(crate) apply_grain: bool,
    pub(crate) grain_seed: u16,
    pub(crate) update_grain: bool,
    /// At most 14.
    pub(crate) y_points: Vec<ScalingPoint>,
    pub(crate) chroma_scaling_from_luma: bool,
    /// At most 10.
    pub(crate) cb_points: Vec<ScalingPoint>,
    /// At most 10.
    pub(crate) cr_points: Vec<ScalingPoint>,
    pub(crate) grain_scaling_minus_8: u8,
    pub(crate) ar_coeff_lag: u8,
    /// At most 24.
    pub(crate) ar_coeffs_y_plus_128: Vec<u8>,
    /// At most 25.
    pub(crate) ar_coeffs_cb_plus_128: Vec<u8>,
    /// At most 25.
    pub(crate) ar_coeffs_cr_plus_128: Vec<u8>,
    pub(crate) ar_coeff_shift_minus_6: u8,
    pub(crate) grain_scale_shift: u8,
    pub(crate) cb_mix: ChromaMix,
    pub(crate) cr_mix: ChromaMix,
    pub(crate) overlap_flag: bool,
    pub(crate) clip_to_restricted_range: bool,
}

impl FilmGrainParams {
    /// Reads `film_grain_params` of a frame that may be shown. `saved` gives the parameters of a
    /// slot if the frame refers to it; only frames of type `INTER_FRAME` may reuse them.
    pub(crate) fn parse<'s>(
        reader: &mut BitReader<'_>,
        color: &ColorConfig,
        is_inter_frame: bool,
        saved: impl Fn(u8) -> Option<&'s Self>,
    ) -> Result<Self> {
        let apply_grain = reader.flag()?;
        if !apply_grain {
            return Ok(Self::default());
        }
        let grain_seed = reader.f16(16)?;
        let update_grain = !is_inter_frame || reader.flag()?;
        if update_grain {
            return Self::parse_new(reader, color, grain_seed);
        }
        let film_grain_params_ref_idx = reader.f8(3)?;
        let Some(params) = saved(film_grain_params_ref_idx) else {
            let reason = format!("film grain of slot {film_grain_params_ref_idx}, no reference");
            return Err(reader.malformed("6.8.20", reason));
        };
        Ok(Self {
            grain_seed,
            ..params.clone()
        })
    }

    /// The rest of `film_grain_params`, from `num_y_points` on.
    fn parse_new(reader: &mut BitReader<'_>, color: &ColorConfig, grain_seed: u16) -> Result<Self> {
        let mut params = Self {
            apply_grain: true,
            grain_seed,
            update_grain: true,
            ..Self::default()
        };
        params.parse_points(reader, color)?;
        params.grain_scaling_minus_8 = reader.f8(2)?;
        params.ar_coeff_lag = reader.f8(2)?;
        params.parse_coefficients(reader)?;
        params.ar_coeff_shift_minus_6 = reader.f8(2)?;
        params.grain_scale_shift = reader.f8(2)?;
        if !params.cb_points.is_empty() {
            params.cb_mix = read_mix(reader)?;
        }
        if !params.cr_points.is_empty() {
            params.cr_mix = read_mix(reader)?;
        }
        params.overlap_flag = reader.flag()?;
        params.clip_to_restricted_range = reader.flag()?;
        Ok(params)
    }

    fn parse_points(&mut self, reader: &mut BitReader<'_>, color: &ColorConfig) -> Result<()> {
        self.y_points = read_points(reader, MAX_Y_POINTS)?;
        self.chroma_scaling_from_luma = !color.mono_chrome && reader.flag()?;
        let is_420 = color.subsampling_x == 1 && color.subsampling_y == 1;
        if color.mono_chrome
            || self.chroma_scaling_from_luma
            || (is_420 && self.y_points.is_empty())
        {
            return Ok(());
        }
        self.cb_points = read_points(reader, MAX_CHROMA_POINTS)?;
        self.cr_points = read_points(reader, MAX_CHROMA_POINTS)?;
        if is_420 && self.cb_points.is_empty() != self.cr_points.is_empty() {
            return Err(reader.malformed("6.8.20", "4:2:0 film grain for one chroma plane only"));
        }
        Ok(())
    }

    fn parse_coefficients(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        let lag = usize::from(self.ar_coeff_lag);
        let luma_count = 2 * lag * (lag + 1);
        let mut chroma_count = luma_count;
        if !self.y_points.is_empty() {
            chroma_count += 1;
            self.ar_coeffs_y_plus_128 = read_bytes(reader, luma_count)?;
        }
        if self.chroma_scaling_from_luma || !self.cb_points.is_empty() {
            self.ar_coeffs_cb_plus_128 = read_bytes(reader, chroma_count)?;
        }
        if self.chroma_scaling_from_luma || !self.cr_points.is_empty() {
            self.ar_coeffs_cr_plus_128 = read_bytes(reader, chroma_count)?;
        }
        Ok(())
    }
}

fn read_points(reader: &mut BitReader<'_>, maximum: u8) -> Result<Vec<ScalingPoint>> {
    let count = reader.f8(4)?;
    if count > maximum {
        return Err(reader.malformed("6.8.20", format!("{count} film grain points")));
    }
    let mut points: Vec<ScalingPoint> = Vec::with_capacity(count.into());
    for _ in 0..count {
        let point = ScalingPoint {
            value: reader.f8(8)?,
            scaling: reader.f8(8)?,
        };
        if points.last().is_some_and(|last| point.value <= last.value) {
            return Err(reader.malformed("6.8.20", "film grain points are not increasing"));
        }
        points.push(point);
    }
    Ok(points)
}

fn read_bytes(reader: &mut BitReader<'_>, count: usize) -> Result<Vec<u8>> {
    (0..count).map(|_| reader.f8(8)).collect()
}

fn read_mix(reader: &mut BitReader<'_>) -> Result<ChromaMix> {
    Ok(ChromaMix {
        mult: reader.f8(8)?,
        luma_mult: reader.f8(8)?,
        offset: reader.f16(9)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monochrome_grain_has_luma_parameters_only() {
        let color = ColorConfig {
            mono_chrome: true,
            num_planes: 1,
            subsampling_x: 1,
            subsampling_y: 1,
            ..ColorConfig::default()
        };
        // one point (16, 32); scaling 1, lag 1; 4 coefficients; shift 0, scale 0, overlap, clip.
        let bits = [
            0b0001_0001,
            0b0000_0010,
            0b0000_0101,
            1,
            2,
            3,
            4,
            0b0000_1100,
        ];
        let mut reader = BitReader::new(&bits, 0);
        let params = FilmGrainParams::parse_new(&mut reader, &color, 7).unwrap();
        assert_eq!(
            params.y_points,
            [ScalingPoint {
                value: 16,
                scaling: 32
            }]
        );
        assert_eq!(params.ar_coeffs_y_plus_128, [1, 2, 3, 4]);
        assert!(params.ar_coeffs_cb_plus_128.is_empty());
        assert!(params.overlap_flag && params.clip_to_restricted_range);
        assert_eq!(reader.position(), 62);
    }

    #[test]
    fn points_must_increase_and_be_few() {
        let mut not_increasing = BitReader::new(&[0x20, 0x50, 0x00, 0x50, 0x00, 0x00], 0);
        assert!(read_points(&mut not_increasing, 14).is_err());
        let mut too_many = BitReader::new(&[0xf0], 0);
        assert!(read_points(&mut too_many, 14).is_err());
    }

    #[test]
    fn an_inter_frame_reuses_all_parameters_but_the_seed() {
        let saved = FilmGrainParams {
            apply_grain: true,
            grain_seed: 99,
            ar_coeff_lag: 3,
            ..FilmGrainParams::default()
        };
        // apply 1, seed 10, update 0, slot 5.
        let bits = [0x80, 0x05, 0x28];
        let parse = |named: u8| {
            let mut reader = BitReader::new(&bits, 0);
            let saved = |slot| (slot == named).then_some(&saved);
            FilmGrainParams::parse(&mut reader, &ColorConfig::default(), true, saved)
        };
        let params = parse(5).unwrap();
        assert_eq!((params.grain_seed, params.ar_coeff_lag), (10, 3));
        assert!(parse(4).is_err());
    }
}
