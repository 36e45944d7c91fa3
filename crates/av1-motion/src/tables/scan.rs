//! §5.11.41, §9.2 The order in which the coefficients of a transform block are coded.
//!
//! The 32 printed tables follow three rules, so they are built here instead of copied:
//! rows one after the other, columns one after the other, or anti-diagonals.

use super::symbols::{TX_CLASS_2D, TX_CLASS_HORIZ, TX_CLASS_VERT};

/// §9.2 `Mrow_Scan_*`: every one of them is the beginning of this.
static ROWS: [u16; 256] = rows();

const fn rows() -> [u16; 256] {
    let mut scan = [0; 256];
    let mut i = 0;
    while i < scan.len() {
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

static DEFAULT_4X4: [u16; 16] = diagonals(4);
static DEFAULT_4X8: [u16; 32] = diagonals(4);
static DEFAULT_8X4: [u16; 32] = diagonals(8);
static DEFAULT_8X8: [u16; 64] = diagonals(8);
static DEFAULT_8X16: [u16; 128] = diagonals(8);
static DEFAULT_16X8: [u16; 128] = diagonals(16);
static DEFAULT_16X16: [u16; 256] = diagonals(16);
static DEFAULT_16X32: [u16; 512] = diagonals(16);
static DEFAULT_32X16: [u16; 512] = diagonals(32);
static DEFAULT_32X32: [u16; 1024] = diagonals(32);
static DEFAULT_4X16: [u16; 64] = diagonals(4);
static DEFAULT_16X4: [u16; 64] = diagonals(16);
static DEFAULT_8X32: [u16; 256] = diagonals(8);
static DEFAULT_32X8: [u16; 256] = diagonals(32);

static COLUMNS_4X4: [u16; 16] = columns(4);
static COLUMNS_4X8: [u16; 32] = columns(4);
static COLUMNS_8X4: [u16; 32] = columns(8);
static COLUMNS_8X8: [u16; 64] = columns(8);
static COLUMNS_8X16: [u16; 128] = columns(8);
static COLUMNS_16X8: [u16; 128] = columns(16);
static COLUMNS_16X16: [u16; 256] = columns(16);
static COLUMNS_4X16: [u16; 64] = columns(4);
static COLUMNS_16X4: [u16; 64] = columns(16);

/// The three orders of one transform size, by transform class.
const fn by_class(default: &'static [u16], columns: &'static [u16]) -> [&'static [u16]; 3] {
    let mut scans = [default; 3];
    scans[TX_CLASS_2D as usize] = default;
    scans[TX_CLASS_HORIZ as usize] = columns;
    scans[TX_CLASS_VERT as usize] = ROWS.split_at(columns.len()).0;
    scans
}

/// `[TxSize][transform class]`. Sides of 32 and more have no one-dimensional transforms, and sides
/// of 64 code the lowest 32 frequencies only.
static SCANS: [[&[u16]; 3]; super::tx_size::TX_SIZES_ALL] = [
    by_class(&DEFAULT_4X4, &COLUMNS_4X4),
    by_class(&DEFAULT_8X8, &COLUMNS_8X8),
    by_class(&DEFAULT_16X16, &COLUMNS_16X16),
    [&DEFAULT_32X32; 3],
    [&DEFAULT_32X32; 3],
    by_class(&DEFAULT_4X8, &COLUMNS_4X8),
    by_class(&DEFAULT_8X4, &COLUMNS_8X4),
    by_class(&DEFAULT_8X16, &COLUMNS_8X16),
    by_class(&DEFAULT_16X8, &COLUMNS_16X8),
    [&DEFAULT_16X32; 3],
    [&DEFAULT_32X16; 3],
    [&DEFAULT_32X32; 3],
    [&DEFAULT_32X32; 3],
    by_class(&DEFAULT_4X16, &COLUMNS_4X16),
    by_class(&DEFAULT_16X4, &COLUMNS_16X4),
    [&DEFAULT_8X32; 3],
    [&DEFAULT_32X8; 3],
    [&DEFAULT_16X32; 3],
    [&DEFAULT_32X16; 3],
];

/// §5.11.41 `get_scan`: positions `row * width + column` in coding order, where `width` is that of
/// `Adjusted_Tx_Size`. `tx_class` is the class of `PlaneTxType`.
pub(crate) fn scan(tx_size: u8, tx_class: u8) -> &'static [u16] {
    SCANS[usize::from(tx_size)][usize::from(tx_class)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::fnv1a;
    use crate::tables::tx_size::{
        ADJUSTED_TX_SIZE, TX_4X4, TX_4X8, TX_8X4, TX_HEIGHT, TX_SIZES_ALL, TX_WIDTH,
    };

    #[test]
    fn a_tall_block_goes_down_its_diagonals_and_a_wide_one_up() {
        assert_eq!(scan(TX_4X8, TX_CLASS_2D)[..6], [0, 1, 4, 2, 5, 8]);
        assert_eq!(scan(TX_8X4, TX_CLASS_2D)[..6], [0, 8, 1, 16, 9, 2]);
        assert_eq!(
            scan(TX_4X4, TX_CLASS_2D)[..10],
            [0, 1, 4, 8, 5, 2, 3, 6, 9, 12]
        );
    }

    #[test]
    fn a_vertical_transform_is_read_by_rows_and_a_horizontal_one_by_columns() {
        assert_eq!(scan(TX_4X8, TX_CLASS_VERT)[..6], [0, 1, 2, 3, 4, 5]);
        assert_eq!(
            scan(TX_4X8, TX_CLASS_HORIZ)[..9],
            [0, 4, 8, 12, 16, 20, 24, 28, 1]
        );
    }

    // Computed by another program from the tables printed in §9.2.
    #[test]
    fn the_rules_give_the_printed_scans() {
        let mut all = Vec::new();
        for tx_size in 0..TX_SIZES_ALL {
            for tx_class in [TX_CLASS_2D, TX_CLASS_HORIZ, TX_CLASS_VERT] {
                let scan = SCANS[tx_size][usize::from(tx_class)];
                let coded = usize::from(ADJUSTED_TX_SIZE[tx_size]);
                let area = usize::from(TX_WIDTH[coded]) * usize::from(TX_HEIGHT[coded]);
                assert_eq!(scan.len(), area);
                all.extend_from_slice(scan);
            }
        }
        assert_eq!(all.len(), 22_320);
        assert_eq!(fnv1a(all), 0x4016_048b_a67b_0fdd);
    }
}
