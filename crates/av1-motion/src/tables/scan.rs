//! §5.11.41, §9.2 The order in which the coefficients of a transform block are coded.
//!
//! The 32 printed tables follow three rules, so they are built here instead of copied:
//! rows one after the other, columns one after the other, or anti-diagonals.

use super::contexts::COEFF_BASE_CTX_OFFSET;
use super::symbols::{SIG_COEF_CONTEXTS_2D, TX_CLASS_2D, TX_CLASS_HORIZ, TX_CLASS_VERT};
use super::tx_size::{
    ADJUSTED_TX_SIZE, TX_4X4, TX_4X8, TX_4X16, TX_8X4, TX_8X8, TX_8X16, TX_8X32, TX_16X4, TX_16X8,
    TX_16X16, TX_16X32, TX_16X64, TX_32X8, TX_32X16, TX_32X32, TX_32X64, TX_64X16, TX_64X32,
    TX_64X64, TX_SIZES_ALL, TX_WIDTH,
};

/// Levels from one row to the next in a buffer of levels: 32 and room for the neighbours of the last
/// column.
pub(crate) const LEVEL_STRIDE: usize = 36;

/// A coefficient in coding order, and what §8.3.2 derives from its place alone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// `row * LEVEL_STRIDE + column`.
    pub(crate) at: u16,
    /// What the context of `coeff_base` adds to the magnitude of the neighbours.
    pub(crate) base_context: u8,
    /// The same for `coeff_br`.
    pub(crate) range_context: u8,
}

/// §9.2 `Mrow_Scan_wxh`.
const fn rows<const SIZE: usize>() -> [u16; SIZE] {
    let mut scan = [0; SIZE];
    let mut i = 0;
    while i < SIZE {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "below 256; no try_from in const fn"
        )]
        let position = i as u16;
        scan[i] = position;
        i += 1;
    }
    scan
}

/// §9.2 `Mcol_Scan_wxh`.
const fn columns<const SIZE: usize>(width: usize) -> [u16; SIZE] {
    let height = SIZE / width;
    let mut scan = [0; SIZE];
    let mut i = 0;
    while i < SIZE {
        scan[i] = position(i % height, i / height, width);
        i += 1;
    }
    scan
}

/// §9.2 `Default_Scan_wxh`: anti-diagonals. Wide blocks walk each from the bottom left up, tall ones
/// from the top right down, square ones alternate and start downwards.
const fn diagonals<const SIZE: usize>(width: usize) -> [u16; SIZE] {
    let height = SIZE / width;
    let mut scan = [0; SIZE];
    let (mut i, mut diagonal) = (0, 0);
    while diagonal < width + height - 1 {
        let downwards = width < height || (width == height && diagonal % 2 == 1);
        let mut step = 0;
        while step <= diagonal {
            let row = if downwards { step } else { diagonal - step };
            let column = diagonal - row;
            if row < height && column < width {
                scan[i] = position(row, column, width);
                i += 1;
            }
            step += 1;
        }
        diagonal += 1;
    }
    scan
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "below 1024; no try_from in const fn"
)]
const fn position(row: usize, column: usize, width: usize) -> u16 {
    (row * width + column) as u16
}

/// §8.3.2: the places of a scan.
const fn places<const SIZE: usize>(scan: &[u16], tx_size: u8, class: u8) -> [Place; SIZE] {
    let width = TX_WIDTH[ADJUSTED_TX_SIZE[tx_size as usize] as usize] as usize;
    let mut places = [Place {
        at: 0,
        base_context: 0,
        range_context: 0,
    }; SIZE];
    let mut i = 0;
    while i < SIZE {
        let (row, col) = (scan[i] as usize / width, scan[i] as usize % width);
        let base_context = match class {
            TX_CLASS_2D => COEFF_BASE_CTX_OFFSET[tx_size as usize][min(row, 4)][min(col, 4)],
            TX_CLASS_HORIZ => (SIG_COEF_CONTEXTS_2D + 5 * min(col, 2)) as u8,
            _ => (SIG_COEF_CONTEXTS_2D + 5 * min(row, 2)) as u8,
        };
        let is_near_origin = match class {
            TX_CLASS_2D => row < 2 && col < 2,
            TX_CLASS_HORIZ => col == 0,
            _ => row == 0,
        };
        places[i] = Place {
            at: (row * LEVEL_STRIDE + col) as u16,
            base_context,
            range_context: if scan[i] == 0 {
                0
            } else if is_near_origin {
                7
            } else {
                14
            },
        };
        i += 1;
    }
    places
}

const fn min(a: usize, b: usize) -> usize {
    if a < b { a } else { b }
}

