//! §7.11.3.6 Setup shear, §7.11.3.7 Resolve divisor, §7.11.3.8 Warp estimation: the affine models of
//! warped blocks. They are output only: no symbol depends on them.

use crate::mvpred::global;
use crate::mvpred::warp_samples::WarpSamples;
use crate::tables::arithmetic::DIV_LUT;
use crate::tables::symbols::{
    DIV_LUT_BITS, DIV_LUT_PREC_BITS, LS_MV_MAX, WARP_PARAM_REDUCE_BITS,
    WARPEDMODEL_NONDIAGAFFINE_CLAMP, WARPEDMODEL_PREC_BITS, WARPEDMODEL_TRANS_CLAMP,
};
use crate::tile::Block;

/// 1 in the fixed-point format of warp parameters.
const ONE: i64 = 1 << WARPEDMODEL_PREC_BITS;

/// §4.7 `Round2Signed` of a product, wide enough for those of hostile streams.
#[inline]
fn round2_product(value: i64, factor: i64, bits: i32) -> i128 {
    let Some(product) = value.checked_mul(factor) else {
        return round2_signed(i128::from(value) * i128::from(factor), bits);
    };
    if bits <= 0 {
        return product.into();
    }
    // One word is enough nearly always, and much faster.
    let rounded = i128::from((product.unsigned_abs() + (1 << (bits - 1))) >> bits);
    if product < 0 { -rounded } else { rounded }
}

/// §4.7 `Round2Signed`.
fn round2_signed(value: i128, bits: i32) -> i128 {
    if bits <= 0 {
        return value;
    }
    let rounded = (value.abs() + (1 << (bits - 1))) >> bits;
    if value < 0 { -rounded } else { rounded }
}

/// §7.11.3.7 Resolve divisor process: `(divShift, divFactor)`; `d` is not 0.
fn resolve_divisor(d: i64) -> (i32, i64) {
    let magnitude = d.unsigned_abs();
    let n = magnitude.ilog2() as i32;
    let e = magnitude - (1 << n);
    let f = if n > DIV_LUT_BITS {
        let shift = n - DIV_LUT_BITS;
        (e + (1 << (shift - 1))) >> shift
    } else {
        e << (DIV_LUT_BITS - n)
    };
    let factor = i64::from(DIV_LUT[f as usize]);
    (n + DIV_LUT_PREC_BITS, if d < 0 { -factor } else { factor })
}

/// §7.11.3.6 Setup shear process: `warpValid`.
pub(crate) fn is_shear_valid(params: &[i32; 6]) -> bool {
    let params = params.map(i64::from);
    // A model that is not positive along x has no shear; §7.11.3.7 needs a divisor.
    if params[2] <= 0 {
        return false;
    }
    let clip = |value: i128| value.clamp(-32768, 32767) as i64;
    let (shift, factor) = resolve_divisor(params[2]);
    let divide = |value: i64| round2_product(value, factor, shift);
    let reduce = |value: i64| {
        global::round2_signed(value, WARP_PARAM_REDUCE_BITS as u32) << WARP_PARAM_REDUCE_BITS
    };
    let alpha = reduce(clip((params[2] - ONE).into()));
    let beta = reduce(clip(params[3].into()));
    let gamma = reduce(clip(divide(params[4] << WARPEDMODEL_PREC_BITS)));
    let delta = reduce(clip(
        i128::from(params[5] - ONE) - divide(params[3] * params[4]),
    ));
    4 * alpha.abs() + 7 * beta.abs() < ONE && 4 * gamma.abs() + 4 * delta.abs() < ONE
}

