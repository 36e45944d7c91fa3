//! §5.9.17, §5.9.18: whether superblocks change quantizer and loop filter.

use crate::bits::BitReader;
use crate::error::Result;

/// §5.9.17 `delta_q_params`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct DeltaQParams {
    pub(crate) present: bool,
    /// Left shift of decoded values.
    pub(crate) res: u8,
}

impl DeltaQParams {
    /// Reads `delta_q_params`.
    pub(crate) fn parse(reader: &mut BitReader<'_>, base_q_idx: u8) -> Result<Self> {
        let present = base_q_idx > 0 && reader.flag()?;
        let res = if present { reader.f8(2)? } else { 0 };
        Ok(Self { present, res })
    }
}

/// §5.9.18 `delta_lf_params`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct DeltaLfParams {
    pub(crate) present: bool,
    /// Left shift of decoded values.
    pub(crate) res: u8,
    /// Four deltas (edges and planes) instead of one.
    pub(crate) multi: bool,
}

impl DeltaLfParams {
    /// Reads `delta_lf_params`.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        delta_q_present: bool,
        allow_intrabc: bool,
    ) -> Result<Self> {
        let present = delta_q_present && !allow_intrabc && reader.flag()?;
        if !present {
            return Ok(Self::default());
        }
        Ok(Self {
            present,
            res: reader.f8(2)?,
            multi: reader.flag()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_base_index_of_zero_carries_no_deltas() {
        let mut reader = BitReader::new(&[0xff], 0);
        let delta_q = DeltaQParams::parse(&mut reader, 0).unwrap();
        let delta_lf = DeltaLfParams::parse(&mut reader, delta_q.present, false).unwrap();
        assert_eq!(delta_lf, DeltaLfParams::default());
        assert_eq!(reader.position(), 0);
    }

    #[test]
    fn intra_block_copy_excludes_loop_filter_deltas() {
        let mut reader = BitReader::new(&[0b1101_0110], 0);
        assert_eq!(DeltaQParams::parse(&mut reader, 1).unwrap().res, 2);
        let none = DeltaLfParams::parse(&mut reader, true, true).unwrap();
        assert!(!none.present);
        let some = DeltaLfParams::parse(&mut reader, true, false).unwrap();
        assert_eq!((some.present, some.res, some.multi), (true, 1, true));
    }
}
