//! §5.9.11: deblocking. Only the deltas matter here: they are carried from frame to frame.

use crate::bits::BitReader;
use crate::error::Result;

/// What slots save of the loop filter (§7.20 `save_loop_filter_params`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LoopFilterDeltas {
    /// `loop_filter_ref_deltas`, by reference name, `INTRA_FRAME` first.
    pub(crate) ref_deltas: [i8; 8],
    /// `loop_filter_mode_deltas`.
    pub(crate) mode_deltas: [i8; 2],
}

impl Default for LoopFilterDeltas {
    /// §6.8.2 `setup_past_independence`.
    fn default() -> Self {
        Self {
            ref_deltas: [1, 0, 0, 0, -1, 0, -1, -1],
            mode_deltas: [0, 0],
        }
    }
}

/// §5.9.11 `loop_filter_params`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct LoopFilterParams {
    /// `loop_filter_level`: vertical luma, horizontal luma, U, V.
    pub(crate) level: [u8; 4],
    pub(crate) sharpness: u8,
    pub(crate) delta_enabled: bool,
    pub(crate) delta_update: bool,
    pub(crate) ref_deltas: [i8; 8],
    pub(crate) mode_deltas: [i8; 2],
}

impl Default for LoopFilterParams {
    fn default() -> Self {
        Self::with_deltas(LoopFilterDeltas::default())
    }
}

impl LoopFilterParams {
    fn with_deltas(deltas: LoopFilterDeltas) -> Self {
        Self {
            level: [0; 4],
            sharpness: 0,
            delta_enabled: true,
            delta_update: false,
            ref_deltas: deltas.ref_deltas,
            mode_deltas: deltas.mode_deltas,
        }
    }

    /// Reads `loop_filter_params` of a frame that is neither lossless nor uses intra block copy;
    /// those have the default. `previous` are the deltas of the primary reference frame.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        num_planes: u8,
        previous: LoopFilterDeltas,
    ) -> Result<Self> {
        let mut params = Self::with_deltas(previous);
        params.level[0] = reader.f8(6)?;
        params.level[1] = reader.f8(6)?;
        if num_planes > 1 && (params.level[0] > 0 || params.level[1] > 0) {
            params.level[2] = reader.f8(6)?;
            params.level[3] = reader.f8(6)?;
        }
        params.sharpness = reader.f8(3)?;
        params.delta_enabled = reader.flag()?;
        params.delta_update = params.delta_enabled && reader.flag()?;
        if params.delta_update {
            for delta in params.ref_deltas.iter_mut().chain(&mut params.mode_deltas) {
                let update_delta = reader.flag()?;
                if update_delta {
                    *delta = reader.su7()?;
                }
            }
        }
        Ok(params)
    }

    /// What §7.20 saves.
    pub(crate) fn deltas(&self) -> LoopFilterDeltas {
        LoopFilterDeltas {
            ref_deltas: self.ref_deltas,
            mode_deltas: self.mode_deltas,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_deltas_favour_intra_and_penalise_distant_references() {
        let deltas = LoopFilterDeltas::default().ref_deltas;
        // INTRA, LAST, LAST2, LAST3, GOLDEN, BWDREF, ALTREF2, ALTREF.
        assert_eq!(deltas, [1, 0, 0, 0, -1, 0, -1, -1]);
    }

    #[test]
    fn deltas_that_are_not_updated_keep_the_previous_value() {
        let previous = LoopFilterDeltas {
            ref_deltas: [5; 8],
            mode_deltas: [6; 2],
        };
        // levels 0 and 0, sharpness 0, enabled 1, update 1, first reference -64, rest kept.
        let bits = [0, 0b0000_0001, 0b1110_0000, 0, 0];
        let mut reader = BitReader::new(&bits, 0);
        let params = LoopFilterParams::parse(&mut reader, 3, previous).unwrap();
        assert_eq!(params.ref_deltas, [-64, 5, 5, 5, 5, 5, 5, 5]);
        assert_eq!(params.mode_deltas, [6, 6]);
        assert_eq!(reader.position(), 17 + 8 + 9);
    }
}
