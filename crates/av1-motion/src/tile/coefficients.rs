//! §5.11.39 Coefficients.

use super::context::{Area, fill_few};
use super::levels::{LevelCdfs, LevelSums, read_levels, read_signs};
use super::{Block, BlockContext, TileDecoder, TileResult};
use crate::entropy::cdf_set::CoefCdfs;
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH, SUBSAMPLED_SIZE};
use crate::tables::symbols::{DCT_DCT, TX_CLASS_2D, TX_CLASS_HORIZ, TX_CLASS_VERT};
use crate::tables::tx_class;
use crate::tables::tx_size::{
    TX_32X32, TX_HEIGHT, TX_HEIGHT_LOG2, TX_SIZE_SQR, TX_SIZE_SQR_UP, TX_WIDTH, TX_WIDTH_LOG2,
};
use crate::tile::tx_size::tx_size4;

impl TileDecoder<'_> {
    /// §5.11.39 `coeffs`, at a position of the plane in units of 4 samples.
    pub(super) fn coefficients(
        &mut self,
        block: &mut Block,
        context: &BlockContext,
        plane: usize,
        tx_size: u8,
        x4: u32,
        y4: u32,
    ) -> TileResult<()> {
        let color = &self.frame.sequence.color;
        let (ss_x, ss_y) = if plane > 0 {
            (color.subsampling_x, color.subsampling_y)
        } else {
            (0, 0)
        };
        let (width4, height4) = tx_size4(tx_size);
        let col = x4 as usize - (self.bounds.mi_col_start >> ss_x) as usize;
        let row = y4 as usize & (31 >> ss_y);
        let cols = col..col + width4 as usize;
        let rows = row..row + height4 as usize;
        let size_context =
            (TX_SIZE_SQR[tx_size as usize] + TX_SIZE_SQR_UP[tx_size as usize] + 1) as usize >> 1;
        // Only the chroma of inter blocks looks at the types of luma.
        let area = (plane == 0 && block.is_inter)
            .then(|| self.grid.area(y4, x4, width4 as usize, height4 as usize));

        let plane_size = SUBSAMPLED_SIZE[block.size as usize][ss_x as usize][ss_y as usize];
        let zero_context = {
            let above = &self.above.coefficients[plane][cols.clone()];
            let left = &self.left.coefficients[plane][rows.clone()];
            all_zero_context(plane, plane_size, tx_size, above, left)
        };
        let is_zero = self
            .symbols
            .flag(&mut self.cdfs.coef.txb_skip[size_context][zero_context]);
        if is_zero {
            if let Some(area) = area {
                area.fill(&mut self.grid.tx_type, DCT_DCT);
            }
            fill_few(&mut self.above.coefficients[plane][cols], 0);
            fill_few(&mut self.left.coefficients[plane][rows], 0);
            self.stats[plane].zero_blocks += 1;
            self.trace.transform_block(plane, (x4, y4), tx_size, None);
            return Ok(());
        }
        let tx_type = if plane == 0 {
            self.luma_tx_type(block, tx_size, area)
        } else {
            self.chroma_tx_type(block, context, tx_size, x4, y4)
        };
        self.trace
            .transform_block(plane, (x4, y4), tx_size, Some(tx_type));
        let class = tx_class(tx_type);
        let plane_type = usize::from(plane > 0);
        let coef = &mut self.cdfs.coef;
        let eob = read_eob(
            &mut self.symbols,
            coef,
            tx_size,
            size_context,
            plane_type,
            class,
        );
        let mut cdfs = LevelCdfs {
            base_eob: &mut coef.coeff_base_eob[size_context][plane_type],
            base: &mut coef.coeff_base[size_context][plane_type],
            range: &mut coef.coeff_br[size_context.min(TX_32X32 as usize)][plane_type],
        };
        let scratch = &mut *self.scratch;
        let symbols = &mut self.symbols;
        let read = match class {
            TX_CLASS_2D => read_levels::<TX_CLASS_2D>(symbols, &mut cdfs, scratch, tx_size, eob),
            TX_CLASS_HORIZ => {
                read_levels::<TX_CLASS_HORIZ>(symbols, &mut cdfs, scratch, tx_size, eob)
            }
            _ => read_levels::<TX_CLASS_VERT>(symbols, &mut cdfs, scratch, tx_size, eob),
        };
        let sign_context = {
            let above = &self.above.coefficients[plane][cols.clone()];
            let left = &self.left.coefficients[plane][rows.clone()];
            dc_sign_context(above, left)
        };
        let dc_sign = &mut self.cdfs.coef.dc_sign[plane_type][sign_context];
        let sums = read_signs(&mut self.symbols, dc_sign, &self.scratch, &read)?;
        let entry = sums.total.min(63) as u8 | sums.dc_category << 6;
        self.keep_contexts(plane, (x4, y4), (width4, height4), (ss_x, ss_y), entry);
        self.count(block, plane, eob, &sums);
        Ok(())
    }

    /// §5.11.47: reads the type of a luma transform block and keeps it for chroma.
    fn luma_tx_type(&mut self, block: &Block, tx_size: u8, area: Option<Area>) -> u8 {
        let tx_type = self.read_transform_type(block, tx_size);
        if let Some(area) = area {
            area.fill(&mut self.grid.tx_type, tx_type);
        }
        tx_type
    }

    /// §5.11.39: `AboveLevelContext` and its kin. Entries outside the frame stay zero, which is how
    /// §8.3.2 ignores them.
    fn keep_contexts(
        &mut self,
        plane: usize,
        (x4, y4): (u32, u32),
        (width4, height4): (u32, u32),
        (ss_x, ss_y): (u8, u8),
        entry: u8,
    ) {
        let bounds = &self.bounds;
        let keep = |entries: &mut [u8], visible: u32| {
            let visible = entries.len().min(visible as usize);
            fill_few(&mut entries[..visible], entry);
            fill_few(&mut entries[visible..], 0);
        };
        let col = (x4 - (bounds.mi_col_start >> ss_x)) as usize;
        let row = y4 as usize & (31 >> ss_y);
        let above = &mut self.above.coefficients[plane][col..col + width4 as usize];
        keep(above, (bounds.mi_col_end >> ss_x) - x4);
        let left = &mut self.left.coefficients[plane][row..row + height4 as usize];
        keep(left, (bounds.mi_row_end >> ss_y) - y4);
    }

    fn count(&mut self, block: &mut Block, plane: usize, eob: usize, sums: &LevelSums) {
        let stats = &mut self.stats[plane];
        stats.coded_blocks += 1;
        stats.end_of_block += eob as u64;
        stats.level += sums.total;
        stats.negative += sums.negative;
        let coefficients = &mut block.coefficients[usize::from(plane > 0)];
        *coefficients = coefficients.saturating_add(eob as u16);
        if plane == 0 {
            block.luma_level = block.luma_level.saturating_add(sums.total as u32);
        }
    }
}

