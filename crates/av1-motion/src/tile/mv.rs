//! §5.11.26 Assign MV, §5.11.31 MV, §5.11.32 MV component.

use super::{Block, TileDecoder, TileError, TileResult};
use crate::motion::MotionVector;
use crate::mvpred::MvStack;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{
    GLOBAL_GLOBALMV, GLOBALMV, INTRABC_DELAY_PIXELS, INTRABC_DELAY_SB64, MV_INTRABC_CONTEXT,
    MV_JOINT_HNZVNZ, MV_JOINT_HNZVZ, MV_JOINT_HZVNZ, NEAR_NEARMV, NEAR_NEWMV, NEAREST_NEARESTMV,
    NEAREST_NEWMV, NEARESTMV, NEARMV, NEW_NEARESTMV, NEW_NEARMV, NEW_NEWMV, NEWMV,
};

impl TileDecoder<'_> {
    /// §5.11.26 `assign_mv`.
    pub(super) fn assign_mv(&mut self, block: &mut Block, stack: &MvStack) -> TileResult<()> {
        if block.use_intrabc {
            let prediction = self.intrabc_prediction(block, stack);
            block.mv[0] = self.read_mv(prediction, MV_INTRABC_CONTEXT)?;
            if !self.is_intrabc_valid(block) {
                let reason = "an intra block copy reads samples that are not decoded yet";
                return Err(TileError {
                    section: "6.10.25",
                    reason,
                });
            }
            return Ok(());
        }
        for list in 0..if block.is_compound() { 2 } else { 1 } {
            let mode = list_mode(block.y_mode, list);
            block.mv[list] = match mode {
                GLOBALMV => stack.global_mvs[list],
                NEARESTMV => stack.mvs[0][list],
                NEWMV => {
                    let position = if stack.num_found <= 1 {
                        0
                    } else {
                        block.ref_mv_idx as usize
                    };
                    self.read_mv(stack.mvs[position][list], 0)?
                }
                _ => stack.mvs[block.ref_mv_idx as usize][list],
            };
            check_range(block.mv[list].row.into(), block.mv[list].col.into())?;
        }
        Ok(())
    }

    /// §5.11.26: `PredMv` of an intra block copy.
    fn intrabc_prediction(&self, block: &Block, stack: &MvStack) -> MotionVector {
        let found = [stack.mvs[0][0], stack.mvs[1][0]];
        if let Some(&mv) = found.iter().find(|&&mv| mv != MotionVector::ZERO) {
            return mv;
        }
        let size4 = if self.frame.sequence.use_128x128_superblock {
            32
        } else {
            16
        };
        if (block.mi_row as i32) - size4 < self.bounds.mi_row_start as i32 {
            MotionVector {
                row: 0,
                col: (-(size4 * 4 + INTRABC_DELAY_PIXELS) * 8) as i16,
            }
        } else {
            MotionVector {
                row: (-(size4 * 4 * 8)) as i16,
                col: 0,
            }
        }
    }

    /// §5.11.31 `read_mv`.
    fn read_mv(&mut self, prediction: MotionVector, context: usize) -> TileResult<MotionVector> {
        let joint = self.symbols.symbol(&mut self.cdfs.mv[context].joint);
        let (mut row, mut col) = (i32::from(prediction.row), i32::from(prediction.col));
        if joint == MV_JOINT_HZVNZ || joint == MV_JOINT_HNZVNZ {
            row += self.read_mv_component(context, 0);
        }
        if joint == MV_JOINT_HNZVZ || joint == MV_JOINT_HNZVNZ {
            col += self.read_mv_component(context, 1);
        }
        check_range(row, col)?;
        Ok(MotionVector {
            row: row as i16,
            col: col as i16,
        })
    }

    /// §5.11.32 `read_mv_component`.
    fn read_mv_component(&mut self, context: usize, component: usize) -> i32 {
        let header = &self.frame.header;
        let symbols = &mut self.symbols;
        let cdfs = &mut self.cdfs.mv[context].components[component];
        let sign = symbols.digit(&mut cdfs.sign) as i32;
        let class = symbols.symbol(&mut cdfs.class);
        let (mut integer, mut fr, mut hp, mut base) = (0, 3, 1, 0);
        if class == 0 {
            integer = symbols.digit(&mut cdfs.class0_bit);
            if !header.force_integer_mv {
                fr = symbols.symbol(&mut cdfs.class0_fr[integer as usize]).into();
            }
            if header.allow_high_precision_mv {
                hp = symbols.digit(&mut cdfs.class0_hp);
            }
        } else {
            for (i, cdf) in cdfs.bits.iter_mut().enumerate().take(class.into()) {
                integer |= symbols.digit(cdf) << i;
            }
            if !header.force_integer_mv {
                fr = symbols.symbol(&mut cdfs.fr).into();
            }
            if header.allow_high_precision_mv {
                hp = symbols.digit(&mut cdfs.hp);
            }
            base = 2 << (class + 2);
        }
        let magnitude = base + (integer << 3 | fr << 1 | hp) + 1;
        // The sign as 0 or -1.
        (magnitude as i32 ^ -sign) + sign
    }

    /// §6.10.25 `is_mv_valid` for intra block copy.
    fn is_intrabc_valid(&self, block: &Block) -> bool {
        let mv = block.mv[0];
        if mv.row & 7 != 0 || mv.col & 7 != 0 {
            return false;
        }
        let size = block.size as usize;
        let (width, height) = (i32::from(BLOCK_WIDTH[size]), i32::from(BLOCK_HEIGHT[size]));
        let color = &self.frame.sequence.color;
        let mut top = block.mi_row as i32 * 4 + i32::from(mv.row >> 3);
        let mut left = block.mi_col as i32 * 4 + i32::from(mv.col >> 3);
        let (bottom, right) = (top + height, left + width);
        if block.has_chroma {
            left -= if width < 8 && color.subsampling_x == 1 {
                4
            } else {
                0
            };
            top -= if height < 8 && color.subsampling_y == 1 {
                4
            } else {
                0
            };
        }
        let bounds = &self.bounds;
        if top < bounds.mi_row_start as i32 * 4
            || left < bounds.mi_col_start as i32 * 4
            || bottom > bounds.mi_row_end as i32 * 4
            || right > bounds.mi_col_end as i32 * 4
        {
            return false;
        }
        let is_128 = self.frame.sequence.use_128x128_superblock;
        let superblock = if is_128 { 128 } else { 64 };
        let active_row = block.mi_row as i32 * 4 / superblock;
        let active_col64 = (block.mi_col as i32 * 4) >> 6;
        let (source_row, source_col64) = ((bottom - 1) / superblock, (right - 1) >> 6);
        let per_row = ((bounds.cols() as i32 - 1) >> 4) + 1;
        let active = active_row * per_row + active_col64;
        let source = source_row * per_row + source_col64;
        let gradient = 1 + INTRABC_DELAY_SB64 + i32::from(is_128);
        let offset = gradient * (active_row - source_row);
        source < active - INTRABC_DELAY_SB64
            && source_row <= active_row
            && source_col64 < active_col64 - INTRABC_DELAY_SB64 + offset
    }
}

/// §6.10.25: vectors are shorter than 2^14 in both directions.
fn check_range(row: i32, col: i32) -> TileResult<()> {
    if row.abs() >= 1 << 14 || col.abs() >= 1 << 14 {
        let reason = "a motion vector is longer than AV1 allows";
        return Err(TileError {
            section: "6.10.25",
            reason,
        });
    }
    Ok(())
}

/// §5.11.30 `get_mode`: the mode of one list as a single-reference mode.
pub(super) fn list_mode(mode: u8, list: usize) -> u8 {
    let modes = match mode {
        NEAREST_NEARESTMV => [NEARESTMV, NEARESTMV],
        NEAR_NEARMV => [NEARMV, NEARMV],
        NEAREST_NEWMV => [NEARESTMV, NEWMV],
        NEW_NEARESTMV => [NEWMV, NEARESTMV],
        NEAR_NEWMV => [NEARMV, NEWMV],
        NEW_NEARMV => [NEWMV, NEARMV],
        GLOBAL_GLOBALMV => [GLOBALMV, GLOBALMV],
        NEW_NEWMV => [NEWMV, NEWMV],
        single => [single, single],
    };
    modes[list]
}
