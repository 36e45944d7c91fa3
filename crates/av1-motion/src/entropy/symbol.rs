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

use super::cdf::Cdf;
use crate::tables::symbols::{EC_MIN_PROB, EC_PROB_SHIFT};
use crate::trace::SymbolCounter;

/// §8.2.2: the arithmetic decoder over the bytes of one tile.
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
        let mut decoder = Self {
            data,
            position: 0,
            window: 0,
            count: -15,
            range: 1 << 15,
            adapts,
            counter: SymbolCounter::default(),
        };
        decoder.refill();
        decoder
    }

    /// Loads whole bytes below the bits that are left. The bits of a byte that fits in part are set
    /// too; the next refill sets the same bits again at the same place.
    #[inline]
    fn refill(&mut self) {
        let word = match self.data.get(self.position..self.position + 8) {
            Some(bytes) => u64::from_be_bytes(bytes.try_into().expect("eight bytes")),
            None => self.tail(),
        };
        self.window |= !word >> (16 + self.count);
        let bytes = (48 - self.count) >> 3;
        self.position += bytes as usize;
        self.count += bytes << 3;
    }

    /// The last bytes of the tile, padded with zero bits.
    #[cold]
    fn tail(&self) -> u64 {
        let rest = self.data.get(self.position..).unwrap_or(&[]);
        let mut bytes = [0; 8];
        bytes[..rest.len()].copy_from_slice(rest);
        u64::from_be_bytes(bytes)
    }

    /// §8.2.6, renormalisation steps 1 to 7.
    #[inline(always)]
    fn renormalize(&mut self, window: u64, range: u32) {
        let bits = range.leading_zeros() - 16;
        self.range = range << bits;
        self.window = window << bits;
        self.count -= bits as i32;
        if self.count < 0 {
            self.refill();
        }
    }

    /// §8.2.6: reads a symbol of `N` values and adapts its distribution.
    #[inline(always)]
    pub(crate) fn symbol<const N: usize, const W: usize>(&mut self, cdf: &mut Cdf<N, W>) -> u8 {
        self.counter.symbol(N);
        let row = &mut cdf.0;
        let value = (self.window >> 48) as u32;
        let scale = self.range >> 8;
        let mut previous = self.range;
        let mut symbol = 0;
        let mut current = bound(scale, row[0], N - 1);
        while value < current {
            symbol += 1;
            previous = current;
            current = bound(scale, row[symbol], N - 1 - symbol);
        }
        self.renormalize(self.window - (u64::from(current) << 48), previous - current);
        if self.adapts {
            adapt::<N, W>(row, symbol);
        }
        symbol as u8
    }

    /// §8.2.6 for two values.
    #[inline(always)]
    pub(crate) fn flag(&mut self, cdf: &mut Cdf<2, 2>) -> bool {
        let [probability, counter] = cdf.0;
        let bit = self.split(probability);
        if self.adapts {
            let rate = 4 + (counter >> 4);
            cdf.0[0] = if bit {
                probability + ((32768 - probability) >> rate)
            } else {
                probability - (probability >> rate)
            };
            cdf.0[1] = counter + u16::from(counter < 32);
        }
        bit
    }

    /// §8.3.2: a flag whose (inverse) probability is derived and does not adapt.
    #[inline(always)]
    pub(crate) fn split(&mut self, probability: u16) -> bool {
        self.counter.symbol(2);
        let value = (self.window >> 48) as u32;
        let bound = bound(self.range >> 8, probability, 1);
        let bit = value < bound;
        let (window, range) = if bit {
            (self.window, bound)
        } else {
            (self.window - (u64::from(bound) << 48), self.range - bound)
        };
        self.renormalize(window, range);
        bit
    }

    /// §8.2.3 `read_bool`.
    #[inline(always)]
    pub(crate) fn bit(&mut self) -> bool {
        self.split(1 << 14)
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

/// §8.2.6: moves the distribution towards `symbol`.
#[inline(always)]
fn adapt<const N: usize, const W: usize>(row: &mut [u16; W], symbol: usize) {
    let counter = row[W - 1];
    let rate = if N >= 4 { 5 } else { 4 } + (counter >> 4);
    for (index, inverse) in row.iter_mut().enumerate() {
        let raised = *inverse + ((32768 - *inverse) >> rate);
        let lowered = *inverse - (*inverse >> rate);
        *inverse = if index < symbol { raised } else { lowered };
    }
    row[W - 1] = counter + u16::from(counter < 32);
}