/// The places of one transform size in the order of each transform class.
macro_rules! by_class {
    ($tx_size:ident, $width:literal x $height:literal) => {{
        const SIZE: usize = $width * $height;
        static DEFAULT: [Place; SIZE] = places(&diagonals::<SIZE>($width), $tx_size, TX_CLASS_2D);
        static COLUMNS: [Place; SIZE] = places(&columns::<SIZE>($width), $tx_size, TX_CLASS_HORIZ);
        static ROWS: [Place; SIZE] = places(&rows::<SIZE>(), $tx_size, TX_CLASS_VERT);
        let mut scans: [&[Place]; 3] = [&DEFAULT; 3];
        scans[TX_CLASS_HORIZ as usize] = &COLUMNS;
        scans[TX_CLASS_VERT as usize] = &ROWS;
        scans
    }};
}

/// The places of a transform size that has no one-dimensional transforms.
macro_rules! default_only {
    ($tx_size:ident, $width:literal x $height:literal) => {{
        const SIZE: usize = $width * $height;
        static DEFAULT: [Place; SIZE] = places(&diagonals::<SIZE>($width), $tx_size, TX_CLASS_2D);
        [&DEFAULT; 3]
    }};
}

/// `[TxSize][transform class]`. Sides of 32 and more have no one-dimensional transforms, and sides
/// of 64 code the lowest 32 frequencies only.
static SCANS: [[&[Place]; 3]; TX_SIZES_ALL] = [
    by_class!(TX_4X4, 4 x 4),
    by_class!(TX_8X8, 8 x 8),
    by_class!(TX_16X16, 16 x 16),
    default_only!(TX_32X32, 32 x 32),
    default_only!(TX_64X64, 32 x 32),
    by_class!(TX_4X8, 4 x 8),
    by_class!(TX_8X4, 8 x 4),
    by_class!(TX_8X16, 8 x 16),
    by_class!(TX_16X8, 16 x 8),
    default_only!(TX_16X32, 16 x 32),
    default_only!(TX_32X16, 32 x 16),
    default_only!(TX_32X64, 32 x 32),
    default_only!(TX_64X32, 32 x 32),
    by_class!(TX_4X16, 4 x 16),
    by_class!(TX_16X4, 16 x 4),
    default_only!(TX_8X32, 8 x 32),
    default_only!(TX_32X8, 32 x 8),
    default_only!(TX_16X64, 16 x 32),
    default_only!(TX_64X16, 32 x 16),
];

/// §5.11.41 `get_scan`: the places of the coefficients in coding order. `tx_class` is the class of
/// `PlaneTxType`.
pub(crate) fn scan(tx_size: u8, tx_class: u8) -> &'static [Place] {
    SCANS[usize::from(tx_size)][usize::from(tx_class)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::fnv1a;
    use crate::tables::tx_size::TX_HEIGHT;

    /// Positions `row * width + column` in coding order.
    fn positions(tx_size: u8, tx_class: u8) -> Vec<u16> {
        let width = TX_WIDTH[usize::from(ADJUSTED_TX_SIZE[usize::from(tx_size)])] as usize;
        scan(tx_size, tx_class)
            .iter()
            .map(|place| usize::from(place.at))
            .map(|at| position(at / LEVEL_STRIDE, at % LEVEL_STRIDE, width))
            .collect()
    }

    #[test]
    fn a_tall_block_goes_down_its_diagonals_and_a_wide_one_up() {
        assert_eq!(positions(TX_4X8, TX_CLASS_2D)[..6], [0, 1, 4, 2, 5, 8]);
        assert_eq!(positions(TX_8X4, TX_CLASS_2D)[..6], [0, 8, 1, 16, 9, 2]);
        assert_eq!(
            positions(TX_4X4, TX_CLASS_2D)[..10],
            [0, 1, 4, 8, 5, 2, 3, 6, 9, 12]
        );
    }

    #[test]
    fn a_vertical_transform_is_read_by_rows_and_a_horizontal_one_by_columns() {
        assert_eq!(positions(TX_4X8, TX_CLASS_VERT)[..6], [0, 1, 2, 3, 4, 5]);
        assert_eq!(
            positions(TX_4X8, TX_CLASS_HORIZ)[..9],
            [0, 4, 8, 12, 16, 20, 24, 28, 1]
        );
    }

    // Computed by another program from the tables printed in §9.2.
    #[test]
    fn the_rules_give_the_printed_scans() {
        let mut all = Vec::new();
        for tx_size in 0..TX_SIZES_ALL as u8 {
            for tx_class in [TX_CLASS_2D, TX_CLASS_HORIZ, TX_CLASS_VERT] {
                let scan = positions(tx_size, tx_class);
                let coded = usize::from(ADJUSTED_TX_SIZE[usize::from(tx_size)]);
                let area = usize::from(TX_WIDTH[coded]) * usize::from(TX_HEIGHT[coded]);
                assert_eq!(scan.len(), area);
                all.extend_from_slice(&scan);
            }
        }
        assert_eq!(all.len(), 22_320);
        assert_eq!(fnv1a(all), 0x4016_048b_a67b_0fdd);
    }
}
