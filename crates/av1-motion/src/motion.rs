//! DOOR 1: from the specification's terms (rows and columns in 1/8 px, reference names) to pixels and
//! real frames.

use std::sync::Arc;

use crate::obu::frame_header::FrameHeader;
use crate::obu::sequence_header::SequenceHeader;
use crate::tables::symbols::{
    GLOBAL_GLOBALMV, GLOBALMV, LOCALWARP, OBMC, TRANSLATION, WARPEDMODEL_PREC_BITS,
};
use crate::tile::{Block, CoefficientStats, NO_WARP};
use crate::trace::FrameTraceState;
use crate::warp::is_shear_valid;

/// A motion vector in the specification's order and unit: 1/8 luma sample, from the current frame to
/// the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotionVector {
    /// Downwards.
    pub row: i16,
    /// To the right.
    pub col: i16,
}

impl MotionVector {
    /// No motion.
    pub const ZERO: Self = Self { row: 0, col: 0 };

    /// The opposite vector.
    pub(crate) fn negated(self) -> Self {
        Self {
            row: self.row.saturating_neg(),
            col: self.col.saturating_neg(),
        }
    }
}

/// How a block was coded, as bits of [`Motion::flags`].
pub mod flags {
    /// No residual was coded.
    pub const SKIP: u16 = 1;
    /// The block averages two references.
    pub const COMPOUND: u16 = 2;
    /// Overlapped block motion compensation.
    pub const OVERLAPPED: u16 = 4;
    /// A local affine model was used.
    pub const WARPED: u16 = 8;
    /// The vector comes from the frame's global motion model.
    pub const GLOBAL: u16 = 16;
    /// Inter prediction is blended with intra prediction.
    pub const INTERINTRA: u16 = 32;
}

/// The frame behind a reference name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reference {
    /// Position in decode order.
    pub decode_index: u64,
    /// Position in display order.
    pub display_index: i64,
}

/// What [`Parser::next_frame`](crate::Parser::next_frame) returns: a decoded frame, or the order to
/// show an earlier one.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in decode order, counted from 0; with `show_existing_frame` that of the shown frame.
    pub decode_index: u64,
    /// Position in display order, counted from 0. A hidden frame carries the position of the picture
    /// it stands for.
    pub display_index: i64,
    /// Number of the unit that held the frame, counted from 0.
    pub unit_index: u64,
    /// Temporal layer.
    pub temporal_id: u8,
    /// Spatial layer.
    pub spatial_id: u8,
    /// The frame, or the one that is shown again, is meant to be seen (§7.18.1): it is shown and of
    /// the highest spatial layer of the operating point.
    pub is_output: bool,
    /// The frames behind LAST (index 0) to ALTREF (6); absent in intra frames and for lost frames.
    pub references: [Option<Reference>; 7],
    pub(crate) header: Arc<FrameHeader>,
    pub(crate) sequence: Arc<SequenceHeader>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) warps: Vec<[i32; 6]>,
    pub(crate) stats: [CoefficientStats; 3],
    pub(crate) is_scaled: [bool; 8],
    /// `RefUpscaledWidth` and `RefFrameHeight`, by reference name.
    pub(crate) ref_size: [[u32; 2]; 8],
    #[cfg_attr(not(feature = "trace"), expect(dead_code, reason = "empty"))]
    pub(crate) trace: FrameTraceState,
}

/// The motion of one block towards one reference, in px of the output picture; x to the right, y
/// down, origin at the upper left corner of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// `[x, y, width, height]`; may overhang the right and lower edge.
    pub block: [i32; 4],
    /// `[dx, dy]`: position in the reference minus position in this frame.
    pub mv: [f32; 2],
    /// The frame that is referred to.
    pub reference: Reference,
    /// Bits of [`flags`].
    pub flags: u16,
    /// `segment_id`.
    pub segment_id: u8,
    /// `CurrentQIndex`.
    pub qindex: u8,
    /// Sum of absolute quantised luma levels.
    pub luma_level: u32,
    /// `[a, b, c, d, e, f]`: `(x, y)` goes to `(a x + b y + c, d x + e y + f)`, when the block follows
    /// a local or global affine model.
    pub warp: Option<[f64; 6]>,
}

impl Frame {
    /// The coded blocks, tile by tile, in coding order. Empty with `show_existing_frame`.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The motion of every inter block, one item per block and reference, in px of the frame after
    /// upscaling. Intra blocks and intra block copies have none; neither has a reference that
    /// stands for the same picture.
    pub fn motion(&self) -> impl Iterator<Item = Motion> {
        let size = &self.header.size;
        self.motion_in(size.upscaled_width, size.frame_height)
    }

    /// The same in px of a picture of another size, to which every frame of the stream is brought:
    /// references and spatial layers may have other sizes than the picture that is seen.
    pub fn motion_in(&self, width: u32, height: u32) -> impl Iterator<Item = Motion> {
        let models = GlobalModels::new(self);
        let size = &self.header.size;
        let scale = [
            f64::from(width) / f64::from(size.frame_width.max(1)),
            f64::from(height) / f64::from(size.frame_height.max(1)),
        ];
        self.blocks
            .iter()
            .filter(|block| !block.use_intrabc)
            .flat_map(move |block| {
                (0..2).filter_map(move |list| self.block_motion(block, list, models, scale))
            })
    }

    /// Whether the frame is intra coded throughout.
    #[must_use]
    pub fn is_intra(&self) -> bool {
        self.header.frame_is_intra
    }

    /// Counts over the transform blocks of Y, U and V.
    #[must_use]
    pub fn coefficient_stats(&self) -> &[CoefficientStats; 3] {
        &self.stats
    }

