//! §8.2.6 The adaptive distribution behind one symbol.

/// §8.2.6: the cumulative distribution of a symbol with `N` values, in `W` words of four lanes of 16
/// bits, the first lane lowest.
///
/// Stored inverted (`32768 - cdf[i]`), which is what the decoding loop needs, for `i` in
/// `0..N - 1`. The specification's constant entry (32768, here 0) is left out, padding lanes are 0,
/// and the last lane holds the adaptation counter (0 to 32). Words, because a row that is read as
/// it was written comes straight from the processor's store buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cdf<const N: usize, const W: usize>(pub(crate) [u64; W]);

pub(crate) type Cdf2 = Cdf<2, 1>;
pub(crate) type Cdf3 = Cdf<3, 1>;
pub(crate) type Cdf4 = Cdf<4, 1>;
pub(crate) type Cdf5 = Cdf<5, 2>;
pub(crate) type Cdf6 = Cdf<6, 2>;
pub(crate) type Cdf7 = Cdf<7, 2>;
pub(crate) type Cdf8 = Cdf<8, 2>;
pub(crate) type Cdf9 = Cdf<9, 3>;
pub(crate) type Cdf10 = Cdf<10, 3>;
pub(crate) type Cdf11 = Cdf<11, 3>;
pub(crate) type Cdf12 = Cdf<12, 3>;
pub(crate) type Cdf13 = Cdf<13, 4>;
pub(crate) type Cdf14 = Cdf<14, 4>;
pub(crate) type Cdf16 = Cdf<16, 4>;

/// `1 << 15`, the specification's probability one.
const ONE: u16 = 1 << 15;

impl<const N: usize, const W: usize> Cdf<N, W> {
    /// §9.4: converts a row as printed: `N` rising values that end in 32768, then the counter 0.
    ///
    /// # Panics
    /// If the row is not of that form. Used in constants only, so a bad table does not compile.
    pub(crate) const fn from_spec<const M: usize>(spec: [u16; M]) -> Self {
        assert!(
            M == N + 1 && N >= 2 && N <= 4 * W,
            "N + 1 numbers, and room for the counter"
        );
        assert!(spec[N - 1] == ONE && spec[N] == 0, "a row ends in 32768, 0");
        let mut words = [0; W];
        let mut i = 0;
        while i < N - 1 {
            assert!(spec[i] < spec[i + 1], "a cumulative distribution rises");
            words[i / 4] |= ((ONE - spec[i]) as u64) << (16 * (i % 4));
            i += 1;
        }
        Self(words)
    }

    /// `32768 - cdf[index]`; the counter in the last lane.
    #[inline]
    pub(crate) fn inverse(&self, index: usize) -> u16 {
        (self.0[index / 4] >> (16 * (index % 4))) as u16
    }
}

/// §9.4: [`Cdf::from_spec`] for a table with one index.
pub(crate) const fn rows<const M: usize, const N: usize, const W: usize, const A: usize>(
    spec: [[u16; M]; A],
) -> [Cdf<N, W>; A] {
    let mut cdfs = [Cdf([0; W]); A];
    let mut i = 0;
    while i < A {
        cdfs[i] = Cdf::from_spec(spec[i]);
        i += 1;
    }
    cdfs
}

/// §9.4: [`Cdf::from_spec`] for a table with two indices.
pub(crate) const fn rows2<
    const M: usize,
    const N: usize,
    const W: usize,
    const A: usize,
    const B: usize,
>(
    spec: [[[u16; M]; B]; A],
) -> [[Cdf<N, W>; B]; A] {
    let mut cdfs = [[Cdf([0; W]); B]; A];
    let mut i = 0;
    while i < A {
        cdfs[i] = rows(spec[i]);
        i += 1;
    }
    cdfs
}

/// §9.4: [`Cdf::from_spec`] for a table with three indices.
pub(crate) const fn rows3<
    const M: usize,
    const N: usize,
    const W: usize,
    const A: usize,
    const B: usize,
    const C: usize,
>(
    spec: [[[[u16; M]; C]; B]; A],
) -> [[[Cdf<N, W>; C]; B]; A] {
    let mut cdfs = [[[Cdf([0; W]); C]; B]; A];
    let mut i = 0;
    while i < A {
        cdfs[i] = rows2(spec[i]);
        i += 1;
    }
    cdfs
}

/// §6.8.2 `load_cdfs`: sets the last entry of each array, the symbol count, to 0.
pub(crate) trait ResetCounters {
    fn reset_counters(&mut self);
}

impl<const N: usize, const W: usize> ResetCounters for Cdf<N, W> {
    fn reset_counters(&mut self) {
        self.0[W - 1] &= !0 >> 16;
    }
}

impl<T: ResetCounters, const K: usize> ResetCounters for [T; K] {
    fn reset_counters(&mut self) {
        for cdf in self {
            cdf.reset_counters();
        }
    }
}

/// Walks every distribution of a set in order; lets tests look at a set as a whole.
#[cfg(test)]
pub(crate) trait VisitCdfs {
    /// Calls `visit` with the number of symbols and the lanes of each distribution: the inverse
    /// values, padded with zeros to a power of two, the last of them the counter.
    fn visit_cdfs(&mut self, visit: &mut dyn FnMut(usize, &mut [u16]));
}

#[cfg(test)]
impl<const N: usize, const W: usize> VisitCdfs for Cdf<N, W> {
    fn visit_cdfs(&mut self, visit: &mut dyn FnMut(usize, &mut [u16])) {
        let mut lanes = vec![0; N.next_power_of_two()];
        for (index, lane) in lanes.iter_mut().enumerate().take(N - 1) {
            *lane = self.inverse(index);
        }
        *lanes.last_mut().unwrap() = self.inverse(4 * W - 1);
        visit(N, &mut lanes);
        let counter = lanes.pop().unwrap();
        self.0 = [0; W];
        for (index, lane) in lanes.into_iter().enumerate().take(N - 1) {
            self.0[index / 4] |= u64::from(lane) << (16 * (index % 4));
        }
        self.0[W - 1] |= u64::from(counter) << 48;
    }
}

#[cfg(test)]
impl<T: VisitCdfs, const K: usize> VisitCdfs for [T; K] {
    fn visit_cdfs(&mut self, visit: &mut dyn FnMut(usize, &mut [u16])) {
        for cdf in self {
            cdf.visit_cdfs(visit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_printed_row_is_inverted_and_padded_up_to_the_counter() {
        let cdf = Cdf5::from_spec([100, 2000, 30_000, 32_000, 32_768, 0]);
        let lanes: [u16; 8] = std::array::from_fn(|index| cdf.inverse(index));
        assert_eq!(lanes, [32_668, 30_768, 2768, 768, 0, 0, 0, 0]);
    }

    #[test]
    fn the_counter_of_a_full_row_takes_the_place_of_the_constant_entry() {
        let fresh = Cdf4::from_spec([20_000, 25_000, 30_000, 32_768, 0]);
        let mut used = Cdf::<4, 1>([fresh.0[0] | 32 << 48]);
        assert_eq!(used.inverse(3), 32);
        used.reset_counters();
        assert_eq!(used, fresh);
    }

    #[test]
    #[should_panic(expected = "a cumulative distribution rises")]
    fn a_row_that_falls_is_refused() {
        let _ = Cdf3::from_spec([300, 200, 32_768, 0]);
    }
}
