//! §8.2.5: many bits of even odds at once.
//!
//! `read_bool` halves the range `256 a + b` to `128 a + 4` for a 1 and to the rest for a 0. After the
//! first 1 the range is `256 a + 8`, whose halves are equal, and it stays so. From there on the bits
//! are the digits of a long division of `SymbolValue` and what follows it in the stream by the range,
//! a quotient digit 1 standing for a 0.

use super::SymbolDecoder;

/// The last byte of a range with equal halves.
const HALVES: u32 = 8;

impl SymbolDecoder<'_> {
    /// Reads `left` bits of even odds; how many of them are 1.
    #[inline(always)]
    pub(crate) fn ones(&mut self, mut left: u32) -> u32 {
        let mut ones = 0;
        while left > 0 {
            if self.range & 255 == HALVES && self.count > 0 {
                let bits = left.min(self.count as u32);
                ones += bits - self.divide(bits).count_ones();
                left -= bits;
            } else {
                ones += u32::from(self.bit());
                left -= 1;
            }
        }
        ones
    }

    /// As many bits, which the window holds, of a range with equal halves; inverted.
    #[inline(always)]
    fn divide(&mut self, bits: u32) -> u64 {
        (0..bits).for_each(|_| self.counter.symbol(2));
        let (digits, range) = (self.window >> (48 - bits), u64::from(self.range));
        let quotient = digits / range;
        self.window = (self.window - ((quotient * range) << (48 - bits))) << bits;
        self.count -= bits as i32;
        quotient
    }
}