/// §8.3.2: the context of `all_zero`.
#[inline]
fn all_zero_context(plane: usize, plane_size: u8, tx_size: u8, above: &[u8], left: &[u8]) -> usize {
    let (width, height) = (
        BLOCK_WIDTH[plane_size as usize],
        BLOCK_HEIGHT[plane_size as usize],
    );
    let (tx_width, tx_height) = (TX_WIDTH[tx_size as usize], TX_HEIGHT[tx_size as usize]);
    if plane > 0 {
        let any = |entries: &[u8]| usize::from(entries.iter().fold(0, |any, &e| any | e) != 0);
        let is_split =
            u32::from(width) * u32::from(height) > u32::from(tx_width) * u32::from(tx_height);
        return 7 + any(above) + any(left) + if is_split { 3 } else { 0 };
    }
    if width == tx_width && height == tx_height {
        return 0;
    }
    let highest = |entries: &[u8]| entries.iter().fold(0, |level, &e| level.max(e & 63));
    let (top, left) = (highest(above), highest(left));
    match (top.min(left), top.max(left)) {
        (0, 0) => 1,
        (0, max) => 2 + usize::from(max > 3),
        (_, max) if max <= 3 => 4,
        (min, _) if min <= 3 => 5,
        _ => 6,
    }
}

/// §8.3.2: the context of `dc_sign`.
#[inline]
fn dc_sign_context(above: &[u8], left: &[u8]) -> usize {
    let sum: i32 = above
        .iter()
        .chain(left)
        .map(|&entry| match entry >> 6 {
            1 => -1,
            2 => 1,
            _ => 0,
        })
        .sum();
    match sum.signum() {
        -1 => 1,
        1 => 2,
        _ => 0,
    }
}

/// §5.11.39: `eob`, the number of coefficients up to the last one that is not zero.
fn read_eob(
    symbols: &mut SymbolDecoder,
    coef: &mut CoefCdfs,
    tx_size: u8,
    size_context: usize,
    plane_type: usize,
    class: u8,
) -> usize {
    let context = usize::from(class != TX_CLASS_2D);
    let log2 = |log2: u8| log2.min(5);
    let area = log2(TX_WIDTH_LOG2[tx_size as usize]) + log2(TX_HEIGHT_LOG2[tx_size as usize]);
    let eob_pt = 1 + match area - 4 {
        0 => symbols.symbol(&mut coef.eob_pt_16[plane_type][context]),
        1 => symbols.symbol(&mut coef.eob_pt_32[plane_type][context]),
        2 => symbols.symbol(&mut coef.eob_pt_64[plane_type][context]),
        3 => symbols.symbol(&mut coef.eob_pt_128[plane_type][context]),
        4 => symbols.symbol(&mut coef.eob_pt_256[plane_type][context]),
        5 => symbols.symbol(&mut coef.eob_pt_512[plane_type]),
        _ => symbols.symbol(&mut coef.eob_pt_1024[plane_type]),
    } as usize;
    if eob_pt < 3 {
        return eob_pt;
    }
    let bits = eob_pt - 2;
    let cdf = &mut coef.eob_extra[size_context][plane_type][eob_pt - 3];
    let high = (symbols.digit(cdf) as usize) << (bits - 1);
    (1 << bits) + 1 + high + symbols.literal(bits as u32 - 1) as usize
}
