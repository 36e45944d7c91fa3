//! §8.2.2, §8.3.1 All adaptive distributions of a frame or tile, as one value that is copied.
//!
//! The specification copies sets by name: defaults to current, current to "Tile", "Tile" to
//! "Saved", and both ways between current and a reference slot. Here each of these is a `clone`.

#[allow(clippy::wildcard_imports, reason = "one name per alphabet size")]
use super::cdf::*;
#[allow(
    clippy::wildcard_imports,
    reason = "one name per CDF array of the specification"
)]
use crate::tables::{default_cdfs::*, default_coef_cdfs::*};

/// Declares a struct of distributions together with its defaults, so that neither the defaults nor
/// the walk over the fields can miss one.
macro_rules! cdf_struct {
    (
        $(#[$meta:meta])*
        $name:ident, $defaults:ident($($argument:ident: $argument_type:ty)?);
        $($(#[$doc:meta])* $field:ident: $type:ty = $default:expr,)*
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, Eq)]
        pub(crate) struct $name {
            $($(#[$doc])* pub(crate) $field: $type,)*
        }

        impl $name {
            const fn $defaults($($argument: $argument_type)?) -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl ResetCounters for $name {
            fn reset_counters(&mut self) {
                $(self.$field.reset_counters();)*
            }
        }

        #[cfg(test)]
        impl VisitCdfs for $name {
            fn visit_cdfs(&mut self, visit: &mut dyn FnMut(usize, &mut [u16])) {
                $(self.$field.visit_cdfs(visit);)*
            }
        }
    };
}

cdf_struct! {
    /// §8.3.1: one field per CDF array, named after it (`TileYModeCdf` is `y_mode`), indexed as
    /// there.
    CdfSet, with_coefficients(coefficients: CoefCdfs);
    /// `[abovemode][leftmode]`; never travels between frames, as intra frames start from defaults.
    intra_frame_y_mode: [[Cdf13; 5]; 5] = rows2(DEFAULT_INTRA_FRAME_Y_MODE_CDF),
    y_mode: [Cdf13; 4] = rows(DEFAULT_Y_MODE_CDF),
    uv_mode_cfl_not_allowed: [Cdf13; 13] = rows(DEFAULT_UV_MODE_CFL_NOT_ALLOWED_CDF),
    uv_mode_cfl_allowed: [Cdf14; 13] = rows(DEFAULT_UV_MODE_CFL_ALLOWED_CDF),
    angle_delta: [Cdf7; 8] = rows(DEFAULT_ANGLE_DELTA_CDF),
    intrabc: Cdf2 = Cdf::from_spec(DEFAULT_INTRABC_CDF),
    partition_w8: [Cdf4; 4] = rows(DEFAULT_PARTITION_W8_CDF),
    partition_w16: [Cdf10; 4] = rows(DEFAULT_PARTITION_W16_CDF),
    partition_w32: [Cdf10; 4] = rows(DEFAULT_PARTITION_W32_CDF),
    partition_w64: [Cdf10; 4] = rows(DEFAULT_PARTITION_W64_CDF),
    partition_w128: [Cdf8; 4] = rows(DEFAULT_PARTITION_W128_CDF),
    segment_id: [Cdf8; 3] = rows(DEFAULT_SEGMENT_ID_CDF),
    segment_id_predicted: [Cdf2; 3] = rows(DEFAULT_SEGMENT_ID_PREDICTED_CDF),
    tx_8x8: [Cdf2; 3] = rows(DEFAULT_TX_8X8_CDF),
    tx_16x16: [Cdf3; 3] = rows(DEFAULT_TX_16X16_CDF),
    tx_32x32: [Cdf3; 3] = rows(DEFAULT_TX_32X32_CDF),
    tx_64x64: [Cdf3; 3] = rows(DEFAULT_TX_64X64_CDF),
    txfm_split: [Cdf2; 21] = rows(DEFAULT_TXFM_SPLIT_CDF),
    filter_intra_mode: Cdf5 = Cdf::from_spec(DEFAULT_FILTER_INTRA_MODE_CDF),
    filter_intra: [Cdf2; 22] = rows(DEFAULT_FILTER_INTRA_CDF),
    interp_filter: [Cdf3; 16] = rows(DEFAULT_INTERP_FILTER_CDF),
    motion_mode: [Cdf3; 22] = rows(DEFAULT_MOTION_MODE_CDF),
    new_mv: [Cdf2; 6] = rows(DEFAULT_NEW_MV_CDF),
    zero_mv: [Cdf2; 2] = rows(DEFAULT_ZERO_MV_CDF),
    ref_mv: [Cdf2; 6] = rows(DEFAULT_REF_MV_CDF),
    compound_mode: [Cdf8; 8] = rows(DEFAULT_COMPOUND_MODE_CDF),
    drl_mode: [Cdf2; 3] = rows(DEFAULT_DRL_MODE_CDF),
    is_inter: [Cdf2; 4] = rows(DEFAULT_IS_INTER_CDF),
    comp_mode: [Cdf2; 5] = rows(DEFAULT_COMP_MODE_CDF),
    skip_mode: [Cdf2; 3] = rows(DEFAULT_SKIP_MODE_CDF),
    skip: [Cdf2; 3] = rows(DEFAULT_SKIP_CDF),
    /// `[ctx][n]` of `comp_ref_p{n}`.
    comp_ref: [[Cdf2; 3]; 3] = rows2(DEFAULT_COMP_REF_CDF),
    /// `[ctx][n]` of `comp_bwdref_p{n}`.
    comp_bwd_ref: [[Cdf2; 2]; 3] = rows2(DEFAULT_COMP_BWD_REF_CDF),
    /// `[ctx][n - 1]` of `single_ref_p{n}`.
    single_ref: [[Cdf2; 6]; 3] = rows2(DEFAULT_SINGLE_REF_CDF),
    /// `[MvCtx]`
    mv: [MvCdfs; 2] = [MvCdfs::defaults(), MvCdfs::defaults()],
    /// `[bsizeCtx][ctx]` of `has_palette_y`.
    palette_y_mode: [[Cdf2; 3]; 7] = rows2(DEFAULT_PALETTE_Y_MODE_CDF),
    palette_uv_mode: [Cdf2; 2] = rows(DEFAULT_PALETTE_UV_MODE_CDF),
    palette_y_size: [Cdf7; 7] = rows(DEFAULT_PALETTE_Y_SIZE_CDF),
    palette_uv_size: [Cdf7; 7] = rows(DEFAULT_PALETTE_UV_SIZE_CDF),
    palette_size_2_y_color: [Cdf2; 5] = rows(DEFAULT_PALETTE_SIZE_2_Y_COLOR_CDF),
    palette_size_2_uv_color: [Cdf2; 5] = rows(DEFAULT_PALETTE_SIZE_2_UV_COLOR_CDF),
    palette_size_3_y_color: [Cdf3; 5] = rows(DEFAULT_PALETTE_SIZE_3_Y_COLOR_CDF),
    palette_size_3_uv_color: [Cdf3; 5] = rows(DEFAULT_PALETTE_SIZE_3_UV_COLOR_CDF),
    palette_size_4_y_color: [Cdf4; 5] = rows(DEFAULT_PALETTE_SIZE_4_Y_COLOR_CDF),
    palette_size_4_uv_color: [Cdf4; 5] = rows(DEFAULT_PALETTE_SIZE_4_UV_COLOR_CDF),
    palette_size_5_y_color: [Cdf5; 5] = rows(DEFAULT_PALETTE_SIZE_5_Y_COLOR_CDF),
    palette_size_5_uv_color: [Cdf5; 5] = rows(DEFAULT_PALETTE_SIZE_5_UV_COLOR_CDF),
    palette_size_6_y_color: [Cdf6; 5] = rows(DEFAULT_PALETTE_SIZE_6_Y_COLOR_CDF),
    palette_size_6_uv_color: [Cdf6; 5] = rows(DEFAULT_PALETTE_SIZE_6_UV_COLOR_CDF),
    palette_size_7_y_color: [Cdf7; 5] = rows(DEFAULT_PALETTE_SIZE_7_Y_COLOR_CDF),
    palette_size_7_uv_color: [Cdf7; 5] = rows(DEFAULT_PALETTE_SIZE_7_UV_COLOR_CDF),
    palette_size_8_y_color: [Cdf8; 5] = rows(DEFAULT_PALETTE_SIZE_8_Y_COLOR_CDF),
    palette_size_8_uv_color: [Cdf8; 5] = rows(DEFAULT_PALETTE_SIZE_8_UV_COLOR_CDF),
    delta_q: Cdf4 = Cdf::from_spec(DEFAULT_DELTA_Q_CDF),
    delta_lf: Cdf4 = Cdf::from_spec(DEFAULT_DELTA_LF_CDF),
    delta_lf_multi: [Cdf4; 4] = [Cdf::from_spec(DEFAULT_DELTA_LF_CDF); 4],
    /// `[Tx_Size_Sqr][intraDir]`
    intra_tx_type_set1: [[Cdf7; 13]; 2] = rows2(DEFAULT_INTRA_TX_TYPE_SET1_CDF),
    /// `[Tx_Size_Sqr][intraDir]`
    intra_tx_type_set2: [[Cdf5; 13]; 3] = rows2(DEFAULT_INTRA_TX_TYPE_SET2_CDF),
    /// `[Tx_Size_Sqr]`
    inter_tx_type_set1: [Cdf16; 2] = rows(DEFAULT_INTER_TX_TYPE_SET1_CDF),
    inter_tx_type_set2: Cdf12 = Cdf::from_spec(DEFAULT_INTER_TX_TYPE_SET2_CDF),
    /// `[Tx_Size_Sqr]`
    inter_tx_type_set3: [Cdf2; 4] = rows(DEFAULT_INTER_TX_TYPE_SET3_CDF),
    use_obmc: [Cdf2; 22] = rows(DEFAULT_USE_OBMC_CDF),
    interintra: [Cdf2; 3] = rows(DEFAULT_INTER_INTRA_CDF),
    comp_ref_type: [Cdf2; 5] = rows(DEFAULT_COMP_REF_TYPE_CDF),
    cfl_sign: Cdf8 = Cdf::from_spec(DEFAULT_CFL_SIGN_CDF),
    /// `[ctx][n]` of `uni_comp_ref_p{n}`.
    uni_comp_ref: [[Cdf2; 3]; 3] = rows2(DEFAULT_UNI_COMP_REF_CDF),
    wedge_interintra: [Cdf2; 22] = rows(DEFAULT_WEDGE_INTER_INTRA_CDF),
    comp_group_idx: [Cdf2; 6] = rows(DEFAULT_COMP_GROUP_IDX_CDF),
    compound_idx: [Cdf2; 6] = rows(DEFAULT_COMPOUND_IDX_CDF),
    compound_type: [Cdf2; 22] = rows(DEFAULT_COMPOUND_TYPE_CDF),
    interintra_mode: [Cdf4; 3] = rows(DEFAULT_INTER_INTRA_MODE_CDF),
    wedge_index: [Cdf16; 22] = rows(DEFAULT_WEDGE_INDEX_CDF),
    cfl_alpha: [Cdf16; 6] = rows(DEFAULT_CFL_ALPHA_CDF),
    use_wiener: Cdf2 = Cdf::from_spec(DEFAULT_USE_WIENER_CDF),
    use_sgrproj: Cdf2 = Cdf::from_spec(DEFAULT_USE_SGRPROJ_CDF),
    restoration_type: Cdf3 = Cdf::from_spec(DEFAULT_RESTORATION_TYPE_CDF),
    coef: CoefCdfs = coefficients,
}

cdf_struct! {
    /// §8.3.1: the distributions of one motion vector context.
    MvCdfs, defaults();
    joint: Cdf4 = Cdf::from_spec(DEFAULT_MV_JOINT_CDF),
    /// `[comp]`: 0 is the row, 1 the column.
    components: [MvComponentCdfs; 2] =
        [MvComponentCdfs::defaults(0), MvComponentCdfs::defaults(1)],
}

cdf_struct! {
    /// §8.3.1: the distributions of one motion vector component.
    MvComponentCdfs, defaults(comp: usize);
    sign: Cdf2 = Cdf::from_spec(DEFAULT_MV_SIGN_CDF),
    class: Cdf11 = Cdf::from_spec(DEFAULT_MV_CLASS_CDF[comp]),
    class0_bit: Cdf2 = Cdf::from_spec(DEFAULT_MV_CLASS0_BIT_CDF),
    /// `[mv_class0_bit]`
    class0_fr: [Cdf4; 2] = rows(DEFAULT_MV_CLASS0_FR_CDF[comp]),
    class0_hp: Cdf2 = Cdf::from_spec(DEFAULT_MV_CLASS0_HP_CDF),
    fr: Cdf4 = Cdf::from_spec(DEFAULT_MV_FR_CDF[comp]),
    hp: Cdf2 = Cdf::from_spec(DEFAULT_MV_HP_CDF),
    /// `[i]` of `mv_bit`.
    bits: [Cdf2; 10] = rows(DEFAULT_MV_BIT_CDF),
}

cdf_struct! {
    /// §6.8.2 `init_coeff_cdfs`: the distributions of the `coeffs( )` syntax.
    CoefCdfs, for_class(class: usize);
    /// `[txSzCtx][ctx]` of `all_zero`.
    txb_skip: [[Cdf2; 13]; 5] = rows2(DEFAULT_TXB_SKIP_CDF[class]),
    /// `[ptype][ctx]`
    eob_pt_16: [[Cdf5; 2]; 2] = rows2(DEFAULT_EOB_PT_16_CDF[class]),
    /// `[ptype][ctx]`
    eob_pt_32: [[Cdf6; 2]; 2] = rows2(DEFAULT_EOB_PT_32_CDF[class]),
    /// `[ptype][ctx]`
    eob_pt_64: [[Cdf7; 2]; 2] = rows2(DEFAULT_EOB_PT_64_CDF[class]),
    /// `[ptype][ctx]`
    eob_pt_128: [[Cdf8; 2]; 2] = rows2(DEFAULT_EOB_PT_128_CDF[class]),
    /// `[ptype][ctx]`
    eob_pt_256: [[Cdf9; 2]; 2] = rows2(DEFAULT_EOB_PT_256_CDF[class]),
    /// `[ptype]`
    eob_pt_512: [Cdf10; 2] = rows(DEFAULT_EOB_PT_512_CDF[class]),
    /// `[ptype]`
    eob_pt_1024: [Cdf11; 2] = rows(DEFAULT_EOB_PT_1024_CDF[class]),
    /// `[txSzCtx][ptype][eobPt - 3]`
    eob_extra: [[[Cdf2; 9]; 2]; 5] = rows3(DEFAULT_EOB_EXTRA_CDF[class]),
    /// `[ptype][ctx]`
    dc_sign: [[Cdf2; 3]; 2] = rows2(DEFAULT_DC_SIGN_CDF[class]),
    /// `[txSzCtx][ptype][ctx]`
    coeff_base_eob: [[[Cdf3; 4]; 2]; 5] = rows3(DEFAULT_COEFF_BASE_EOB_CDF[class]),
    /// `[txSzCtx][ptype][ctx]`
    coeff_base: [[[Cdf4; 42]; 2]; 5] = rows3(DEFAULT_COEFF_BASE_CDF[class]),
    /// `[Min(txSzCtx, TX_32X32)][ptype][ctx]`; the fifth size of the printed table is never used.
    coeff_br: [[[Cdf4; 21]; 2]; 5] = rows3(DEFAULT_COEFF_BR_CDF[class]),
}

static COEFFICIENT_DEFAULTS: [CoefCdfs; 4] = [
    CoefCdfs::for_class(0),
    CoefCdfs::for_class(1),
    CoefCdfs::for_class(2),
    CoefCdfs::for_class(3),
];

static DEFAULTS: CdfSet = CdfSet::with_coefficients(CoefCdfs::for_class(0));

impl CdfSet {
    /// §6.8.2 `init_non_coeff_cdfs` and `init_coeff_cdfs`.
    pub(crate) fn defaults(base_q_idx: u8) -> Self {
        let mut cdfs = DEFAULTS.clone();
        cdfs.init_coefficients(base_q_idx);
        cdfs
    }

    /// §6.8.2 `init_coeff_cdfs`: the quantiser of the frame, never of a segment, chooses the class.
    pub(crate) fn init_coefficients(&mut self, base_q_idx: u8) {
        self.coef.clone_from(
            &COEFFICIENT_DEFAULTS[match base_q_idx {
                0..=20 => 0,
                21..=60 => 1,
                61..=120 => 2,
                121..=255 => 3,
            }],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tables::fnv1a;

    fn lanes(cdfs: &mut CdfSet) -> Vec<u16> {
        let mut all = Vec::new();
        cdfs.visit_cdfs(&mut |_, lanes| all.extend_from_slice(lanes));
        all
    }

    // The expected numbers were computed from the specification's text by another program, in the
    // order in which §6.8.2 lists the arrays: a changed digit or two swapped arrays show.
    #[test]
    fn the_defaults_of_each_quantiser_class_are_the_printed_ones() {
        for (base_q_idx, expected) in [
            (0, 0x99e9_4cc6_3505_01e2),
            (20, 0x99e9_4cc6_3505_01e2),
            (21, 0xf46f_e730_9393_c55f),
            (60, 0xf46f_e730_9393_c55f),
            (61, 0x37ba_bf46_5810_35c6),
            (120, 0x37ba_bf46_5810_35c6),
            (121, 0xbe30_fd1c_684c_a9be),
            (255, 0xbe30_fd1c_684c_a9be),
        ] {
            let lanes = lanes(&mut CdfSet::defaults(base_q_idx));
            assert_eq!(lanes.len(), 7032);
            assert_eq!(fnv1a(lanes), expected, "base_q_idx {base_q_idx}");
        }
    }

    #[test]
    fn every_row_falls_strictly_to_its_padding_and_starts_uncounted() {
        let mut rows = 0;
        CdfSet::defaults(100).visit_cdfs(&mut |symbols, lanes| {
            rows += 1;
            let (values, rest) = lanes.split_at(symbols - 1);
            assert!(
                values[0] < 1 << 15 && values.is_sorted_by(|a, b| a > b),
                "{lanes:?}"
            );
            assert!(
                values[symbols - 2] > 0 && rest.iter().all(|&lane| lane == 0),
                "{lanes:?}"
            );
        });
        assert_eq!(rows, 1501);
    }

    #[test]
    fn resetting_the_counters_clears_all_of_them_and_nothing_else() {
        let fresh = CdfSet::defaults(0);
        let mut used = fresh.clone();
        used.visit_cdfs(&mut |_, lanes| *lanes.last_mut().unwrap() = 32);
        assert_ne!(used, fresh);
        used.reset_counters();
        assert_eq!(used, fresh);
    }

    #[test]
    fn new_coefficient_defaults_leave_the_other_distributions_alone() {
        let mut cdfs = CdfSet::defaults(0);
        cdfs.skip[1].0 = [77];
        cdfs.coef.dc_sign[0][0].0 = [77];
        cdfs.init_coefficients(255);
        assert_eq!(cdfs.skip[1].0, [77]);
        assert_eq!(cdfs.coef, CdfSet::defaults(255).coef);
    }
}
