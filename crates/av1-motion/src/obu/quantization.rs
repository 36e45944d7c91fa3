//! §5.9.12, §5.9.13: quantizer indices of a frame.

use crate::bits::BitReader;
use crate::error::Result;

use super::color_config::ColorConfig;

/// §5.9.12 `quantization_params`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct QuantizationParams {
    pub(crate) base_q_idx: u8,
    /// `DeltaQYDc` and so on, -64 to 63.
    pub(crate) delta_q_y_dc: i8,
    pub(crate) delta_q_u_dc: i8,
    pub(crate) delta_q_u_ac: i8,
    pub(crate) delta_q_v_dc: i8,
    pub(crate) delta_q_v_ac: i8,
    pub(crate) using_qmatrix: bool,
    /// Levels 0 to 15; 0 without `using_qmatrix`.
    pub(crate) qm_y: u8,
    pub(crate) qm_u: u8,
    pub(crate) qm_v: u8,
}

impl QuantizationParams {
    /// Reads `quantization_params`.
    pub(crate) fn parse(reader: &mut BitReader<'_>, color: &ColorConfig) -> Result<Self> {
        let mut params = Self {
            base_q_idx: reader.f8(8)?,
            delta_q_y_dc: read_delta_q(reader)?,
            ..Self::default()
        };
        if color.num_planes > 1 {
            let diff_uv_delta = color.separate_uv_delta_q && reader.flag()?;
            params.delta_q_u_dc = read_delta_q(reader)?;
            params.delta_q_u_ac = read_delta_q(reader)?;
            if diff_uv_delta {
                params.delta_q_v_dc = read_delta_q(reader)?;
                params.delta_q_v_ac = read_delta_q(reader)?;
            } else {
                params.delta_q_v_dc = params.delta_q_u_dc;
                params.delta_q_v_ac = params.delta_q_u_ac;
            }
        }
        params.using_qmatrix = reader.flag()?;
        if params.using_qmatrix {
            params.qm_y = reader.f8(4)?;
            params.qm_u = reader.f8(4)?;
            params.qm_v = if color.separate_uv_delta_q {
                reader.f8(4)?
            } else {
                params.qm_u
            };
        }
        Ok(params)
    }

    /// Whether all five offsets are 0, as lossless coding needs.
    pub(crate) fn has_no_deltas(&self) -> bool {
        self.delta_q_y_dc == 0
            && self.delta_q_u_dc == 0
            && self.delta_q_u_ac == 0
            && self.delta_q_v_dc == 0
            && self.delta_q_v_ac == 0
    }
}

/// §5.9.13 `read_delta_q`.
fn read_delta_q(reader: &mut BitReader<'_>) -> Result<i8> {
    let delta_coded = reader.flag()?;
    if delta_coded { reader.su7() } else { Ok(0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn color(num_planes: u8, separate_uv_delta_q: bool) -> ColorConfig {
        ColorConfig {
            num_planes,
            separate_uv_delta_q,
            ..ColorConfig::default()
        }
    }

    #[test]
    fn v_follows_u_unless_coded_apart() {
        // base 10, y 0, u dc coded -1 (1111111), u ac 0, no qmatrix.
        let bits = [10, 0b0111_1111, 0b1000_0000];
        let mut reader = BitReader::new(&bits, 0);
        let params = QuantizationParams::parse(&mut reader, &color(3, false)).unwrap();
        assert_eq!((params.delta_q_u_dc, params.delta_q_v_dc), (-1, -1));
        assert!(!params.has_no_deltas());
        assert_eq!(reader.position(), 19);
    }

    #[test]
    fn monochrome_has_no_chroma_offsets() {
        let mut reader = BitReader::new(&[0, 0], 0);
        let params = QuantizationParams::parse(&mut reader, &color(1, false)).unwrap();
        assert!(params.has_no_deltas());
        assert_eq!(reader.position(), 10);
    }
}
