//! §5.11.39 Coefficients, from the levels to the signs; §8.3.2, the contexts of the levels.

use super::{TileError, TileResult};
use crate::entropy::cdf::{Cdf2, Cdf3, Cdf4};
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::scan::{LEVEL_STRIDE, scan};
use crate::tables::symbols::{
    BR_CDF_SIZE, COEFF_BASE_RANGE, NUM_BASE_LEVELS, TX_CLASS_2D, TX_CLASS_HORIZ,
};
use crate::tables::tx_size::{ADJUSTED_TX_SIZE, TX_HEIGHT};

/// Room for 32 + 4 rows; a power of two, so that a mask replaces bounds checks.
const LEVELS: usize = 4096;
/// Levels from a coefficient to behind the furthest of its neighbours, four rows below.
const REACH: usize = 4 * LEVEL_STRIDE + 1;
/// Above this, a level continues with a Golomb code.
const MAX_CODED_LEVEL: u32 = NUM_BASE_LEVELS + COEFF_BASE_RANGE;

/// Buffers of one transform block.
pub(super) struct CoefficientScratch {
    /// Levels by position: `min(level, 3)` in the two upper bits, `level` (at most 15) below, so that
    /// one sum over neighbours serves both kinds of context.
    levels: [u8; LEVELS],
    /// Which of the levels that are not zero continue with a Golomb code: how many came before each.
    long: [u16; 1024],
}

impl Default for CoefficientScratch {
    fn default() -> Self {
        Self {
            levels: [0; LEVELS],
            long: [0; 1024],
        }
    }
}

impl CoefficientScratch {
    /// Keeps a level that is not zero: the coded symbol, and what `coeff_br` added to it.
    #[inline]
    fn keep(&mut self, read: &mut Levels, at: u16, symbol: u32, excess: u32) {
        // `symbol` is `min(level, 3)`.
        self.levels[usize::from(at) & (LEVELS - 1)] = (65 * symbol + excess) as u8;
        if excess == COEFF_BASE_RANGE {
            self.long[read.long & 1023] = read.coded as u16;
            read.long += 1;
        }
        read.coded += 1;
        read.total += symbol + excess;
    }
}

/// What the levels of a transform block add up to.
#[derive(Default)]
pub(super) struct LevelSums {
    pub(super) total: u64,
    pub(super) negative: u64,
    /// 0 zero, 1 negative, 2 positive.
    pub(super) dc_category: u8,
}

/// §8.3.2: the distributions of the levels of one transform block.
pub(super) struct LevelCdfs<'a> {
    pub(super) base_eob: &'a mut [Cdf3; 4],
    pub(super) base: &'a mut [Cdf4; 42],
    pub(super) range: &'a mut [Cdf4; 21],
}

/// §8.3.2: what the levels already read around a coefficient say about it.
struct Neighbors {
    /// Sum of levels up to 3, for `coeff_base`.
    base: u32,
    /// Sum of levels up to 15, for `coeff_br`.
    range: u32,
}

impl Neighbors {
    #[inline]
    fn of<const CLASS: u8>(levels: &[u8; LEVELS], at: u16) -> Self {
        let from = usize::from(at) & (LEVELS / 2 - 1);
        let window: &[u8; REACH] = levels[from..from + REACH].try_into().expect("REACH levels");
        let near = |rows: usize, cols: usize| u32::from(window[rows * LEVEL_STRIDE + cols]);
        let close = near(0, 1)
            + near(1, 0)
            + match CLASS {
                TX_CLASS_2D => near(1, 1),
                TX_CLASS_HORIZ => near(0, 2),
                _ => near(2, 0),
            };
        let far = match CLASS {
            TX_CLASS_2D => near(0, 2) + near(2, 0),
            TX_CLASS_HORIZ => near(0, 3) + near(0, 4),
            _ => near(3, 0) + near(4, 0),
        };
        Self {
            base: (close >> 6) + (far >> 6),
            range: close & 63,
        }
    }
}

/// What is known of the levels of a transform block before their signs are read.
#[derive(Default)]
pub(super) struct Levels {
    /// How many are not zero.
    coded: usize,
    /// Their sum, Golomb codes not included.
    total: u32,
    /// How many continue with a Golomb code.
    long: usize,
}

