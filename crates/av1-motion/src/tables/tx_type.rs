//! §5.11.40, §5.11.47, §9.3 Which transform types a mode implies and a set contains.
//!
//! Generated from the AV1 specification by `tools/generate_tables.py`; do not edit.

#[rustfmt::skip]
use super::symbols::{
    ADST_ADST, ADST_DCT, ADST_FLIPADST, DCT_ADST, DCT_DCT, DCT_FLIPADST, FLIPADST_ADST,
    FLIPADST_DCT, FLIPADST_FLIPADST, H_ADST, H_DCT, H_FLIPADST, IDTX, V_ADST, V_DCT, V_FLIPADST,
};

/// §9.3 `Mode_To_Txfm`
#[rustfmt::skip]
pub(crate) const MODE_TO_TXFM: [u8; 14] = [
    DCT_DCT, ADST_DCT, DCT_ADST, DCT_DCT, ADST_ADST, ADST_DCT, DCT_ADST, DCT_ADST, ADST_DCT,
    ADST_ADST, ADST_DCT, DCT_ADST, ADST_ADST, DCT_DCT,
];

/// §5.11.40 `Tx_Type_In_Set_Intra`
#[rustfmt::skip]
pub(crate) const TX_TYPE_IN_SET_INTRA: [[u8; 16]; 3] = [
    [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [1, 1, 1, 1, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0],
    [1, 1, 1, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0],
];

/// §5.11.40 `Tx_Type_In_Set_Inter`
#[rustfmt::skip]
pub(crate) const TX_TYPE_IN_SET_INTER: [[u8; 16]; 4] = [
    [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1],
    [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0],
    [1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0],
];

/// §5.11.47 `Tx_Type_Intra_Inv_Set1`
#[rustfmt::skip]
pub(crate) const TX_TYPE_INTRA_INV_SET1: [u8; 7] =
    [IDTX, DCT_DCT, V_DCT, H_DCT, ADST_ADST, ADST_DCT, DCT_ADST];

/// §5.11.47 `Tx_Type_Intra_Inv_Set2`
#[rustfmt::skip]
pub(crate) const TX_TYPE_INTRA_INV_SET2: [u8; 5] = [IDTX, DCT_DCT, ADST_ADST, ADST_DCT, DCT_ADST];

/// §5.11.47 `Tx_Type_Inter_Inv_Set1`
#[rustfmt::skip]
pub(crate) const TX_TYPE_INTER_INV_SET1: [u8; 16] = [
    IDTX, V_DCT, H_DCT, V_ADST, H_ADST, V_FLIPADST, H_FLIPADST, DCT_DCT, ADST_DCT, DCT_ADST,
    FLIPADST_DCT, DCT_FLIPADST, ADST_ADST, FLIPADST_FLIPADST, ADST_FLIPADST, FLIPADST_ADST,
];

/// §5.11.47 `Tx_Type_Inter_Inv_Set2`
#[rustfmt::skip]
pub(crate) const TX_TYPE_INTER_INV_SET2: [u8; 12] = [
    IDTX, V_DCT, H_DCT, DCT_DCT, ADST_DCT, DCT_ADST, FLIPADST_DCT, DCT_FLIPADST, ADST_ADST,
    FLIPADST_FLIPADST, ADST_FLIPADST, FLIPADST_ADST,
];

/// §5.11.47 `Tx_Type_Inter_Inv_Set3`
#[rustfmt::skip]
pub(crate) const TX_TYPE_INTER_INV_SET3: [u8; 2] = [IDTX, DCT_DCT];
