//! §6.10.16 Transform sizes and what follows from them (§9.3).
//!
//! Generated from the AV1 specification by `tools/generate_tables.py`; do not edit.

/// §6.10.16
pub(crate) const TX_4X4: u8 = 0;
/// §6.10.16
pub(crate) const TX_8X8: u8 = 1;
/// §6.10.16
pub(crate) const TX_16X16: u8 = 2;
/// §6.10.16
pub(crate) const TX_32X32: u8 = 3;
/// §6.10.16
pub(crate) const TX_64X64: u8 = 4;
/// §6.10.16
pub(crate) const TX_4X8: u8 = 5;
/// §6.10.16
pub(crate) const TX_8X4: u8 = 6;
/// §6.10.16
pub(crate) const TX_8X16: u8 = 7;
/// §6.10.16
pub(crate) const TX_16X8: u8 = 8;
/// §6.10.16
pub(crate) const TX_16X32: u8 = 9;
/// §6.10.16
pub(crate) const TX_32X16: u8 = 10;
/// §6.10.16
pub(crate) const TX_32X64: u8 = 11;
/// §6.10.16
pub(crate) const TX_64X32: u8 = 12;
/// §6.10.16
pub(crate) const TX_4X16: u8 = 13;
/// §6.10.16
pub(crate) const TX_16X4: u8 = 14;
/// §6.10.16
pub(crate) const TX_8X32: u8 = 15;
/// §6.10.16
pub(crate) const TX_32X8: u8 = 16;
/// §6.10.16
pub(crate) const TX_16X64: u8 = 17;
/// §6.10.16
pub(crate) const TX_64X16: u8 = 18;

/// §3
pub(crate) const TX_SIZES: usize = 5;
/// §3
pub(crate) const TX_SIZES_ALL: usize = 19;

/// §9.3 `Split_Tx_Size`
#[rustfmt::skip]
pub(crate) const SPLIT_TX_SIZE: [u8; 19] = [
    TX_4X4, TX_4X4, TX_8X8, TX_16X16, TX_32X32, TX_4X4, TX_4X4, TX_8X8, TX_8X8, TX_16X16, TX_16X16,
    TX_32X32, TX_32X32, TX_4X8, TX_8X4, TX_8X16, TX_16X8, TX_16X32, TX_32X16,
];

/// §9.3 `Tx_Size_Sqr`
#[rustfmt::skip]
pub(crate) const TX_SIZE_SQR: [u8; 19] = [
    TX_4X4, TX_8X8, TX_16X16, TX_32X32, TX_64X64, TX_4X4, TX_4X4, TX_8X8, TX_8X8, TX_16X16,
    TX_16X16, TX_32X32, TX_32X32, TX_4X4, TX_4X4, TX_8X8, TX_8X8, TX_16X16, TX_16X16,
];

/// §9.3 `Tx_Size_Sqr_Up`
#[rustfmt::skip]
pub(crate) const TX_SIZE_SQR_UP: [u8; 19] = [
    TX_4X4, TX_8X8, TX_16X16, TX_32X32, TX_64X64, TX_8X8, TX_8X8, TX_16X16, TX_16X16, TX_32X32,
    TX_32X32, TX_64X64, TX_64X64, TX_16X16, TX_16X16, TX_32X32, TX_32X32, TX_64X64, TX_64X64,
];

/// §9.3 `Tx_Width`
#[rustfmt::skip]
pub(crate) const TX_WIDTH: [u8; 19] =
    [4, 8, 16, 32, 64, 4, 8, 8, 16, 16, 32, 32, 64, 4, 16, 8, 32, 16, 64];

/// §9.3 `Tx_Height`
#[rustfmt::skip]
pub(crate) const TX_HEIGHT: [u8; 19] =
    [4, 8, 16, 32, 64, 8, 4, 16, 8, 32, 16, 64, 32, 16, 4, 32, 8, 64, 16];

/// §9.3 `Tx_Width_Log2`
#[rustfmt::skip]
pub(crate) const TX_WIDTH_LOG2: [u8; 19] =
    [2, 3, 4, 5, 6, 2, 3, 3, 4, 4, 5, 5, 6, 2, 4, 3, 5, 4, 6];

/// §9.3 `Tx_Height_Log2`
#[rustfmt::skip]
pub(crate) const TX_HEIGHT_LOG2: [u8; 19] =
    [2, 3, 4, 5, 6, 3, 2, 4, 3, 5, 4, 6, 5, 4, 2, 5, 3, 6, 4];

/// §9.3 `Adjusted_Tx_Size`
#[rustfmt::skip]
pub(crate) const ADJUSTED_TX_SIZE: [u8; 19] = [
    TX_4X4, TX_8X8, TX_16X16, TX_32X32, TX_32X32, TX_4X8, TX_8X4, TX_8X16, TX_16X8, TX_16X32,
    TX_32X16, TX_32X32, TX_32X32, TX_4X16, TX_16X4, TX_8X32, TX_32X8, TX_16X32, TX_32X16,
];
