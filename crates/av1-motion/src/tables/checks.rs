//! What must hold among the generated tables, from the meaning of their names alone.

use super::arithmetic::*;
use super::block_size::*;
use super::contexts::*;
use super::symbols::*;
use super::tx_size::*;
use super::tx_type::*;
use super::{find_tx_size, fnv1a, tx_class};

fn block_of(width: u8, height: u8) -> u8 {
    (0..BLOCK_INVALID)
        .find(|&size| {
            BLOCK_WIDTH[usize::from(size)] == width && BLOCK_HEIGHT[usize::from(size)] == height
        })
        .unwrap_or(BLOCK_INVALID)
}

fn tx_sides(tx_size: u8) -> (usize, usize) {
    (
        TX_WIDTH[usize::from(tx_size)].into(),
        TX_HEIGHT[usize::from(tx_size)].into(),
    )
}

#[test]
fn block_sides_agree_in_samples_in_units_and_in_logarithms() {
    for size in 0..BLOCK_SIZES {
        assert_eq!(BLOCK_WIDTH[size], 4 * NUM_4X4_BLOCKS_WIDE[size]);
        assert_eq!(BLOCK_HEIGHT[size], 4 * NUM_4X4_BLOCKS_HIGH[size]);
        assert_eq!(NUM_4X4_BLOCKS_WIDE[size], 1 << MI_WIDTH_LOG2[size]);
        assert_eq!(NUM_4X4_BLOCKS_HIGH[size], 1 << MI_HEIGHT_LOG2[size]);
    }
    assert_eq!(block_of(64, 16), BLOCK_64X16);
    assert_eq!(block_of(8, 16), BLOCK_8X16);
}

#[test]
fn a_partition_divides_the_sides_it_names() {
    for (size, side) in [
        (BLOCK_8X8, 8),
        (BLOCK_16X16, 16),
        (BLOCK_64X64, 64),
        (BLOCK_128X128, 128),
    ] {
        let subsize = |partition: u8| PARTITION_SUBSIZE[usize::from(partition)][usize::from(size)];
        assert_eq!(subsize(PARTITION_NONE), size);
        assert_eq!(subsize(PARTITION_SPLIT), block_of(side / 2, side / 2));
        for partition in [PARTITION_HORZ, PARTITION_HORZ_A, PARTITION_HORZ_B] {
            assert_eq!(subsize(partition), block_of(side, side / 2));
        }
        for partition in [PARTITION_VERT, PARTITION_VERT_A, PARTITION_VERT_B] {
            assert_eq!(subsize(partition), block_of(side / 2, side));
        }
        let four = size != BLOCK_8X8 && size != BLOCK_128X128;
        let (flat, upright) = (block_of(side, side / 4), block_of(side / 4, side));
        assert_eq!(
            subsize(PARTITION_HORZ_4),
            if four { flat } else { BLOCK_INVALID }
        );
        assert_eq!(
            subsize(PARTITION_VERT_4),
            if four { upright } else { BLOCK_INVALID }
        );
    }
}

#[test]
fn a_subsampled_block_has_half_the_sides_but_never_less_than_four() {
    for size in 0..BLOCK_SIZES {
        let (width, height) = (BLOCK_WIDTH[size], BLOCK_HEIGHT[size]);
        assert_eq!(SUBSAMPLED_SIZE[size][0][0], block_of(width, height));
        assert_eq!(
            SUBSAMPLED_SIZE[size][1][1],
            block_of((width / 2).max(4), (height / 2).max(4))
        );
        if width >= height && size != usize::from(BLOCK_4X4) {
            assert_eq!(
                SUBSAMPLED_SIZE[size][1][0],
                block_of(width / 2, height.max(4))
            );
        }
    }
}

#[test]
fn the_largest_transform_covers_its_block_up_to_64_samples() {
    for size in 0..BLOCK_SIZES {
        let side = |samples: u8| usize::from(samples.min(64));
        let largest = MAX_TX_SIZE_RECT[size];
        assert_eq!(
            tx_sides(largest),
            (side(BLOCK_WIDTH[size]), side(BLOCK_HEIGHT[size]))
        );
        let (mut tx_size, mut depth) = (largest, 0);
        while tx_size != TX_4X4 {
            tx_size = SPLIT_TX_SIZE[usize::from(tx_size)];
            depth += 1;
        }
        assert_eq!(
            MAX_TX_DEPTH[size], depth,
            "splits to 4x4 of block size {size}"
        );
    }
}

