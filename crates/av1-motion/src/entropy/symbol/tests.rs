//! The decoder against §8.2 taken word by word: one bit at a time, one distribution as printed.

use super::*;

/// §8.2.2 to §8.2.6 without any rearrangement.
struct Specification<'a> {
    data: &'a [u8],
    position: usize,
    symbol_value: u32,
    symbol_range: u32,
    symbol_max_bits: i64,
}

impl<'a> Specification<'a> {
    fn init_symbol(data: &'a [u8]) -> Self {
        let mut decoder = Self {
            data,
            position: 0,
            symbol_value: 0,
            symbol_range: 1 << 15,
            symbol_max_bits: 8 * data.len() as i64 - 15,
        };
        let num_bits = (8 * data.len()).min(15) as u32;
        let padded = decoder.f(num_bits) << (15 - num_bits);
        decoder.symbol_value = ((1 << 15) - 1) ^ padded;
        decoder
    }

    fn f(&mut self, bits: u32) -> u32 {
        (0..bits).fold(0, |value, _| {
            let byte = self.data[self.position / 8];
            let bit = byte >> (7 - self.position % 8) & 1;
            self.position += 1;
            value << 1 | u32::from(bit)
        })
    }

    fn symbol(&mut self, cdf: &mut [u16], adapts: bool) -> usize {
        let n = cdf.len() - 1;
        let (mut cur, mut symbol) = (self.symbol_range, usize::MAX);
        let prev = loop {
            symbol = symbol.wrapping_add(1);
            let prev = cur;
            let f = (1 << 15) - u32::from(cdf[symbol]);
            cur = (((self.symbol_range >> 8) * (f >> 6)) >> 1) + 4 * (n - symbol - 1) as u32;
            if self.symbol_value >= cur {
                break prev;
            }
        };
        self.symbol_range = prev - cur;
        self.symbol_value -= cur;
        let bits = 15 - self.symbol_range.ilog2();
        self.symbol_range <<= bits;
        let num_bits = i64::from(bits).min(self.symbol_max_bits.max(0)) as u32;
        let padded = self.f(num_bits) << (bits - num_bits);
        self.symbol_value = padded ^ (((self.symbol_value + 1) << bits) - 1);
        self.symbol_max_bits -= i64::from(bits);
        if adapts {
            let rate = 3 + u32::from(cdf[n] > 15) + u32::from(cdf[n] > 31) + n.ilog2().min(2);
            for (i, value) in cdf[..n - 1].iter_mut().enumerate() {
                let target = if i >= symbol { 1_u32 << 15 } else { 0 };
                let old = u32::from(*value);
                *value = if target < old {
                    old - ((old - target) >> rate)
                } else {
                    old + ((target - old) >> rate)
                } as u16;
            }
            cdf[n] += u16::from(cdf[n] < 32);
        }
        symbol
    }
}

/// Reproducible bytes (xorshift).
fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    std::iter::repeat_with(next).take(length).collect()
}

/// Reads the same bytes both ways until well past their end, over four distributions in turn.
fn compare<const M: usize, const N: usize, const W: usize>(spec: [u16; M], adapts: bool) {
    for seed in 0..20 {
        let data = noise(seed, seed as usize * 9);
        let mut ours = SymbolDecoder::new(&data, adapts);
        let mut theirs = Specification::init_symbol(&data);
        let (mut cdfs, mut printed) = ([Cdf::<N, W>::from_spec(spec); 4], [spec; 4]);
        for read in 0..2000 {
            let which = read * read % 7 % 4;
            let found = ours.symbol(&mut cdfs[which]);
            let wanted = theirs.symbol(&mut printed[which], adapts);
            assert_eq!(
                usize::from(found),
                wanted,
                "read {read} of seed {seed}, {N} values"
            );
            assert_eq!(ours.max_bits(), theirs.symbol_max_bits);
            for (i, value) in printed[which].iter().enumerate().take(N - 1) {
                assert_eq!(cdfs[which].inverse(i), (1 << 15) - value);
            }
            assert_eq!(cdfs[which].inverse(4 * W - 1), printed[which][N]);
        }
    }
}

