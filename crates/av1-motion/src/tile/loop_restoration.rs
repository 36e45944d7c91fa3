//! §5.11.57 Read loop restoration, §5.11.58 Read loop restoration unit: read and dropped.

use super::TileDecoder;
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::arithmetic::{
    SGRPROJ_XQD_MAX, SGRPROJ_XQD_MID, SGRPROJ_XQD_MIN, WIENER_TAPS_K, WIENER_TAPS_MAX,
    WIENER_TAPS_MID, WIENER_TAPS_MIN,
};
use crate::tables::block_size::NUM_4X4_BLOCKS_WIDE;
use crate::tables::symbols::{
    RESTORE_NONE, RESTORE_SGRPROJ, RESTORE_WIENER, SGRPROJ_PARAMS_BITS, SGRPROJ_PRJ_BITS,
    SGRPROJ_PRJ_SUBEXP_K, SUPERRES_NUM,
};

/// The coefficients that the next unit is coded relative to.
pub(super) struct RestorationReferences {
    /// `RefLrWiener`.
    wiener: [[[i32; 3]; 2]; 3],
    /// `RefSgrXqd`.
    sgr: [[i32; 2]; 3],
}

impl RestorationReferences {
    /// §5.11.2: the values at the start of a tile.
    pub(super) fn new() -> Self {
        Self {
            wiener: [[WIENER_TAPS_MID; 2]; 3],
            sgr: [SGRPROJ_XQD_MID; 3],
        }
    }
}

impl TileDecoder<'_> {
    /// §5.11.57 `read_lr`, for the superblock at (`r`, `c`).
    pub(super) fn read_lr(&mut self, r: u32, c: u32, size: u8) {
        let header = &self.frame.header;
        if header.allow_intrabc || !header.loop_restoration.uses_lr {
            return;
        }
        let color = &self.frame.sequence.color;
        let step = u64::from(NUM_4X4_BLOCKS_WIDE[size as usize]);
        for plane in 0..color.num_planes as usize {
            let kind = header.loop_restoration.frame_restoration_type[plane];
            if kind == RESTORE_NONE {
                continue;
            }
            let (x, y) = if plane > 0 {
                (color.subsampling_x, color.subsampling_y)
            } else {
                (0, 0)
            };
            let unit_size = u64::from(header.loop_restoration.loop_restoration_size[plane]);
            let units = |samples: u32, shift: u8| {
                let samples = (u64::from(samples) + (1 << shift >> 1)) >> shift;
                ((samples + (unit_size >> 1)) / unit_size).max(1)
            };
            let (numerator, denominator) = if header.size.use_superres {
                let denominator = u64::from(header.size.superres_denom);
                ((4 >> x) * denominator, unit_size * u64::from(SUPERRES_NUM))
            } else {
                (4 >> x, unit_size)
            };
            let row = |mi: u64| (mi * (4 >> y)).div_ceil(unit_size);
            let col = |mi: u64| (mi * numerator).div_ceil(denominator);
            let (r, c) = (u64::from(r), u64::from(c));
            let rows = row(r)..units(header.size.frame_height, y).min(row(r + step));
            let cols = col(c)..units(header.size.upscaled_width, x).min(col(c + step));
            for _ in rows {
                for _ in cols.clone() {
                    self.read_lr_unit(plane, kind);
                }
            }
        }
    }

    /// §5.11.58 `read_lr_unit`.
    fn read_lr_unit(&mut self, plane: usize, frame_type: u8) {
        let symbols = &mut self.symbols;
        let unit_type = match frame_type {
            RESTORE_WIENER if symbols.flag(&mut self.cdfs.use_wiener) => RESTORE_WIENER,
            RESTORE_SGRPROJ if symbols.flag(&mut self.cdfs.use_sgrproj) => RESTORE_SGRPROJ,
            RESTORE_WIENER | RESTORE_SGRPROJ => RESTORE_NONE,
            _ => symbols.symbol(&mut self.cdfs.restoration_type),
        };
        if unit_type == RESTORE_WIENER {
            for taps in &mut self.restoration.wiener[plane] {
                for j in usize::from(plane > 0)..3 {
                    let (low, high) = (WIENER_TAPS_MIN[j], WIENER_TAPS_MAX[j] + 1);
                    taps[j] = signed_subexp(symbols, low, high, WIENER_TAPS_K[j] as u32, taps[j]);
                }
            }
        } else if unit_type == RESTORE_SGRPROJ {
            let set = symbols.literal(SGRPROJ_PARAMS_BITS);
            // §7.17.3 Sgr_Params: the first radius of sets 10 to 13 and the second of 14 and 15 are 0.
            let radius_is_zero = [(10..=13).contains(&set), set >= 14];
            let weights = &mut self.restoration.sgr[plane];
            for i in 0..2 {
                let (low, high) = (SGRPROJ_XQD_MIN[i], SGRPROJ_XQD_MAX[i]);
                weights[i] = if !radius_is_zero[i] {
                    signed_subexp(symbols, low, high + 1, SGRPROJ_PRJ_SUBEXP_K, weights[i])
                } else if i == 1 {
                    ((1 << SGRPROJ_PRJ_BITS) - weights[0]).clamp(low, high)
                } else {
                    0
                };
            }
        }
    }
}

/// §5.11.58 `decode_signed_subexp_with_ref_bool`.
fn signed_subexp(symbols: &mut SymbolDecoder, low: i32, high: i32, k: u32, r: i32) -> i32 {
    let (max, r) = (high - low, r - low);
    let v = subexp(symbols, max as u32, k) as i32;
    let x = if r << 1 <= max {
        inverse_recenter(r, v)
    } else {
        max - 1 - inverse_recenter(max - 1 - r, v)
    };
    x + low
}

/// §5.11.58 `decode_subexp_bool`.
fn subexp(symbols: &mut SymbolDecoder, num_symbols: u32, k: u32) -> u32 {
    let (mut i, mut mk) = (0, 0);
    loop {
        let bits = if i > 0 { k + i - 1 } else { k };
        let a = 1 << bits;
        if num_symbols <= mk + 3 * a {
            return symbols.non_symmetric(num_symbols - mk) + mk;
        }
        if !symbols.bit() {
            return symbols.literal(bits) + mk;
        }
        i += 1;
        mk += a;
    }
}

/// §5.9.29 `inverse_recenter`.
fn inverse_recenter(r: i32, v: i32) -> i32 {
    if v > 2 * r {
        v
    } else if v & 1 == 1 {
        r - ((v + 1) >> 1)
    } else {
        r + (v >> 1)
    }
}