/// §7.11.3.8 Warp estimation process: `LocalWarpParams`, or nothing when `LocalValid` is 0.
pub(crate) fn estimate_local_warp(block: &Block, samples: &WarpSamples) -> Option<[i32; 6]> {
    let mid_y = i64::from(block.mi_row) * 4 + block.height4() as i64 * 2 - 1;
    let mid_x = i64::from(block.mi_col) * 4 + block.width4() as i64 * 2 - 1;
    let (mv_y, mv_x) = (i64::from(block.mv[0].row), i64::from(block.mv[0].col));
    let (mut a, mut bx, mut by) = ([[0_i64; 2]; 2], [0_i64; 2], [0_i64; 2]);
    let product = |a: i64, b: i64| ((a * b) >> 2) + (a + b);
    for sample in samples.iter() {
        let sample = sample.map(i64::from);
        let (sy, sx) = (sample[0] - mid_y * 8, sample[1] - mid_x * 8);
        let (dy, dx) = (sample[2] - mid_y * 8 - mv_y, sample[3] - mid_x * 8 - mv_x);
        let limit = i64::from(LS_MV_MAX);
        if (sx - dx).abs() < limit && (sy - dy).abs() < limit {
            a[0][0] += product(sx, sx) + 8;
            a[0][1] += product(sx, sy) + 4;
            a[1][1] += product(sy, sy) + 8;
            bx[0] += product(sx, dx) + 8;
            bx[1] += product(sy, dx) + 4;
            by[0] += product(sx, dy) + 4;
            by[1] += product(sy, dy) + 8;
        }
    }
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[0][1];
    if determinant == 0 {
        return None;
    }
    let (mut shift, mut factor) = resolve_divisor(determinant);
    shift -= WARPEDMODEL_PREC_BITS;
    if shift < 0 {
        factor <<= -shift;
        shift = 0;
    }
    let clamp = i128::from(WARPEDMODEL_NONDIAGAFFINE_CLAMP);
    let divide = |value: i64| round2_product(value, factor, shift);
    let nondiag = |value: i64| divide(value).clamp(-clamp + 1, clamp - 1) as i64;
    let diag = |value: i64| {
        divide(value).clamp(i128::from(ONE) - clamp + 1, i128::from(ONE) + clamp - 1) as i64
    };
    let p2 = diag(a[1][1] * bx[0] - a[0][1] * bx[1]);
    let p3 = nondiag(-a[0][1] * bx[0] + a[0][0] * bx[1]);
    let p4 = nondiag(a[1][1] * by[0] - a[0][1] * by[1]);
    let p5 = diag(-a[0][1] * by[0] + a[0][0] * by[1]);
    let scale = 1 << (WARPEDMODEL_PREC_BITS - 3);
    let vx = mv_x * scale - (mid_x * (p2 - ONE) + mid_y * p3);
    let vy = mv_y * scale - (mid_x * p4 + mid_y * (p5 - ONE));
    let limit = i64::from(WARPEDMODEL_TRANS_CLAMP);
    let translation = |value: i64| value.clamp(-limit, limit - 1);
    Some([translation(vx), translation(vy), p2, p3, p4, p5].map(|value| value as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_word_rounds_a_product_as_two_words_do() {
        let factors = [-16_384, -9000, -1, 0, 1, 3, 8191, 16_384, i64::MAX];
        let values = [
            i64::MIN,
            -(1 << 47) - 1,
            -65,
            -32,
            0,
            31,
            32,
            1 << 49,
            i64::MAX,
        ];
        for (value, factor) in values.iter().flat_map(|&v| factors.map(|f| (v, f))) {
            for bits in [-1, 0, 1, 6, 14, 61] {
                let wide = round2_signed(i128::from(value) * i128::from(factor), bits);
                assert_eq!(round2_product(value, factor, bits), wide);
                if let (Ok(narrow), Ok(bits)) = (i64::try_from(wide >> 2), u32::try_from(bits)) {
                    let narrow = narrow / 4;
                    let expected = round2_signed(narrow.into(), bits as i32);
                    assert_eq!(i128::from(global::round2_signed(narrow, bits)), expected);
                }
            }
        }
    }
}
