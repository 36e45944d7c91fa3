//! §8.2 Parsing process for symbol decoder.
//!
//! The window keeps `SymbolValue` in its 16 most significant bits and, below them, stream bits that are
//! already inverted, so that renormalisation is a shift. Reads never fail: past the end the
//! specification pads with zero bits, and [`SymbolDecoder::finish`] says once whether the tile was
//! longer than its data.
#![allow(
    clippy::inline_always,
    reason = "the innermost loop of the parser; measured in NOTES.md"
)]

mod even_odds;

use std::hint::select_unpredictable;

use super::cdf::{Cdf, Cdf2};
use crate::tables::symbols::{EC_MIN_PROB, EC_PROB_SHIFT};
use crate::trace::SymbolCounter;

/// §8.2.2: the arithmetic decoder over the bytes of one tile. A loop that reads many symbols works on
/// a copy, which stays in registers, and puts it back.
#[derive(Clone, Copy)]
pub(crate) struct SymbolDecoder<'a> {
    data: &'a [u8],
    /// Next byte to load; runs past the end when padding is read.
    position: usize,
    /// `SymbolValue` in the upper 16 bits, upcoming bits (inverted) below.
    window: u64,
    /// Upcoming bits that the window holds.
    count: i32,
    /// `SymbolRange`.
    range: u32,
    /// Whether probabilities adapt (`disable_cdf_update` is 0).
    adapts: bool,
    pub(crate) counter: SymbolCounter,
}

impl<'a> SymbolDecoder<'a> {
    /// §8.2.2 `init_symbol`.
    pub(crate) fn new(data: &'a [u8], adapts: bool) -> Self {
        let count = -15;
        let (window, bytes) = refill(data, 0, count);
        Self {
            data,
            position: bytes as usize,
            window,
            count: count + 8 * bytes,
            range: 1 << 15,
            adapts,
            counter: SymbolCounter::default(),
        }
    }

    /// `SymbolValue`.
    #[inline(always)]
    fn value(&self) -> u32 {
        (self.window >> 48) as u32
    }

    /// §8.2.6: narrows the interval to `current..previous`, then renormalisation steps 1 to 7.
    #[inline(always)]
    fn take(&mut self, current: u32, previous: u32) {
        let (window, range) = (self.window - (u64::from(current) << 48), previous - current);
        // `15 - ilog2(range)`; the range is never 0 and has 16 bits.
        let bits = ((range | 1).ilog2() ^ 15) as i32;
        self.range = range << bits;
        self.window = window << bits;
        self.count -= bits;
        if self.count < 0 {
            let (loaded, bytes) = refill(self.data, self.position, self.count);
            self.window |= loaded;
            self.position += bytes as usize;
            self.count += 8 * bytes;
        }
    }

    /// §8.2.6: reads a symbol of `N` values and adapts its distribution.
    #[inline(always)]
    pub(crate) fn symbol<const N: usize, const W: usize>(&mut self, cdf: &mut Cdf<N, W>) -> u8 {
        self.counter.symbol(N);
        if W > 1 {
            let symbol = self.symbol_of_many(cdf);
            self.adapt(cdf, symbol);
            return symbol as u8;
        }
        // Most symbols are levels of coefficients, and most levels are 0: what follows from that
        // need not wait for the arithmetic. NOTES.md has the alternatives.
        let lanes = cdf.0[0];
        let first = bound(self.range >> 8, lanes as u16, N - 1);
        if self.value() >= first {
            self.take(first, self.range);
            self.adapt(cdf, 0);
            return 0;
        }
        let symbol = self.symbol_of_four::<N>(lanes, first);
        self.adapt(cdf, symbol);
        symbol as u8
    }