    fn block_motion(
        &self,
        block: &Block,
        list: usize,
        models: GlobalModels,
        scale: [f64; 2],
    ) -> Option<Motion> {
        let name = block.ref_frame[list];
        if name <= 0 {
            return None;
        }
        let reference = self.references[name as usize - 1]?;
        if reference.display_index == self.display_index {
            return None;
        }
        let scaled = |mi: u32, axis: usize| {
            // Nearly always, and `round` is a call on processors without an instruction for it.
            if scale[axis].to_bits() == 1_f64.to_bits() {
                (mi * 4) as i32
            } else {
                (f64::from(mi * 4) * scale[axis]).round() as i32
            }
        };
        let (x, y) = (scaled(block.mi_col, 0), scaled(block.mi_row, 1));
        let right = scaled(block.mi_col + block.width4() as u32, 0);
        let bottom = scaled(block.mi_row + block.height4() as u32, 1);
        let mv = block.mv[list];
        let warp = self.warp_of(block, name, models);
        Some(Motion {
            block: [x, y, right - x, bottom - y],
            mv: [
                (f64::from(mv.col) / 8.0 * scale[0]) as f32,
                (f64::from(mv.row) / 8.0 * scale[1]) as f32,
            ],
            reference,
            flags: block_flags(block),
            segment_id: block.segment_id,
            qindex: block.q_index,
            luma_level: block.luma_level,
            warp: warp.map(|params| to_pixels(params, scale)),
        })
    }

    /// §7.11.3.1, step 7: the model that predicts a block, if one does.
    fn warp_of(&self, block: &Block, name: i8, models: GlobalModels) -> Option<&[i32; 6]> {
        if block.width4() < 2 || block.height4() < 2 || self.header.force_integer_mv {
            return None;
        }
        if block.motion_mode == LOCALWARP && block.warp != NO_WARP {
            return self.warps.get(block.warp as usize);
        }
        let is_global = matches!(block.y_mode, GLOBALMV | GLOBAL_GLOBALMV);
        (is_global && models.is_usable[name as usize])
            .then(|| &self.header.gm_params[name as usize])
    }
}

/// Which global models predict blocks.
#[derive(Clone, Copy)]
struct GlobalModels {
    is_usable: [bool; 8],
}

impl GlobalModels {
    fn new(frame: &Frame) -> Self {
        let header = &frame.header;
        let is_usable = std::array::from_fn(|name| {
            header.gm_type[name] > TRANSLATION
                && !frame.is_scaled[name]
                && is_shear_valid(&header.gm_params[name])
        });
        Self { is_usable }
    }
}

fn block_flags(block: &Block) -> u16 {
    let flag = |is_set: bool, bit: u16| if is_set { bit } else { 0 };
    flag(block.skip, flags::SKIP)
        | flag(block.is_compound(), flags::COMPOUND)
        | flag(block.motion_mode == OBMC, flags::OVERLAPPED)
        | flag(block.warp != NO_WARP, flags::WARPED)
        | flag(
            matches!(block.y_mode, GLOBALMV | GLOBAL_GLOBALMV),
            flags::GLOBAL,
        )
        | flag(block.is_interintra(), flags::INTERINTRA)
}

/// Warp parameters act on sample indices of the coded frame; pixels count from the corner of the output
/// picture, so that sample 0 lies at 0.5 of the coded frame.
fn to_pixels(params: &[i32; 6], [scale_x, scale_y]: [f64; 2]) -> [f64; 6] {
    let [tx, ty, xx, xy, yx, yy] =
        params.map(|value| f64::from(value) / f64::from(1 << WARPEDMODEL_PREC_BITS));
    [
        xx,
        xy * scale_x / scale_y,
        scale_x * (tx + 0.5 - 0.5 * (xx + xy)),
        yx * scale_y / scale_x,
        yy,
        scale_y * (ty + 0.5 - 0.5 * (yx + yy)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_translation_keeps_its_length_when_it_moves_to_pixels() {
        let one = 1 << WARPEDMODEL_PREC_BITS;
        let model = to_pixels(&[3 * one, -2 * one, one, 0, 0, one], [1.0; 2]);
        assert_eq!(
            model.map(f64::to_bits),
            [1.0, 0.0, 3.0, 0.0, 1.0, -2.0].map(f64::to_bits)
        );
    }

    #[test]
    fn a_zoom_about_the_first_sample_leaves_its_centre_in_place() {
        let one = 1 << WARPEDMODEL_PREC_BITS;
        let model = to_pixels(&[0, 0, 2 * one, 0, 0, 2 * one], [1.0; 2]);
        let along = |row: &[f64]| row[0] * 0.5 + row[1] * 0.5 + row[2];
        assert!((along(&model[..3]) - 0.5).abs() < 1e-12);
        assert!((along(&model[3..]) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_model_says_the_same_in_the_pixels_of_a_larger_picture() {
        let one = 1 << WARPEDMODEL_PREC_BITS;
        let params = [5 * one, -one, one + 900, 700, -300, one - 400];
        let (coded, output) = (to_pixels(&params, [1.0; 2]), to_pixels(&params, [2.0, 1.5]));
        let apply = |model: &[f64; 6], [x, y]: [f64; 2]| {
            [
                model[0] * x + model[1] * y + model[2],
                model[3] * x + model[4] * y + model[5],
            ]
        };
        let [x, y] = apply(&coded, [40.0, 24.0]);
        let [wide, high] = apply(&output, [80.0, 36.0]);
        assert!((wide - 2.0 * x).abs() < 1e-9 && (high - 1.5 * y).abs() < 1e-9);
    }
}
