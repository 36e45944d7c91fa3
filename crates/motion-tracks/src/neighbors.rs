//! The blocks nearest to a block, from bins of block centres.

use crate::filter::MAX_NEIGHBORS;

/// Blocks per bin that the bin size aims at.
const BIN_LOAD: i64 = 3;

/// Block centres of one reference, sorted into square bins. Positions are in half pixels: exact.
pub(crate) struct NeighborSearch {
    bin: i32,
    origin: [i32; 2],
    columns: i32,
    lines: i32,
    starts: Vec<u32>,
    /// Centre and row, bin by bin.
    entries: Vec<([i32; 2], u32)>,
    centers: Vec<[i32; 2]>,
}

/// Up to [`MAX_NEIGHBORS`] rows, nearest first; equal distances by row.
pub(crate) struct Neighbors {
    /// Squared distance above, row below: one comparison orders both.
    keys: [u64; MAX_NEIGHBORS],
    len: usize,
    limit: usize,
}

impl Neighbors {
    fn new(limit: usize) -> Self {
        Self {
            keys: [u64::MAX; MAX_NEIGHBORS],
            len: 0,
            limit,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    #[expect(clippy::cast_possible_truncation, reason = "the low half is the row")]
    pub(crate) fn rows(&self) -> impl Iterator<Item = u32> + '_ {
        self.keys[..self.len].iter().map(|&key| key as u32)
    }

    /// Squared distance that a further candidate has to beat; none while there is room.
    fn worst(&self) -> Option<u64> {
        (self.len == self.limit).then(|| self.keys[self.len - 1] >> 32)
    }

    fn offer(&mut self, squared_distance: u64, row: u32) {
        let key = squared_distance.min(u64::from(u32::MAX)) << 32 | u64::from(row);
        if self.len == self.limit && key >= self.keys[self.len - 1] {
            return;
        }
        let mut at = if self.len == self.limit {
            self.len - 1
        } else {
            self.len
        };
        while at > 0 && self.keys[at - 1] > key {
            self.keys[at] = self.keys[at - 1];
            at -= 1;
        }
        self.keys[at] = key;
        self.len = (self.len + 1).min(self.limit);
    }
}

impl NeighborSearch {
    /// Sorts the given rows (not empty) of `blocks`.
    pub(crate) fn new(blocks: &[[i32; 4]], rows: &[u32]) -> Self {
        let mut centers = vec![[0; 2]; blocks.len()];
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for &row in rows {
            let [x, y, w, h] = blocks[row as usize];
            let center = [2 * x + w, 2 * y + h];
            centers[row as usize] = center;
            for axis in 0..2 {
                low[axis] = low[axis].min(center[axis]);
                high[axis] = high[axis].max(center[axis]);
            }
        }
        let bin = bin_size(low, high, rows.len());
        let (columns, lines) = ((high[0] - low[0]) / bin + 1, (high[1] - low[1]) / bin + 1);
        let mut search = Self {
            bin,
            origin: low,
            columns,
            lines,
            starts: Vec::new(),
            entries: Vec::new(),
            centers,
        };
        search.fill(rows);
        search
    }

    fn fill(&mut self, rows: &[u32]) {
        let bins = self.columns.unsigned_abs() as usize * self.lines.unsigned_abs() as usize;
        self.starts = vec![0; bins + 1];
        for &row in rows {
            let bin = self.bin_index(self.bin_of(self.centers[row as usize]));
            self.starts[bin + 1] += 1;
        }
        for bin in 0..bins {
            self.starts[bin + 1] += self.starts[bin];
        }
        self.entries = vec![([0; 2], 0); rows.len()];
        let mut fill = self.starts.clone();
        for &row in rows {
            let center = self.centers[row as usize];
            let slot = &mut fill[self.bin_index(self.bin_of(center))];
            self.entries[*slot as usize] = (center, row);
            *slot += 1;
        }
    }

    fn bin_of(&self, center: [i32; 2]) -> [i32; 2] {
        [
            (center[0] - self.origin[0]) / self.bin,
            (center[1] - self.origin[1]) / self.bin,
        ]
    }

    fn bin_index(&self, [column, line]: [i32; 2]) -> usize {
        (line * self.columns + column).unsigned_abs() as usize
    }