    /// §8.2.6 for up to four values, of which it is not the first, without a branch that depends on
    /// the symbol.
    #[inline(always)]
    fn symbol_of_four<const N: usize>(&mut self, lanes: u64, first: u32) -> u32 {
        let (value, scale) = (self.value(), self.range >> 8);
        let lower = |index: usize| {
            let inverse = (lanes >> (16 * index)) as u16;
            if index < N - 1 {
                bound(scale, inverse, N - 1 - index)
            } else {
                0
            }
        };
        let (second, third) = (lower(1), lower(2));
        let choose = select_unpredictable::<u32>;
        let mut symbol = 1 + u32::from(value < second);
        let mut previous = choose(value < second, second, first);
        let mut current = choose(value < second, third, second);
        if N == 4 {
            symbol += u32::from(value < third);
            previous = choose(value < third, third, previous);
            current = choose(value < third, 0, current);
        }
        self.take(current, previous);
        symbol
    }

    /// §8.2.6 for more values, one after the other.
    #[inline(always)]
    fn symbol_of_many<const N: usize, const W: usize>(&mut self, cdf: &Cdf<N, W>) -> u32 {
        let (value, scale) = (self.value(), self.range >> 8);
        let mut previous = self.range;
        let mut symbol = 0;
        let mut current = bound(scale, cdf.inverse(0), N - 1);
        while value < current {
            symbol += 1;
            previous = current;
            current = bound(scale, cdf.inverse(symbol), N - 1 - symbol);
        }
        self.take(current, previous);
        symbol as u32
    }

    /// §8.2.6 for two values.
    #[inline(always)]
    pub(crate) fn flag(&mut self, cdf: &mut Cdf2) -> bool {
        let bit = self.split(cdf.0[0] as u16);
        self.adapt(cdf, bit.into());
        bit
    }

    /// The same for a value that nothing is decided by, without a branch that depends on it.
    #[inline(always)]
    pub(crate) fn digit(&mut self, cdf: &mut Cdf2) -> u32 {
        self.counter.symbol(2);
        let lower = bound(self.range >> 8, cdf.0[0] as u16, 1);
        let bit = self.value() < lower;
        let choose = select_unpredictable::<u32>;
        self.take(choose(bit, 0, lower), choose(bit, lower, self.range));
        self.adapt(cdf, bit.into());
        bit.into()
    }

    #[inline(always)]
    fn adapt<const N: usize, const W: usize>(&self, cdf: &mut Cdf<N, W>, symbol: u32) {
        if self.adapts {
            adapt(cdf, symbol);
        }
    }

    /// §8.3.2: a flag whose (inverse) probability is derived and does not adapt.
    #[inline(always)]
    pub(crate) fn split(&mut self, probability: u16) -> bool {
        self.counter.symbol(2);
        let bound = bound(self.range >> 8, probability, 1);
        let bit = self.value() < bound;
        if bit {
            self.take(0, bound);
        } else {
            self.take(bound, self.range);
        }
        bit
    }

    /// §8.2.3 `read_bool`.
    #[inline(always)]
    pub(crate) fn bit(&mut self) -> bool {
        self.counter.symbol(2);
        // `bound( )` of one half.
        let half = (self.range >> 8 << 7) + EC_MIN_PROB;
        let bit = self.value() < half;
        let choose = select_unpredictable::<u32>;
        self.take(choose(bit, 0, half), choose(bit, half, self.range));
        bit
    }

    /// §8.2.5 `read_literal`.
    #[inline]
    pub(crate) fn literal(&mut self, bits: u32) -> u32 {
        (0..bits).fold(0, |value, _| (value << 1) | u32::from(self.bit()))
    }

    /// §4.10.10 `NS(n)`, for `n` > 0.
    pub(crate) fn non_symmetric(&mut self, n: u32) -> u32 {
        let width = n.ilog2() + 1;
        let shorter = (1 << width) - n;
        let value = self.literal(width - 1);
        if value < shorter {
            return value;
        }
        (value << 1) - shorter + self.literal(1)
    }

    /// `SymbolMaxBits`: unread bits; negative when padding was consumed.
    fn max_bits(&self) -> i64 {
        8 * self.data.len() as i64 - 8 * self.position as i64 + i64::from(self.count)
    }

    /// Whether more padding was consumed than §8.2.4 allows.
    pub(crate) fn is_overrun(&self) -> bool {
        self.max_bits() < -14
    }