#[test]
fn derived_transform_sizes_follow_from_the_sides() {
    for tx_size in 0..TX_SIZES_ALL {
        let (width, height) = (
            usize::from(TX_WIDTH[tx_size]),
            usize::from(TX_HEIGHT[tx_size]),
        );
        assert_eq!(
            (1 << TX_WIDTH_LOG2[tx_size], 1 << TX_HEIGHT_LOG2[tx_size]),
            (width, height)
        );
        assert_eq!(usize::from(find_tx_size(width, height)), tx_size);
        let (short, long) = (width.min(height), width.max(height));
        assert_eq!(TX_SIZE_SQR[tx_size], find_tx_size(short, short));
        assert_eq!(TX_SIZE_SQR_UP[tx_size], find_tx_size(long, long));
        assert_eq!(
            tx_sides(ADJUSTED_TX_SIZE[tx_size]),
            (width.min(32), height.min(32))
        );
        let (parts_wide, parts_high) = (
            1 + usize::from(width >= height),
            1 + usize::from(height >= width),
        );
        let split = (width / parts_wide, height / parts_high);
        assert_eq!(
            tx_sides(SPLIT_TX_SIZE[tx_size]),
            (split.0.max(4), split.1.max(4))
        );
    }
}

#[test]
fn a_coded_transform_type_runs_through_its_whole_set_once() {
    let members = |set: &[u8]| (0..16).filter(|&t| set[t] == 1).collect::<Vec<_>>();
    let sorted = |inverse: &[u8]| {
        let mut types: Vec<usize> = inverse.iter().map(|&t| t.into()).collect();
        types.sort_unstable();
        types
    };
    assert_eq!(
        sorted(&TX_TYPE_INTRA_INV_SET1),
        members(&TX_TYPE_IN_SET_INTRA[1])
    );
    assert_eq!(
        sorted(&TX_TYPE_INTRA_INV_SET2),
        members(&TX_TYPE_IN_SET_INTRA[2])
    );
    assert_eq!(
        sorted(&TX_TYPE_INTER_INV_SET1),
        members(&TX_TYPE_IN_SET_INTER[1])
    );
    assert_eq!(
        sorted(&TX_TYPE_INTER_INV_SET2),
        members(&TX_TYPE_IN_SET_INTER[2])
    );
    assert_eq!(
        sorted(&TX_TYPE_INTER_INV_SET3),
        members(&TX_TYPE_IN_SET_INTER[3])
    );
    assert_eq!(
        (tx_class(V_FLIPADST), tx_class(H_DCT)),
        (TX_CLASS_VERT, TX_CLASS_HORIZ)
    );
    assert_eq!(
        (tx_class(IDTX), tx_class(ADST_DCT)),
        (TX_CLASS_2D, TX_CLASS_2D)
    );
}

#[test]
fn the_base_context_offset_depends_on_the_shape_and_the_diagonal() {
    for tx_size in 0..TX_SIZES_ALL {
        let (width, height) = (TX_WIDTH[tx_size], TX_HEIGHT[tx_size]);
        let offsets = &COEFF_BASE_CTX_OFFSET[tx_size];
        for (row, offsets) in offsets.iter().take(height.into()).enumerate() {
            for (column, &offset) in offsets.iter().take(width.into()).enumerate() {
                let expected = match row + column {
                    0 => 0,
                    _ if height > width && row < 2 => 11,
                    _ if width > height && column < 2 => 16,
                    1 => 1,
                    2 | 3 => 6,
                    _ => 21,
                };
                assert_eq!(
                    offset, expected,
                    "transform {tx_size}, row {row}, column {column}"
                );
            }
        }
    }
}

#[test]
fn the_reciprocals_are_those_of_their_index() {
    for (den, &reciprocal) in DIV_MULT.iter().enumerate().skip(1) {
        assert_eq!(usize::from(reciprocal), (1 << 14) / den);
    }
    for (index, &reciprocal) in DIV_LUT.iter().enumerate() {
        let divisor = 256 + index;
        assert_eq!(usize::from(reciprocal), ((1 << 22) + divisor / 2) / divisor);
    }
}

// Computed by another program from the printed tables that no rule above describes.
#[test]
fn the_tables_without_a_rule_are_the_printed_ones() {
    let mut numbers = Vec::new();
    let mut add = |table: &[u8]| numbers.extend(table.iter().map(|&number| u16::from(number)));
    add(&SIZE_GROUP);
    add(&WEDGE_BITS);
    add(&MODE_TO_TXFM);
    for set in [&TX_TYPE_INTRA_INV_SET1[..], &TX_TYPE_INTRA_INV_SET2] {
        add(set);
    }
    for set in [
        &TX_TYPE_INTER_INV_SET1[..],
        &TX_TYPE_INTER_INV_SET2,
        &TX_TYPE_INTER_INV_SET3,
    ] {
        add(set);
    }
    add(&INTRA_MODE_CONTEXT);
    add(COMPOUND_MODE_CTX_MAP.as_flattened());
    add(&FILTER_INTRA_MODE_TO_INTRA_DIR);
    add(SIG_REF_DIFF_OFFSET.as_flattened().as_flattened());
    add(&COEFF_BASE_POS_CTX_OFFSET);
    add(MAG_REF_OFFSET_WITH_TX_CLASS.as_flattened().as_flattened());
    add(&PALETTE_COLOR_CONTEXT);
    add(&PALETTE_COLOR_HASH_MULTIPLIERS);
    assert_eq!(numbers.len(), 196);
    assert_eq!(fnv1a(numbers), 0xf6eb_c048_0f4a_baf7);
}
