//! §5.9.19: the constrained directional enhancement filter. `enabled` and `bits` decide which
//! symbols tiles carry.

use crate::bits::BitReader;
use crate::error::Result;

/// §5.9.19 `cdef_params`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CdefParams {
    /// Whether tiles carry `cdef_idx` (§5.11.56): the filter is not excluded by the sequence,
    /// lossless coding or intra block copy.
    pub(crate) enabled: bool,
    /// `CdefDamping`, 3 to 6.
    pub(crate) damping: u8,
    /// `cdef_bits`, 0 to 3: length of `cdef_idx`.
    pub(crate) bits: u8,
    /// Strengths; the first `1 << bits` are used. Secondary ones are 0, 1, 2 or 4.
    pub(crate) y_pri_strength: [u8; 8],
    pub(crate) y_sec_strength: [u8; 8],
    pub(crate) uv_pri_strength: [u8; 8],
    pub(crate) uv_sec_strength: [u8; 8],
}

impl Default for CdefParams {
    fn default() -> Self {
        Self {
            enabled: false,
            damping: 3,
            bits: 0,
            y_pri_strength: [0; 8],
            y_sec_strength: [0; 8],
            uv_pri_strength: [0; 8],
            uv_sec_strength: [0; 8],
        }
    }
}

impl CdefParams {
    /// Reads `cdef_params` of a frame that does not exclude the filter.
    pub(crate) fn parse(reader: &mut BitReader<'_>, num_planes: u8) -> Result<Self> {
        let mut params = Self {
            enabled: true,
            damping: reader.f8(2)? + 3,
            bits: reader.f8(2)?,
            ..Self::default()
        };
        for index in 0..1 << params.bits {
            params.y_pri_strength[index] = reader.f8(4)?;
            params.y_sec_strength[index] = read_secondary(reader)?;
            if num_planes > 1 {
                params.uv_pri_strength[index] = reader.f8(4)?;
                params.uv_sec_strength[index] = read_secondary(reader)?;
            }
        }
        Ok(params)
    }
}

/// Secondary strength: the coded 3 means 4.
fn read_secondary(reader: &mut BitReader<'_>) -> Result<u8> {
    Ok(match reader.f8(2)? {
        3 => 4,
        strength => strength,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_strengths_is_a_power_of_two() {
        // damping 1, bits 1, then two pairs for luma only.
        let mut reader = BitReader::new(&[0b0101_1010, 0b1100_0101, 0], 0);
        let params = CdefParams::parse(&mut reader, 1).unwrap();
        assert_eq!((params.damping, params.bits), (4, 1));
        assert_eq!(params.y_pri_strength[..2], [10, 1]);
        assert_eq!(params.y_sec_strength[..2], [4, 1]);
        assert_eq!(reader.position(), 16);
    }
}
