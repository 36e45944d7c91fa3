//! §3, §6.10 Named constants of the specification, grouped by meaning. The inter modes are printed
//! as 14 to 25, leaving 13 to `UV_CFL_PRED`; nothing computes with their distance from the intra
//! modes, and here they count from 13, as decoders print them.
//!
//! Generated from the AV1 specification by `tools/generate_tables.py`; do not edit.

/// §6.10.6
pub(crate) const DC_PRED: u8 = 0;
/// §6.10.6
pub(crate) const V_PRED: u8 = 1;
/// §6.10.6
pub(crate) const H_PRED: u8 = 2;
/// §6.10.6
pub(crate) const D45_PRED: u8 = 3;
/// §6.10.6
pub(crate) const D135_PRED: u8 = 4;
/// §6.10.6
pub(crate) const D113_PRED: u8 = 5;
/// §6.10.6
pub(crate) const D157_PRED: u8 = 6;
/// §6.10.6
pub(crate) const D203_PRED: u8 = 7;
/// §6.10.6
pub(crate) const D67_PRED: u8 = 8;
/// §6.10.6
pub(crate) const SMOOTH_PRED: u8 = 9;
/// §6.10.6
pub(crate) const SMOOTH_V_PRED: u8 = 10;
/// §6.10.6
pub(crate) const SMOOTH_H_PRED: u8 = 11;
/// §6.10.6
pub(crate) const PAETH_PRED: u8 = 12;
/// §6.10.6
pub(crate) const UV_CFL_PRED: u8 = 13;

/// §6.10.22
pub(crate) const NEARESTMV: u8 = 13;
/// §6.10.22
pub(crate) const NEARMV: u8 = 14;
/// §6.10.22
pub(crate) const GLOBALMV: u8 = 15;
/// §6.10.22
pub(crate) const NEWMV: u8 = 16;
/// §6.10.22
pub(crate) const NEAREST_NEARESTMV: u8 = 17;
/// §6.10.22
pub(crate) const NEAR_NEARMV: u8 = 18;
/// §6.10.22
pub(crate) const NEAREST_NEWMV: u8 = 19;
/// §6.10.22
pub(crate) const NEW_NEARESTMV: u8 = 20;
/// §6.10.22
pub(crate) const NEAR_NEWMV: u8 = 21;
/// §6.10.22
pub(crate) const NEW_NEARMV: u8 = 22;
/// §6.10.22
pub(crate) const GLOBAL_GLOBALMV: u8 = 23;
/// §6.10.22
pub(crate) const NEW_NEWMV: u8 = 24;

/// §6.10.23
pub(crate) const FILTER_DC_PRED: u8 = 0;
/// §6.10.23
pub(crate) const FILTER_V_PRED: u8 = 1;
/// §6.10.23
pub(crate) const FILTER_H_PRED: u8 = 2;
/// §6.10.23
pub(crate) const FILTER_D157_PRED: u8 = 3;
/// §6.10.23
pub(crate) const FILTER_PAETH_PRED: u8 = 4;

/// §6.10.27
pub(crate) const II_DC_PRED: u8 = 0;
/// §6.10.27
pub(crate) const II_V_PRED: u8 = 1;
/// §6.10.27
pub(crate) const II_H_PRED: u8 = 2;
/// §6.10.27
pub(crate) const II_SMOOTH_PRED: u8 = 3;

/// §3
pub(crate) const SIMPLE: u8 = 0;
/// §3
pub(crate) const OBMC: u8 = 1;
/// §3
pub(crate) const LOCALWARP: u8 = 2;

/// §6.10.28
pub(crate) const COMPOUND_WEDGE: u8 = 0;
/// §6.10.28
pub(crate) const COMPOUND_DIFFWTD: u8 = 1;
/// §6.10.28
pub(crate) const COMPOUND_AVERAGE: u8 = 2;
/// §6.10.28
pub(crate) const COMPOUND_INTRA: u8 = 3;
/// §6.10.28
pub(crate) const COMPOUND_DISTANCE: u8 = 4;

/// §6.8.9
pub(crate) const EIGHTTAP: u8 = 0;
/// §6.8.9
pub(crate) const EIGHTTAP_SMOOTH: u8 = 1;
/// §6.8.9
pub(crate) const EIGHTTAP_SHARP: u8 = 2;
/// §6.8.9
pub(crate) const BILINEAR: u8 = 3;
/// §6.8.9
pub(crate) const SWITCHABLE: u8 = 4;

