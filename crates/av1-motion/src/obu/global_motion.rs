//! §5.9.24 to §5.9.29: one warp model per reference.

use crate::bits::BitReader;
use crate::error::Result;
use crate::tables::symbols::{AFFINE, IDENTITY, ROTZOOM, TRANSLATION};

use super::frame_header::TOTAL_REFS_PER_FRAME;

/// §3 `WARPEDMODEL_PREC_BITS`.
pub(crate) const WARPEDMODEL_PREC_BITS: u32 = 16;
/// §3 `GM_ABS_ALPHA_BITS`.
const GM_ABS_ALPHA_BITS: u32 = 12;
/// §3 `GM_ALPHA_PREC_BITS`.
const GM_ALPHA_PREC_BITS: u32 = 15;
/// §3 `GM_ABS_TRANS_BITS`.
const GM_ABS_TRANS_BITS: u32 = 12;
/// §3 `GM_TRANS_PREC_BITS`.
const GM_TRANS_PREC_BITS: u32 = 6;
/// §3 `GM_ABS_TRANS_ONLY_BITS`.
const GM_ABS_TRANS_ONLY_BITS: u32 = 9;
/// §3 `GM_TRANS_ONLY_PREC_BITS`.
const GM_TRANS_ONLY_PREC_BITS: u32 = 3;

/// `gm_params` by reference name: `[0]`, `[1]` translation, `[2]` to `[5]` matrix, with
/// [`WARPEDMODEL_PREC_BITS`] fractional bits.
pub(crate) type GmParams = [[i32; 6]; TOTAL_REFS_PER_FRAME];

/// §6.8.2 `setup_past_independence`: the identity for every reference.
pub(crate) const DEFAULT_GM_PARAMS: GmParams = [IDENTITY_PARAMS; TOTAL_REFS_PER_FRAME];

const IDENTITY_PARAMS: [i32; 6] = [
    0,
    0,
    1 << WARPEDMODEL_PREC_BITS,
    0,
    0,
    1 << WARPEDMODEL_PREC_BITS,
];

/// §5.9.24 `global_motion_params` of an inter frame. `previous` are the models saved with the
/// primary reference frame.
pub(crate) fn parse_global_motion(
    reader: &mut BitReader<'_>,
    allow_high_precision_mv: bool,
    previous: &GmParams,
) -> Result<([u8; TOTAL_REFS_PER_FRAME], GmParams)> {
    let mut types = [IDENTITY; TOTAL_REFS_PER_FRAME];
    let mut params = DEFAULT_GM_PARAMS;
    for reference in 1..TOTAL_REFS_PER_FRAME {
        types[reference] = read_type(reader)?;
        let mut model = ModelReader {
            model_type: types[reference],
            allow_high_precision_mv,
            previous: &previous[reference],
        };
        params[reference] = model.read(reader)?;
    }
    Ok((types, params))
}

fn read_type(reader: &mut BitReader<'_>) -> Result<u8> {
    let is_global = reader.flag()?;
    if !is_global {
        return Ok(IDENTITY);
    }
    let is_rot_zoom = reader.flag()?;
    if is_rot_zoom {
        return Ok(ROTZOOM);
    }
    let is_translation = reader.flag()?;
    Ok(if is_translation { TRANSLATION } else { AFFINE })
}

struct ModelReader<'p> {
    model_type: u8,
    allow_high_precision_mv: bool,
    previous: &'p [i32; 6],
}

impl ModelReader<'_> {
    fn read(&mut self, reader: &mut BitReader<'_>) -> Result<[i32; 6]> {
        let mut params = IDENTITY_PARAMS;
        if self.model_type >= ROTZOOM {
            params[2] = self.read_param(reader, 2)?;
            params[3] = self.read_param(reader, 3)?;
            if self.model_type == AFFINE {
                params[4] = self.read_param(reader, 4)?;
                params[5] = self.read_param(reader, 5)?;
            } else {
                params[4] = -params[3];
                params[5] = params[2];
            }
        }
        if self.model_type >= TRANSLATION {
            params[0] = self.read_param(reader, 0)?;
            params[1] = self.read_param(reader, 1)?;
        }
        Ok(params)
    }

    /// §5.9.25 `read_global_param`.
    fn read_param(&self, reader: &mut BitReader<'_>, index: usize) -> Result<i32> {
        let (abs_bits, prec_bits) = if index >= 2 {
            (GM_ABS_ALPHA_BITS, GM_ALPHA_PREC_BITS)
        } else if self.model_type == TRANSLATION {
            let coarser = u32::from(!self.allow_high_precision_mv);
            (
                GM_ABS_TRANS_ONLY_BITS - coarser,
                GM_TRANS_ONLY_PREC_BITS - coarser,
            )
        } else {
            (GM_ABS_TRANS_BITS, GM_TRANS_PREC_BITS)
        };
        let prec_diff = WARPEDMODEL_PREC_BITS - prec_bits;
        let is_diagonal = index % 3 == 2;
        let round = i32::from(is_diagonal) << WARPEDMODEL_PREC_BITS;
        let sub = i32::from(is_diagonal) << prec_bits;
        let largest = 1 << abs_bits;
        let reference = (self.previous[index] >> prec_diff) - sub;
        let value = decode_signed_subexp_with_ref(reader, -largest, largest + 1, reference)?;
        Ok((value << prec_diff) + round)
    }
}

