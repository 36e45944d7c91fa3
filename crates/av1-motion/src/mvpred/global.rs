//! §7.10.2.1 Setup global MV process, §7.10.2.10 Lower precision process.

use crate::motion::MotionVector;
use crate::obu::frame_header::FrameHeader;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{IDENTITY, INTRA_FRAME, TRANSLATION, WARPEDMODEL_PREC_BITS};
use crate::tile::{Block, TileDecoder};

impl TileDecoder<'_> {
    /// §7.10.2.1: the frame's global motion at the centre of the block.
    pub(super) fn global_mv(&self, block: &Block, list: usize) -> MotionVector {
        let header = &self.frame.header;
        let reference = block.ref_frame[list];
        if reference == INTRA_FRAME || header.gm_type[reference as usize] == IDENTITY {
            return MotionVector::ZERO;
        }
        let params = header.gm_params[reference as usize].map(i64::from);
        let (row, col) = if header.gm_type[reference as usize] == TRANSLATION {
            // Parameter 0 is the row here, unlike in the models below.
            (
                params[0] >> (WARPEDMODEL_PREC_BITS - 3),
                params[1] >> (WARPEDMODEL_PREC_BITS - 3),
            )
        } else {
            let size = block.size as usize;
            let x = i64::from(block.mi_col) * 4 + i64::from(BLOCK_WIDTH[size]) / 2 - 1;
            let y = i64::from(block.mi_row) * 4 + i64::from(BLOCK_HEIGHT[size]) / 2 - 1;
            let one = 1 << WARPEDMODEL_PREC_BITS;
            let xc = (params[2] - one) * x + params[3] * y + params[0];
            let yc = params[4] * x + (params[5] - one) * y + params[1];
            if header.allow_high_precision_mv {
                let shift = WARPEDMODEL_PREC_BITS as u32 - 3;
                (round2_signed(yc, shift), round2_signed(xc, shift))
            } else {
                let shift = WARPEDMODEL_PREC_BITS as u32 - 2;
                (round2_signed(yc, shift) * 2, round2_signed(xc, shift) * 2)
            }
        };
        // A hostile model can leave the range of vectors; such a stream fails where the vector is used.
        let narrow = |value: i64| value.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        lower_precision(
            header,
            MotionVector {
                row: narrow(row),
                col: narrow(col),
            },
        )
    }
}

/// §7.10.2.10 `lower_mv_precision`.
#[inline]
pub(super) fn lower_precision(header: &FrameHeader, mv: MotionVector) -> MotionVector {
    if header.allow_high_precision_mv {
        return mv;
    }
    let lower = |value: i16| {
        if header.force_integer_mv {
            let whole = (i32::from(value).abs() + 3) >> 3 << 3;
            let signed = if value > 0 { whole } else { -whole };
            signed.clamp(i16::MIN.into(), i16::MAX.into()) as i16
        } else if value & 1 == 1 {
            value - value.signum()
        } else {
            value
        }
    };
    MotionVector {
        row: lower(mv.row),
        col: lower(mv.col),
    }
}

/// §4.7 `Round2Signed`.
#[inline]
pub(crate) fn round2_signed(value: i64, bits: u32) -> i64 {
    if bits == 0 {
        return value;
    }
    // Halves go away from zero: negative values are rounded up from one less.
    (value + (1 << (bits - 1)) + (value >> 63)) >> bits
}