/// §6.10.24
pub(crate) const NONE: i8 = -1;
/// §6.10.24
pub(crate) const INTRA_FRAME: i8 = 0;
/// §6.10.24
pub(crate) const LAST_FRAME: i8 = 1;
/// §6.10.24
pub(crate) const LAST2_FRAME: i8 = 2;
/// §6.10.24
pub(crate) const LAST3_FRAME: i8 = 3;
/// §6.10.24
pub(crate) const GOLDEN_FRAME: i8 = 4;
/// §6.10.24
pub(crate) const BWDREF_FRAME: i8 = 5;
/// §6.10.24
pub(crate) const ALTREF2_FRAME: i8 = 6;
/// §6.10.24
pub(crate) const ALTREF_FRAME: i8 = 7;

/// §6.10.24
pub(crate) const SINGLE_REFERENCE: u8 = 0;
/// §6.10.24
pub(crate) const COMPOUND_REFERENCE: u8 = 1;
/// §6.10.24
pub(crate) const UNIDIR_COMP_REFERENCE: u8 = 0;
/// §6.10.24
pub(crate) const BIDIR_COMP_REFERENCE: u8 = 1;

/// §6.10.29
pub(crate) const MV_JOINT_ZERO: u8 = 0;
/// §6.10.29
pub(crate) const MV_JOINT_HNZVZ: u8 = 1;
/// §6.10.29
pub(crate) const MV_JOINT_HZVNZ: u8 = 2;
/// §6.10.29
pub(crate) const MV_JOINT_HNZVNZ: u8 = 3;

/// §6.10.36
pub(crate) const CFL_SIGN_ZERO: u8 = 0;
/// §6.10.36
pub(crate) const CFL_SIGN_NEG: u8 = 1;
/// §6.10.36
pub(crate) const CFL_SIGN_POS: u8 = 2;

/// §6.10.15
pub(crate) const RESTORE_NONE: u8 = 0;
/// §6.10.15
pub(crate) const RESTORE_WIENER: u8 = 1;
/// §6.10.15
pub(crate) const RESTORE_SGRPROJ: u8 = 2;
/// §6.10.15
pub(crate) const RESTORE_SWITCHABLE: u8 = 3;

/// §6.10.19
pub(crate) const TX_SET_DCTONLY: u8 = 0;
/// §6.10.19
pub(crate) const TX_SET_INTRA_1: u8 = 1;
/// §6.10.19
pub(crate) const TX_SET_INTRA_2: u8 = 2;
/// §6.10.19
pub(crate) const TX_SET_INTER_1: u8 = 1;
/// §6.10.19
pub(crate) const TX_SET_INTER_2: u8 = 2;
/// §6.10.19
pub(crate) const TX_SET_INTER_3: u8 = 3;

/// §3
pub(crate) const DCT_DCT: u8 = 0;
/// §3
pub(crate) const ADST_DCT: u8 = 1;
/// §3
pub(crate) const DCT_ADST: u8 = 2;
/// §3
pub(crate) const ADST_ADST: u8 = 3;
/// §3
pub(crate) const FLIPADST_DCT: u8 = 4;
/// §3
pub(crate) const DCT_FLIPADST: u8 = 5;
/// §3
pub(crate) const FLIPADST_FLIPADST: u8 = 6;
/// §3
pub(crate) const ADST_FLIPADST: u8 = 7;
/// §3
pub(crate) const FLIPADST_ADST: u8 = 8;
/// §3
pub(crate) const IDTX: u8 = 9;
/// §3
pub(crate) const V_DCT: u8 = 10;
/// §3
pub(crate) const H_DCT: u8 = 11;
/// §3
pub(crate) const V_ADST: u8 = 12;
/// §3
pub(crate) const H_ADST: u8 = 13;
/// §3
pub(crate) const V_FLIPADST: u8 = 14;
/// §3
pub(crate) const H_FLIPADST: u8 = 15;

/// §3
pub(crate) const TX_CLASS_2D: u8 = 0;
/// §3
pub(crate) const TX_CLASS_HORIZ: u8 = 1;
/// §3
pub(crate) const TX_CLASS_VERT: u8 = 2;

/// §3
pub(crate) const IDENTITY: u8 = 0;
/// §3
pub(crate) const TRANSLATION: u8 = 1;
/// §3
pub(crate) const ROTZOOM: u8 = 2;
/// §3
pub(crate) const AFFINE: u8 = 3;

/// §3
pub(crate) const PRIMARY_REF_NONE: u8 = 7;
/// §3
pub(crate) const MAX_ANGLE_DELTA: u8 = 3;
/// §3
pub(crate) const DELTA_Q_SMALL: u8 = 3;
/// §3
pub(crate) const DELTA_LF_SMALL: u8 = 3;
/// §3
pub(crate) const MAX_LOOP_FILTER: u8 = 63;

/// §3
pub(crate) const MAX_VARTX_DEPTH: u8 = 2;
/// §3
pub(crate) const MI_SIZE: u8 = 4;
/// §3
pub(crate) const MI_SIZE_LOG2: u8 = 2;