/// §5.9.26: a value in `low..high` near `reference`.
fn decode_signed_subexp_with_ref(
    reader: &mut BitReader<'_>,
    low: i32,
    high: i32,
    reference: i32,
) -> Result<i32> {
    Ok(decode_unsigned_subexp_with_ref(reader, high - low, reference - low)? + low)
}

/// §5.9.27: a value in `0..count` near `reference`.
fn decode_unsigned_subexp_with_ref(
    reader: &mut BitReader<'_>,
    count: i32,
    reference: i32,
) -> Result<i32> {
    let value = decode_subexp(reader, count)?;
    Ok(if reference << 1 <= count {
        inverse_recenter(reference, value)
    } else {
        count - 1 - inverse_recenter(count - 1 - reference, value)
    })
}

/// §5.9.28: a value in `0..num_syms`, small ones with few bits.
fn decode_subexp(reader: &mut BitReader<'_>, num_syms: i32) -> Result<i32> {
    const K: u32 = 3;
    let mut minimum = 0;
    let mut bits = K;
    loop {
        let span = 1 << bits;
        if num_syms <= minimum + 3 * span {
            let count = (num_syms - minimum).cast_unsigned();
            let subexp_final_bits = reader.ns(count)?;
            return Ok(subexp_final_bits.cast_signed() + minimum);
        }
        let subexp_more_bits = reader.flag()?;
        if !subexp_more_bits {
            let subexp_bits = reader.f(bits)?;
            return Ok(subexp_bits.cast_signed() + minimum);
        }
        // The first two spans have 2^k values each, every further one twice as many.
        if minimum > 0 {
            bits += 1;
        }
        minimum += span;
    }
}

/// §5.9.29.
fn inverse_recenter(reference: i32, value: i32) -> i32 {
    if value > 2 * reference {
        value
    } else if value & 1 == 1 {
        reference - ((value + 1) >> 1)
    } else {
        reference + (value >> 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recentering_alternates_around_the_reference() {
        let values: Vec<i32> = (0..8).map(|v| inverse_recenter(3, v)).collect();
        assert_eq!(values, [3, 2, 4, 1, 5, 0, 6, 7]);
    }

    #[test]
    fn subexp_codes_grow_with_the_value() {
        // more 0, three bits 101.
        let mut reader = BitReader::new(&[0b0101_0000], 0);
        assert_eq!(decode_subexp(&mut reader, 100).unwrap(), 5);
        assert_eq!(reader.position(), 4);
        // more 1, more 0, three bits 010: second span of 8 starts at 8.
        let mut reader = BitReader::new(&[0b1001_0000], 0);
        assert_eq!(decode_subexp(&mut reader, 100).unwrap(), 10);
        assert_eq!(reader.position(), 5);
        // more 1, more 1, more 0, four bits: third span of 16 starts at 16.
        let mut reader = BitReader::new(&[0b1100_0110], 0);
        assert_eq!(decode_subexp(&mut reader, 100).unwrap(), 19);
        assert_eq!(reader.position(), 7);
        // 20 values: 20 <= 0 + 24, so they are final bits at once; ns(20) of 1111 1 is 19.
        let mut reader = BitReader::new(&[0b1111_1000], 0);
        assert_eq!(decode_subexp(&mut reader, 20).unwrap(), 19);
        assert_eq!(reader.position(), 5);
    }

    #[test]
    fn every_code_decodes_into_its_range() {
        for reference in [-4096, -1, 0, 1, 4096] {
            for first in 0..=255 {
                let bits = [first, 0x5a, 0xc3, 0xff];
                let mut reader = BitReader::new(&bits, 0);
                let value =
                    decode_signed_subexp_with_ref(&mut reader, -4096, 4097, reference).unwrap();
                assert!((-4096..=4096).contains(&value), "{reference} {first}");
            }
        }
    }

    #[test]
    fn a_zero_difference_repeats_the_previous_model() {
        // is_global 1, is_rot_zoom 1; four parameters of five zero bits... each 0 + 000.
        let mut previous = DEFAULT_GM_PARAMS;
        previous[1] = [7 << 10, -(5 << 10), (1 << 16) + 6, -8, 8, (1 << 16) + 6];
        let bits = [0b1100_0000, 0, 0, 0, 0];
        let mut reader = BitReader::new(&bits, 0);
        let (types, params) = parse_global_motion(&mut reader, true, &previous).unwrap();
        assert_eq!(types[1], ROTZOOM);
        assert_eq!(params[1], previous[1]);
        assert_eq!(params[2], DEFAULT_GM_PARAMS[2]);
        assert_eq!(reader.position(), 2 + 4 * 4 + 6);
    }
}