/// A printed row: unequal steps up to 32768, then the counter.
fn row<const M: usize>() -> [u16; M] {
    std::array::from_fn(|i| match M - 1 - i {
        0 => 0,
        1 => 1 << 15,
        _ => 1500 * (i as u16 + 1) + 37 * (i * i) as u16,
    })
}

#[test]
fn symbols_and_distributions_are_those_of_the_specification_for_every_alphabet() {
    for adapts in [true, false] {
        compare::<3, 2, 1>(row(), adapts);
        compare::<4, 3, 1>(row(), adapts);
        compare::<5, 4, 1>(row(), adapts);
        compare::<6, 5, 2>(row(), adapts);
        compare::<7, 6, 2>(row(), adapts);
        compare::<8, 7, 2>(row(), adapts);
        compare::<9, 8, 2>(row(), adapts);
        compare::<10, 9, 3>(row(), adapts);
        compare::<11, 10, 3>(row(), adapts);
        compare::<12, 11, 3>(row(), adapts);
        compare::<13, 12, 3>(row(), adapts);
        compare::<14, 13, 4>(row(), adapts);
        compare::<15, 14, 4>(row(), adapts);
        compare::<17, 16, 4>(row(), adapts);
    }
}

#[test]
fn flags_and_literals_are_symbols_of_two_values() {
    for seed in 1..20 {
        let data = noise(seed, 300);
        let mut ours = SymbolDecoder::new(&data, true);
        let mut theirs = Specification::init_symbol(&data);
        let (mut cdf, mut printed) = (Cdf2::from_spec([9000, 1 << 15, 0]), [9000, 1 << 15, 0]);
        for read in 0..1500 {
            let wanted = theirs.symbol(&mut printed, true);
            assert_eq!(
                usize::from(ours.flag(&mut cdf)),
                wanted,
                "flag {read} of seed {seed}"
            );
            let wanted = theirs.symbol(&mut [1 << 14, 1 << 15, 0], false);
            assert_eq!(
                ours.literal(1) as usize,
                wanted,
                "bit {read} of seed {seed}"
            );
        }
    }
}

#[test]
fn a_tile_ends_with_a_one_and_zeros_and_nowhere_else() {
    // 15 bits are consumed at the start; the padding of this tile begins with the 16th.
    assert!(
        SymbolDecoder::new(&[0x12, 0x34 | 1], true)
            .finish()
            .is_err()
    );
    assert!(SymbolDecoder::new(&[0x80], true).finish().is_ok());
    assert!(SymbolDecoder::new(&[0x80, 0, 0], true).finish().is_ok());
    assert!(SymbolDecoder::new(&[0x80, 0, 1], true).finish().is_err());
    assert!(SymbolDecoder::new(&[], true).finish().is_err());
}

#[test]
fn many_bits_at_once_are_those_read_one_by_one() {
    for seed in 0..200 {
        let data = noise(seed, seed as usize * 2);
        let mut ours = SymbolDecoder::new(&data, true);
        let mut theirs = Specification::init_symbol(&data);
        let (mut cdf, mut printed) = (Cdf2::from_spec(row::<3>()), row::<3>());
        for read in 0..300 {
            let digit = ours.digit(&mut cdf);
            assert_eq!(digit as usize, theirs.symbol(&mut printed, true));
            assert_eq!(cdf.inverse(0), (1 << 15) - printed[0]);
            let left = read * 7 % 90;
            let wanted: usize = (0..left)
                .map(|_| theirs.symbol(&mut [1 << 14, 1 << 15, 0], false))
                .sum();
            assert_eq!(
                ours.ones(left) as usize,
                wanted,
                "read {read} of seed {seed}"
            );
            assert_eq!(ours.max_bits(), theirs.symbol_max_bits);
        }
    }
}