    /// The `count` nearest other blocks; rows of the same rectangle are the same block.
    pub(crate) fn nearest(&self, row: u32, count: usize) -> Neighbors {
        let center = self.centers[row as usize];
        let [column, line] = self.bin_of(center);
        let mut found = Neighbors::new(count);
        for ring in 0..self.columns.max(self.lines) {
            let lines = (line - ring).max(0)..=(line + ring).min(self.lines - 1);
            for bin_line in lines {
                let edge = (bin_line - line).abs() == ring;
                let step = if edge || ring == 0 { 1 } else { 2 * ring };
                let mut bin_column = column - ring;
                while bin_column <= column + ring {
                    if (0..self.columns).contains(&bin_column) {
                        self.scan(self.bin_index([bin_column, bin_line]), center, &mut found);
                    }
                    bin_column += step;
                }
            }
            let reached = self.reach(center, [column, line], ring);
            if found.worst().is_some_and(|worst| worst < reached * reached) {
                break;
            }
        }
        found
    }

    /// Distance from `center` to the nearest point outside the rings seen so far.
    fn reach(&self, center: [i32; 2], bin: [i32; 2], ring: i32) -> u64 {
        let side = |axis: usize| {
            let low = self.origin[axis] + (bin[axis] - ring) * self.bin;
            let high = self.origin[axis] + (bin[axis] + ring + 1) * self.bin;
            (center[axis] - low + 1).min(high - center[axis])
        };
        u64::from(side(0).min(side(1)).max(0).unsigned_abs())
    }

    fn scan(&self, bin: usize, center: [i32; 2], found: &mut Neighbors) {
        for &(at, row) in &self.entries[self.starts[bin] as usize..self.starts[bin + 1] as usize] {
            let (dx, dy) = (i64::from(at[0] - center[0]), i64::from(at[1] - center[1]));
            // A centre that coincides is the block itself.
            if dx != 0 || dy != 0 {
                found.offer((dx * dx + dy * dy).unsigned_abs(), row);
            }
        }
    }
}

/// Bin side in half pixels for about [`BIN_LOAD`] blocks per bin, between 16 and 4096.
fn bin_size(low: [i32; 2], high: [i32; 2], count: usize) -> i32 {
    let area = i64::from(high[0] - low[0] + 1) * i64::from(high[1] - low[1] + 1);
    let count = i64::try_from(count.max(1)).unwrap_or(i64::MAX);
    let side = (area * BIN_LOAD / count).isqrt().clamp(16, 4096);
    i32::try_from(side).unwrap_or(4096)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brute_force(blocks: &[[i32; 4]], row: usize, count: usize) -> Vec<u32> {
        let center = |[x, y, w, h]: [i32; 4]| [2 * x + w, 2 * y + h];
        let at = center(blocks[row]);
        let mut keys: Vec<(i32, u32)> = blocks
            .iter()
            .zip(0_u32..)
            .map(|(&block, other)| {
                let [x, y] = center(block);
                ((x - at[0]).pow(2) + (y - at[1]).pow(2), other)
            })
            .filter(|&(distance, _)| distance > 0)
            .collect();
        keys.sort_unstable();
        keys.iter().take(count).map(|&(_, other)| other).collect()
    }

    #[test]
    fn bins_find_the_same_neighbours_as_looking_at_every_block() {
        // A small linear congruential sequence places blocks unevenly: dense left, sparse right.
        let mut state = 7_u32;
        let mut next = |limit: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            i32::try_from((state >> 8) % limit).unwrap()
        };
        let blocks: Vec<[i32; 4]> = (0..300)
            .map(|i| {
                [
                    if i < 200 { next(120) } else { next(1900) },
                    next(300),
                    4 << next(4),
                    4 << next(4),
                ]
            })
            .collect();
        let rows: Vec<u32> = (0..300).collect();
        let search = NeighborSearch::new(&blocks, &rows);
        for row in 0..300 {
            let found: Vec<u32> = search.nearest(row, 12).rows().collect();
            assert_eq!(found, brute_force(&blocks, row as usize, 12), "row {row}");
        }
    }

    #[test]
    fn a_block_alone_has_no_neighbours() {
        let search = NeighborSearch::new(&[[0, 0, 8, 8], [0, 0, 8, 8]], &[0, 1]);
        assert_eq!(search.nearest(0, 12).len(), 0);
    }
}
