//! §5.11.12 Quantizer index delta, §5.11.13 Loop filter delta, §5.11.56 CDEF index.

use super::{Block, TileDecoder};
use crate::entropy::cdf::Cdf4;
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::block_size::{BLOCK_64X64, BLOCK_128X128};
use crate::tables::symbols::{DELTA_Q_SMALL, FRAME_LF_COUNT, MAX_LOOP_FILTER};

impl TileDecoder<'_> {
    /// §5.11.12, §5.11.13: whether the block is the first of its superblock that may carry deltas.
    fn carries_deltas(&self, block: &Block) -> bool {
        let is_128 = self.frame.sequence.use_128x128_superblock;
        let superblock = if is_128 { BLOCK_128X128 } else { BLOCK_64X64 };
        self.read_deltas && !(block.size == superblock && block.skip)
    }

    /// §5.11.12 `read_delta_qindex`.
    pub(super) fn read_delta_qindex(&mut self, block: &Block) {
        if !self.carries_deltas(block) {
            return;
        }
        let delta = read_delta(&mut self.symbols, &mut self.cdfs.delta_q);
        if delta != 0 {
            let index = i32::from(self.current_q_index) + (delta << self.frame.header.delta_q_res);
            self.current_q_index = index.clamp(1, 255) as u8;
        }
    }

    /// §5.11.13 `read_delta_lf`.
    pub(super) fn read_delta_lf(&mut self, block: &Block) {
        let header = &self.frame.header;
        if !self.carries_deltas(block) || !header.delta_lf_present {
            return;
        }
        let has_chroma = self.frame.sequence.color.num_planes > 1;
        let count = match (header.delta_lf_multi, has_chroma) {
            (false, _) => 1,
            (true, true) => FRAME_LF_COUNT,
            (true, false) => FRAME_LF_COUNT - 2,
        };
        for i in 0..count {
            let cdf = if header.delta_lf_multi {
                &mut self.cdfs.delta_lf_multi[i]
            } else {
                &mut self.cdfs.delta_lf
            };
            let delta = read_delta(&mut self.symbols, cdf);
            let limit = i32::from(MAX_LOOP_FILTER);
            let value = i32::from(self.delta_lf[i]) + (delta << header.delta_lf_res);
            self.delta_lf[i] = value.clamp(-limit, limit) as i8;
        }
    }

    /// §5.11.56 `read_cdef`: one literal for each 64x64 luma samples, at its first block with residual.
    pub(super) fn read_cdef(&mut self, block: &Block) {
        if block.skip || !self.frame.header.cdef.enabled {
            return;
        }
        let quarter = |mi_row: u32, mi_col: u32| (mi_row >> 4 & 1) * 2 + (mi_col >> 4 & 1);
        if self.cdef_is_read[quarter(block.mi_row, block.mi_col) as usize] {
            return;
        }
        self.symbols.literal(self.frame.header.cdef.bits.into());
        for row in (0..block.height4() as u32).step_by(16) {
            for col in (0..block.width4() as u32).step_by(16) {
                let index = quarter(block.mi_row + row, block.mi_col + col);
                self.cdef_is_read[index as usize] = true;
            }
        }
    }
}

/// §5.11.12, §5.11.13: a signed difference; the escape codes of both are the same.
fn read_delta(symbols: &mut SymbolDecoder, cdf: &mut Cdf4) -> i32 {
    let mut magnitude = symbols.symbol(cdf).into();
    if magnitude == u32::from(DELTA_Q_SMALL) {
        let bits = symbols.literal(3) + 1;
        magnitude = symbols.literal(bits) + (1 << bits) + 1;
    }
    if magnitude != 0 && symbols.bit() {
        -(magnitude as i32)
    } else {
        magnitude as i32
    }
}