/// §5.11.39: the levels, from the last coefficient to the first.
pub(super) fn read_levels<const CLASS: u8>(
    decoder: &mut SymbolDecoder,
    cdfs: &mut LevelCdfs,
    scratch: &mut CoefficientScratch,
    tx_size: u8,
    eob: usize,
) -> Levels {
    let scan = scan(tx_size, CLASS);
    let last_context = eob_context(eob - 1, scan.len());
    // The first `eob` places reach no further down.
    let rows = 4 + eob.min(TX_HEIGHT[ADJUSTED_TX_SIZE[tx_size as usize] as usize].into());
    scratch.levels[..LEVEL_STRIDE * rows].fill(0);
    let mut symbols = *decoder;
    let mut read = Levels::default();
    let (last, before) = scan[..eob].split_last().expect("eob is not 0");
    let level = 1 + u32::from(symbols.symbol(&mut cdfs.base_eob[last_context]));
    let mut excess = 0;
    if level > NUM_BASE_LEVELS {
        excess = read_range(
            &mut symbols,
            &mut cdfs.range[usize::from(last.range_context)],
        );
    }
    scratch.keep(&mut read, last.at, level, excess);
    for place in before.iter().rev() {
        let neighbors = Neighbors::of::<CLASS>(&scratch.levels, place.at);
        let context = if CLASS == TX_CLASS_2D && place.at == 0 {
            0
        } else {
            ((neighbors.base + 1) >> 1).min(4) as usize + usize::from(place.base_context)
        };
        let level = u32::from(symbols.symbol(&mut cdfs.base[context]));
        if level == 0 {
            continue;
        }
        let mut excess = 0;
        if level > NUM_BASE_LEVELS {
            let magnitude = ((neighbors.range + 1) >> 1).min(6) as usize;
            let cdf = &mut cdfs.range[magnitude + usize::from(place.range_context)];
            excess = read_range(&mut symbols, cdf);
        }
        scratch.keep(&mut read, place.at, level, excess);
    }
    *decoder = symbols;
    read
}

/// §5.11.39 `coeff_br`, up to four times.
#[inline]
fn read_range(symbols: &mut SymbolDecoder, cdf: &mut Cdf4) -> u32 {
    const MAX_STEP: u32 = BR_CDF_SIZE as u32 - 1;
    let mut level = 0;
    for _ in 0..COEFF_BASE_RANGE / MAX_STEP {
        let step = u32::from(symbols.symbol(cdf));
        level += step;
        if step < MAX_STEP {
            break;
        }
    }
    level
}

/// §8.3.2: the context of `coeff_base_eob`.
fn eob_context(c: usize, area: usize) -> usize {
    match c {
        0 => 0,
        c if c <= area / 8 => 1,
        c if c <= area / 4 => 2,
        _ => 3,
    }
}

/// §5.11.39: signs and Golomb codes, from the first coefficient to the last.
pub(super) fn read_signs(
    decoder: &mut SymbolDecoder,
    dc_sign: &mut Cdf2,
    scratch: &CoefficientScratch,
    read: &Levels,
) -> TileResult<LevelSums> {
    let mut symbols = *decoder;
    let mut sums = LevelSums {
        total: read.total.into(),
        ..LevelSums::default()
    };
    // Whether the first coefficient is not zero decides how its sign is read.
    let has_dc = scratch.levels[0] != 0;
    let mut left = read.coded;
    if has_dc {
        let is_negative = symbols.flag(dc_sign);
        sums.dc_category = if is_negative { 1 } else { 2 };
        sums.negative = is_negative.into();
        left -= 1;
    }
    for &before in scratch.long[..read.long].iter().rev() {
        while left > usize::from(before) {
            sums.negative += u64::from(symbols.bit());
            left -= 1;
        }
        let level = (read_golomb(&mut symbols)? + MAX_CODED_LEVEL) & 0xF_FFFF;
        sums.total = sums.total - u64::from(MAX_CODED_LEVEL + 1) + u64::from(level);
        if level == 0 && has_dc && left + 1 == read.coded {
            sums.dc_category = 0;
        }
    }
    for _ in 0..left {
        sums.negative += u64::from(symbols.bit());
    }
    *decoder = symbols;
    Ok(sums)
}

/// §5.11.39: `x` of the Golomb code.
fn read_golomb(symbols: &mut SymbolDecoder) -> TileResult<u32> {
    let mut length = 1;
    while !symbols.bit() {
        length += 1;
        if length > 20 {
            let reason = "a coefficient is larger than AV1 allows";
            return Err(TileError {
                section: "6.10.37",
                reason,
            });
        }
    }
    Ok((1..length).fold(1, |x, _| x << 1 | u32::from(symbols.bit())))
}