/// §3
pub(crate) const REFS_PER_FRAME: usize = 7;
/// §3
pub(crate) const TOTAL_REFS_PER_FRAME: usize = 8;
/// §3
pub(crate) const NUM_REF_FRAMES: usize = 8;

/// §3
pub(crate) const MAX_SEGMENTS: usize = 8;
/// §3
pub(crate) const SEG_LVL_ALT_Q: usize = 0;
/// §3
pub(crate) const SEG_LVL_ALT_LF_Y_V: usize = 1;
/// §3
pub(crate) const SEG_LVL_REF_FRAME: usize = 5;
/// §3
pub(crate) const SEG_LVL_SKIP: usize = 6;
/// §3
pub(crate) const SEG_LVL_GLOBALMV: usize = 7;
/// §3
pub(crate) const SEG_LVL_MAX: usize = 8;
/// §3
pub(crate) const FRAME_LF_COUNT: usize = 4;

/// §3
pub(crate) const MV_CONTEXTS: usize = 2;
/// §3
pub(crate) const MV_INTRABC_CONTEXT: usize = 1;
/// §3
pub(crate) const COMP_NEWMV_CTXS: usize = 5;
/// §3
pub(crate) const MAX_REF_MV_STACK_SIZE: usize = 8;
/// §3
pub(crate) const MFMV_STACK_SIZE: usize = 3;

/// §3
pub(crate) const LEAST_SQUARES_SAMPLES_MAX: usize = 8;
/// §3
pub(crate) const PALETTE_COLORS: usize = 8;
/// §3
pub(crate) const PALETTE_NUM_NEIGHBORS: usize = 3;

/// §3
pub(crate) const TX_TYPES: usize = 16;
/// §3
pub(crate) const INTRA_MODES: usize = 13;
/// §3
pub(crate) const TX_SET_TYPES_INTRA: usize = 3;
/// §3
pub(crate) const TX_SET_TYPES_INTER: usize = 4;

/// §3
pub(crate) const SIG_COEF_CONTEXTS_EOB: usize = 4;
/// §3
pub(crate) const SIG_COEF_CONTEXTS_2D: usize = 26;
/// §3
pub(crate) const SIG_COEF_CONTEXTS: usize = 42;
/// §3
pub(crate) const SIG_REF_DIFF_OFFSET_NUM: usize = 5;
/// §3
pub(crate) const BR_CDF_SIZE: usize = 4;
/// §3
pub(crate) const COEFF_CDF_Q_CTXS: usize = 4;

/// §3
pub(crate) const NUM_BASE_LEVELS: u32 = 2;
/// §3
pub(crate) const COEFF_BASE_RANGE: u32 = 12;
/// §3
pub(crate) const EC_PROB_SHIFT: u32 = 6;
/// §3
pub(crate) const EC_MIN_PROB: u32 = 4;
/// §3
pub(crate) const REF_CAT_LEVEL: u32 = 640;
/// §3
pub(crate) const SUPERRES_NUM: u32 = 8;

/// §3
pub(crate) const SGRPROJ_PARAMS_BITS: u32 = 4;
/// §3
pub(crate) const SGRPROJ_PRJ_SUBEXP_K: u32 = 4;
/// §3
pub(crate) const SGRPROJ_PRJ_BITS: u32 = 7;
/// §3
pub(crate) const RESTORATION_TILESIZE_MAX: u32 = 256;

/// §3
pub(crate) const MV_BORDER: i32 = 128;
/// §3
pub(crate) const REFMVS_LIMIT: i32 = 4_095;
/// §3
pub(crate) const MAX_FRAME_DISTANCE: i32 = 31;
/// §3
pub(crate) const MAX_OFFSET_WIDTH: i32 = 8;
/// §3
pub(crate) const MAX_OFFSET_HEIGHT: i32 = 0;

/// §3
pub(crate) const INTRABC_DELAY_PIXELS: i32 = 256;
/// §3
pub(crate) const INTRABC_DELAY_SB64: i32 = 4;
/// §3
pub(crate) const LS_MV_MAX: i32 = 256;
/// §3
pub(crate) const WARPEDMODEL_PREC_BITS: i32 = 16;

/// §3
pub(crate) const WARPEDMODEL_TRANS_CLAMP: i32 = 8_388_608;
/// §3
pub(crate) const WARPEDMODEL_NONDIAGAFFINE_CLAMP: i32 = 8_192;
/// §3
pub(crate) const WARP_PARAM_REDUCE_BITS: i32 = 6;

/// §3
pub(crate) const DIV_LUT_BITS: i32 = 8;
/// §3
pub(crate) const DIV_LUT_PREC_BITS: i32 = 14;
/// §3
pub(crate) const DIV_LUT_NUM: i32 = 257;