    /// §8.2.4 `exit_symbol`: what is wrong with the length or the padding of the data, if anything.
    pub(crate) fn finish(&self) -> Result<(), &'static str> {
        if self.is_overrun() {
            return Err("a tile needs more bits than it has");
        }
        let trailing = (8 * self.data.len() as i64 - self.max_bits() - 15).max(0) as usize;
        let Some(&byte) = self.data.get(trailing / 8) else {
            return Err("a tile ends without its trailing bit");
        };
        let is_padded = byte << (trailing % 8) == 0x80
            && self.data[trailing / 8 + 1..].iter().all(|&byte| byte == 0);
        if is_padded {
            Ok(())
        } else {
            Err("the trailing bits of a tile are not 1 0 … 0")
        }
    }
}

/// §8.2.6: the lower bound `cur` of a symbol's interval; `remaining` symbols follow it.
#[inline(always)]
fn bound(scale: u32, inverse: u16, remaining: usize) -> u32 {
    ((scale * u32::from(inverse >> EC_PROB_SHIFT)) >> (7 - EC_PROB_SHIFT))
        + EC_MIN_PROB * remaining as u32
}

/// §8.2.6: moves the distribution towards `symbol`, four lanes at a time: no lane exceeds 32768, so
/// that none borrows from or carries into the next.
#[inline(always)]
fn adapt<const N: usize, const W: usize>(cdf: &mut Cdf<N, W>, symbol: u32) {
    let last = W - 1;
    let tempo = (cdf.0[last] >> 52) as usize & 3;
    let rate = 4 + u32::from(N >= 4) + tempo as u32;
    let row = &STEPS[usize::from(N >= 4)][tempo];
    for (index, word) in cdf.0.iter_mut().enumerate() {
        let kept = if index == last { row.last } else { row.kept };
        let rising = RISING[(symbol as usize).saturating_sub(4 * index).min(4)];
        let fall = *word >> rate & kept;
        let rise = ((LANES << 15) - *word) >> rate & kept;
        *word = *word - fall + ((fall + rise) & rising);
    }
    cdf.0[last] += row.counted;
}

const LANES: u64 = 0x0001_0001_0001_0001;

/// The lanes before a symbol rise, the others fall.
static RISING: [u64; 5] = [0, 0xffff, 0xffff_ffff, !0 >> 16, !0];

/// What adaptation needs at one rate.
struct Step {
    /// Of a shifted lane, what has not come from the lane above.
    kept: u64,
    /// The same in the last word, where the counter is no lane.
    last: u64,
    /// What is added to the counter; it stays as it is at 32.
    counted: u64,
}

/// By whether there are four symbols or more, and by the counter in units of 16.
static STEPS: [[Step; 4]; 2] = {
    let mut steps = [const {
        [const {
            Step {
                kept: 0,
                last: 0,
                counted: 0,
            }
        }; 4]
    }; 2];
    let mut i = 0;
    while i < 8 {
        let kept = (0xffff >> (4 + i / 4 + i % 4)) * LANES;
        steps[i / 4][i % 4] = Step {
            kept,
            last: kept & (!0 >> 16),
            counted: if i % 4 < 2 { 1 << 48 } else { 0 },
        };
        i += 1;
    }
    steps
};

/// Whole bytes below the `count` (negative) missing bits of the window, and how many. The bits of a
/// byte that fits in part are set too; the next refill sets the same bits again at the same place.
#[cold]
#[inline(never)]
fn refill(data: &[u8], position: usize, count: i32) -> (u64, i32) {
    let word = match data.get(position..).and_then(<[u8]>::first_chunk) {
        Some(&bytes) => u64::from_be_bytes(bytes),
        None => tail(data, position),
    };
    (!word >> (16 + count), (48 - count) >> 3)
}

/// The bytes from `position` on, padded with zero bits.
fn tail(data: &[u8], position: usize) -> u64 {
    let rest = data.get(position..).unwrap_or(&[]);
    let mut bytes = [0; 8];
    bytes[..rest.len()].copy_from_slice(rest);
    u64::from_be_bytes(bytes)
}

#[cfg(test)]
mod tests;
