//! §5.11.39 Coefficients, from the levels to the signs; §8.3.2, the contexts of the levels.

use super::{TileError, TileResult};
use crate::entropy::cdf::{Cdf2, Cdf3, Cdf4};
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::scan::{LEVEL_STRIDE, scan};
use crate::tables::symbols::{
    BR_CDF_SIZE, COEFF_BASE_RANGE, NUM_BASE_LEVELS, TX_CLASS_2D, TX_CLASS_HORIZ,
};
use crate::tables::tx_size::{ADJUSTED_TX_SIZE, TX_HEIGHT};

/// Room for 4 + 32 rows; a power of two, so that a mask replaces bounds checks.
const CELLS: usize = 2048;
/// From the furthest neighbour of a coefficient, four rows above and four columns left, to itself.
const REACH: usize = 4 * LEVEL_STRIDE + 4;
/// Above this, a level continues with a Golomb code.
const MAX_CODED_LEVEL: u32 = NUM_BASE_LEVELS + COEFF_BASE_RANGE;

/// Buffers of one transform block.
pub(super) struct CoefficientScratch {
    /// §8.3.2, by position: what the levels read so far add to the contexts of a coefficient. Most
    /// levels are zero, so those that are not are added to their neighbours when they are read, instead
    /// of each coefficient collecting from its own. The sum of levels up to 3, for `coeff_base`, is in
    /// the upper byte, that of levels up to 15, for `coeff_br`, in the lower. Four rows and columns
    /// come before the first.
    neighbors: [u16; CELLS],
    /// Which of the levels that are not zero continue with a Golomb code: how many came before each.
    long: [u16; 1024],
}

impl Default for CoefficientScratch {
    fn default() -> Self {
        Self {
            neighbors: [0; CELLS],
            long: [0; 1024],
        }
    }
}

impl CoefficientScratch {
    /// The cells up to that of a place.
    #[inline]
    fn window(&mut self, at: u16) -> &mut [u16; REACH + 1] {
        let from = usize::from(at) & (CELLS - 1);
        (&mut self.neighbors[from..=from + REACH])
            .try_into()
            .expect("REACH + 1 cells")
    }

    /// Keeps a level that is not zero: the coded symbol, and what `coeff_br` added to it.
    #[inline]
    fn keep<const CLASS: u8>(&mut self, read: &mut Levels, at: u16, symbol: u32, excess: u32) {
        if excess == COEFF_BASE_RANGE {
            self.long[read.long & 1023] = read.coded as u16;
            read.long += 1;
        }
        read.coded += 1;
        read.total += symbol + excess;
        // `symbol` is `min(level, 3)`.
        let far = (symbol << 8) as u16;
        let close = far + (symbol + excess) as u16;
        let window = self.window(at);
        let mut add = |rows: usize, cols: usize, value: u16| {
            window[REACH - rows * LEVEL_STRIDE - cols] += value;
        };
        add(0, 1, close);
        add(1, 0, close);
        match CLASS {
            TX_CLASS_2D => {
                add(1, 1, close);
                add(0, 2, far);
                add(2, 0, far);
            }
            TX_CLASS_HORIZ => {
                add(0, 2, close);
                add(0, 3, far);
                add(0, 4, far);
            }
            _ => {
                add(2, 0, close);
                add(3, 0, far);
                add(4, 0, far);
            }
        }
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

/// What is known of the levels of a transform block before their signs are read.
#[derive(Default)]
pub(super) struct Levels {
    /// How many are not zero.
    coded: u32,
    /// Their sum, Golomb codes not included.
    total: u32,
    /// How many continue with a Golomb code.
    long: usize,
    /// Whether the first coefficient is not zero, which decides how its sign is read.
    has_dc: bool,
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
    scratch.neighbors[..LEVEL_STRIDE * rows].fill(0);
    let mut symbols = *decoder;
    let mut read = Levels::default();
    let (last, before) = scan[..eob].split_last().expect("eob is not 0");
    let mut level = 1 + u32::from(symbols.symbol(&mut cdfs.base_eob[last_context]));
    let mut excess = 0;
    if level > NUM_BASE_LEVELS {
        excess = read_range(
            &mut symbols,
            &mut cdfs.range[usize::from(last.range_context)],
        );
    }
    scratch.keep::<CLASS>(&mut read, last.at, level, excess);
    for place in before.iter().rev() {
        let neighbors = u32::from(scratch.window(place.at)[REACH]);
        let context = if CLASS == TX_CLASS_2D && place.at == 0 {
            0
        } else {
            (((neighbors >> 8) + 1) >> 1).min(4) as usize + usize::from(place.base_context)
        };
        level = u32::from(symbols.symbol(&mut cdfs.base[context]));
        if level == 0 {
            continue;
        }
        let mut excess = 0;
        if level > NUM_BASE_LEVELS {
            let magnitude = (((neighbors & 255) + 1) >> 1).min(6) as usize;
            let cdf = &mut cdfs.range[magnitude + usize::from(place.range_context)];
            excess = read_range(&mut symbols, cdf);
        }
        scratch.keep::<CLASS>(&mut read, place.at, level, excess);
    }
    read.has_dc = level > 0;
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
    let mut left = read.coded;
    if read.has_dc {
        let sign = symbols.digit(dc_sign);
        sums.dc_category = 2 - sign as u8;
        sums.negative = sign.into();
        left -= 1;
    }
    for &before in scratch.long[..read.long].iter().rev() {
        sums.negative += u64::from(symbols.ones(left - u32::from(before)));
        left = before.into();
        let level = (read_golomb(&mut symbols)? + MAX_CODED_LEVEL) & 0xF_FFFF;
        sums.total = sums.total - u64::from(MAX_CODED_LEVEL + 1) + u64::from(level);
        if level == 0 && read.has_dc && left + 1 == read.coded {
            sums.dc_category = 0;
        }
    }
    sums.negative += u64::from(symbols.ones(left));
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
