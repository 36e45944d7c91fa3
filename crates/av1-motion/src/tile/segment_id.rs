//! §5.11.8 Intra segment ID, §5.11.9 Read segment ID, §5.11.19 Inter segment ID, and the skip flags.

use super::{Block, BlockContext, TileDecoder, TileError, TileResult};
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{SEG_LVL_GLOBALMV, SEG_LVL_REF_FRAME, SEG_LVL_SKIP};

impl TileDecoder<'_> {
    /// §5.11.8 `intra_segment_id`.
    pub(super) fn intra_segment_id(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
    ) -> TileResult<()> {
        if self.frame.header.segmentation.enabled {
            self.read_segment_id(block, context)?;
        }
        Ok(())
    }

    /// §5.11.9 `read_segment_id`.
    fn read_segment_id(&mut self, block: &mut Block, context: &BlockContext) -> TileResult<()> {
        let above = context.above.as_ref().map(|block| block.segment_id);
        let left = context.left.as_ref().map(|block| block.segment_id);
        let above_left = above
            .and(left)
            .map(|_| self.block_at(block.mi_row - 1, block.mi_col - 1).segment_id);
        let prediction = match (above, left) {
            (None, left) => left.unwrap_or(0),
            (Some(above), None) => above,
            (Some(above), Some(left)) => {
                if above_left == Some(above) {
                    above
                } else {
                    left
                }
            }
        };
        if block.skip {
            block.segment_id = prediction;
            return Ok(());
        }
        let cdf_context = match above_left {
            Some(_) if above_left == above && above_left == left => 2,
            Some(_) if above_left == above || above_left == left || above == left => 1,
            _ => 0,
        };
        let symbol = self.symbols.symbol(&mut self.cdfs.segment_id[cdf_context]);
        let last_active = self.frame.header.segmentation.last_active_seg_id;
        let id = neg_deinterleave(symbol.into(), prediction.into(), i32::from(last_active) + 1);
        if id < 0 || id > last_active.into() {
            let reason = "a segment id is above the last active segment";
            return Err(TileError {
                section: "6.10.9",
                reason,
            });
        }
        block.segment_id = id as u8;
        Ok(())
    }

    /// §5.11.19 `inter_segment_id`.
    pub(super) fn inter_segment_id(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
        is_pre_skip: bool,
    ) -> TileResult<()> {
        let segmentation = &self.frame.header.segmentation;
        if !segmentation.enabled {
            return Ok(());
        }
        if !segmentation.update_map {
            block.segment_id = self.predicted_segment_id(block);
            return Ok(());
        }
        if is_pre_skip && !segmentation.seg_id_pre_skip {
            block.segment_id = 0;
            return Ok(());
        }
        if !is_pre_skip && block.skip {
            self.set_segment_predicted(block, false);
            return self.read_segment_id(block, context);
        }
        if !segmentation.temporal_update {
            return self.read_segment_id(block, context);
        }
        let col = self.bounds.col(block.mi_col);
        let row = block.mi_row as usize & 31;
        let cdf_context = self.left.segment_predicted[row] + self.above.segment_predicted[col];
        let is_predicted = self
            .symbols
            .flag(&mut self.cdfs.segment_id_predicted[cdf_context as usize]);
        if is_predicted {
            block.segment_id = self.predicted_segment_id(block);
        } else {
            self.read_segment_id(block, context)?;
        }
        self.set_segment_predicted(block, is_predicted);
        Ok(())
    }

    fn set_segment_predicted(&mut self, block: &Block, is_predicted: bool) {
        let col = self.bounds.col(block.mi_col);
        let row = block.mi_row as usize & 31;
        self.above.segment_predicted[col..col + block.width4()].fill(is_predicted.into());
        self.left.segment_predicted[row..row + block.height4()].fill(is_predicted.into());
    }

    /// §5.11.21 `get_segment_id`.
    fn predicted_segment_id(&self, block: &Block) -> u8 {
        let Some(map) = &self.frame.prev_segment_ids else {
            return 0;
        };
        let size = &self.frame.header.size;
        let (mi_rows, mi_cols) = (size.mi_rows as usize, size.mi_cols as usize);
        let (row, col) = (block.mi_row as usize, block.mi_col as usize);
        let rows = row..mi_rows.min(row + block.height4());
        let width = block.width4().min(mi_cols - col);
        rows.flat_map(|row| &map[row * mi_cols + col..][..width])
            .copied()
            .min()
            .unwrap_or(7)
            .min(7)
    }

    /// §5.11.10 `read_skip_mode`.
    pub(super) fn read_skip_mode(&mut self, block: &mut Block, context: &BlockContext) {
        let header = &self.frame.header;
        let is_active = |feature| {
            header
                .segmentation
                .feature_active(block.segment_id, feature)
        };
        let size = block.size as usize;
        if is_active(SEG_LVL_SKIP)
            || is_active(SEG_LVL_REF_FRAME)
            || is_active(SEG_LVL_GLOBALMV)
            || !header.skip_mode_present
            || BLOCK_WIDTH[size] < 8
            || BLOCK_HEIGHT[size] < 8
        {
            return;
        }
        let cdf_context = count(context, |block| block.skip_mode);
        block.skip_mode = self.symbols.flag(&mut self.cdfs.skip_mode[cdf_context]);
    }

    /// §5.11.11 `read_skip`.
    pub(super) fn read_skip(&mut self, block: &mut Block, context: &BlockContext) {
        let segmentation = &self.frame.header.segmentation;
        if segmentation.seg_id_pre_skip
            && segmentation.feature_active(block.segment_id, SEG_LVL_SKIP)
        {
            block.skip = true;
            return;
        }
        let cdf_context = count(context, |block| block.skip);
        block.skip = self.symbols.flag(&mut self.cdfs.skip[cdf_context]);
    }
}

/// How many of the available neighbours have a property.
pub(super) fn count(context: &BlockContext, property: impl Fn(&Block) -> bool) -> usize {
    let has = |neighbor: &Option<Block>| usize::from(neighbor.as_ref().is_some_and(&property));
    has(&context.above) + has(&context.left)
}

/// §5.11.9 `neg_deinterleave`.
fn neg_deinterleave(diff: i32, reference: i32, max: i32) -> i32 {
    if reference == 0 {
        return diff;
    }
    if reference >= max - 1 {
        return max - diff - 1;
    }
    let near = if diff & 1 == 1 {
        reference + ((diff + 1) >> 1)
    } else {
        reference - (diff >> 1)
    };
    if 2 * reference < max {
        if diff <= 2 * reference { near } else { diff }
    } else if diff <= 2 * (max - reference - 1) {
        near
    } else {
        max - (diff + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::neg_deinterleave;

    #[test]
    fn segment_differences_map_one_to_one_onto_the_segments() {
        for max in 1..=8 {
            for reference in 0..max {
                let mut ids: Vec<_> = (0..max)
                    .map(|diff| neg_deinterleave(diff, reference, max))
                    .collect();
                ids.sort_unstable();
                assert_eq!(ids, (0..max).collect::<Vec<_>>());
            }
        }
    }
}
