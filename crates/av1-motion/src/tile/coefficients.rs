//! §5.11.39 Coefficients.

use super::context::Area;
use super::{Block, BlockContext, TileDecoder, TileError, TileResult};
use crate::entropy::cdf::{Cdf3, Cdf4};
use crate::entropy::cdf_set::CoefCdfs;
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH, SUBSAMPLED_SIZE};
use crate::tables::contexts::COEFF_BASE_CTX_OFFSET;
use crate::tables::scan::scan;
use crate::tables::symbols::{
    BR_CDF_SIZE, COEFF_BASE_RANGE, DCT_DCT, NUM_BASE_LEVELS, SIG_COEF_CONTEXTS_2D, TX_CLASS_2D,
    TX_CLASS_HORIZ, TX_CLASS_VERT,
};
use crate::tables::tx_class;
use crate::tables::tx_size::{
    ADJUSTED_TX_SIZE, TX_32X32, TX_HEIGHT, TX_HEIGHT_LOG2, TX_SIZE_SQR, TX_SIZE_SQR_UP, TX_WIDTH,
    TX_WIDTH_LOG2,
};
use crate::tile::tx_size::tx_size4;

/// Columns and rows of zeros right of and below a transform block's levels.
const PADDING: usize = 4;
/// Room for (32 + 4) * (32 + 4) levels; a power of two, so that a mask replaces bounds checks.
const LEVELS: usize = 2048;
/// Above this, a level continues with a Golomb code.
const MAX_CODED_LEVEL: u32 = NUM_BASE_LEVELS + COEFF_BASE_RANGE;

/// Buffers of one transform block.
pub(super) struct CoefficientScratch {
    /// Levels by position: `min(level, 3)` in the two upper bits, `level` (at most 15) below, so that
    /// one sum over neighbours serves both kinds of context.
    levels: [u8; LEVELS],
    /// Levels that are not zero, in coding order (last coefficient first).
    coded: [u8; 1024],
}

impl Default for CoefficientScratch {
    fn default() -> Self {
        Self {
            levels: [0; LEVELS],
            coded: [0; 1024],
        }
    }
}

/// What the levels of a transform block add up to.
#[derive(Default)]
struct LevelSums {
    total: u64,
    negative: u64,
    /// 0 zero, 1 negative, 2 positive.
    dc_category: u8,
}

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
        let area = (plane == 0).then(|| self.grid.area(y4, x4, width4 as usize, height4 as usize));

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
            self.above.coefficients[plane][cols].fill(0);
            self.left.coefficients[plane][rows].fill(0);
            self.stats[plane].zero_blocks += 1;
            self.trace.transform_block(plane, (x4, y4), tx_size, None);
            return Ok(());
        }
        let tx_type = match area {
            Some(area) => self.luma_tx_type(block, tx_size, area),
            None => self.chroma_tx_type(block, context, tx_size, x4, y4),
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
        let count = match class {
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
        let sums = read_signs(&mut self.symbols, dc_sign, &self.scratch, count)?;
        let entry = sums.total.min(63) as u8 | sums.dc_category << 6;
        self.keep_contexts(plane, (x4, y4), (width4, height4), (ss_x, ss_y), entry);
        self.count(block, plane, eob, &sums);
        Ok(())
    }

    /// §5.11.47: reads the type of a luma transform block and keeps it for chroma.
    fn luma_tx_type(&mut self, block: &Block, tx_size: u8, area: Area) -> u8 {
        let tx_type = self.read_transform_type(block, tx_size);
        area.fill(&mut self.grid.tx_type, tx_type);
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
            entries[..visible].fill(entry);
            entries[visible..].fill(0);
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
    let high = usize::from(symbols.flag(cdf)) << (bits - 1);
    (1 << bits) + 1 + high + symbols.literal(bits as u32 - 1) as usize
}

/// §8.3.2: the distributions of the levels of one transform block.
struct LevelCdfs<'a> {
    base_eob: &'a mut [Cdf3; 4],
    base: &'a mut [Cdf4; 42],
    range: &'a mut [Cdf4; 21],
}

/// §5.11.39: the levels, from the last coefficient to the first; returns how many are not zero.
fn read_levels<const CLASS: u8>(
    symbols: &mut SymbolDecoder,
    cdfs: &mut LevelCdfs,
    scratch: &mut CoefficientScratch,
    tx_size: u8,
    eob: usize,
) -> usize {
    let adjusted = ADJUSTED_TX_SIZE[tx_size as usize] as usize;
    let width_log2 = TX_WIDTH_LOG2[adjusted] as usize;
    let (width, height) = (1 << width_log2, TX_HEIGHT[adjusted] as usize);
    let stride = width + PADDING;
    let offsets = &COEFF_BASE_CTX_OFFSET[tx_size as usize];
    let scan = &scan(tx_size, CLASS)[..eob];
    let CoefficientScratch { levels, coded } = scratch;
    levels[..stride * (height + PADDING)].fill(0);
    let mut count = 0;
    for (c, &position) in scan.iter().enumerate().rev() {
        let position = position as usize;
        let (row, col) = (position >> width_log2, position & (width - 1));
        let at = position + row * PADDING;
        let near = |rows: usize, cols: usize| {
            u32::from(levels[(at + rows * stride + cols) & (LEVELS - 1)])
        };
        let close = near(0, 1)
            + near(1, 0)
            + match CLASS {
                TX_CLASS_2D => near(1, 1),
                TX_CLASS_HORIZ => near(0, 2),
                _ => near(2, 0),
            };
        let mut level = if c + 1 == eob {
            let context = eob_context(c, width * height);
            1 + u32::from(symbols.symbol(&mut cdfs.base_eob[context]))
        } else {
            let far = match CLASS {
                TX_CLASS_2D => near(0, 2) + near(2, 0),
                TX_CLASS_HORIZ => near(0, 3) + near(0, 4),
                _ => near(3, 0) + near(4, 0),
            };
            let magnitude = ((((close >> 6) + (far >> 6) + 1) >> 1) as usize).min(4);
            let context = match CLASS {
                TX_CLASS_2D if position == 0 => 0,
                TX_CLASS_2D => magnitude + offsets[row.min(4)][col.min(4)] as usize,
                TX_CLASS_HORIZ => magnitude + SIG_COEF_CONTEXTS_2D + 5 * col.min(2),
                _ => magnitude + SIG_COEF_CONTEXTS_2D + 5 * row.min(2),
            };
            symbols.symbol(&mut cdfs.base[context]).into()
        };
        if level > NUM_BASE_LEVELS {
            let magnitude = ((((close & 63) + 1) >> 1) as usize).min(6);
            let is_near_origin = match CLASS {
                TX_CLASS_2D => row < 2 && col < 2,
                TX_CLASS_HORIZ => col == 0,
                _ => row == 0,
            };
            let context = match (position, is_near_origin) {
                (0, _) => magnitude,
                (_, true) => magnitude + 7,
                _ => magnitude + 14,
            };
            level += read_range(symbols, &mut cdfs.range[context]);
        }
        if level > 0 {
            levels[at & (LEVELS - 1)] = (level.min(3) << 6 | level) as u8;
            coded[count & 1023] = level as u8;
            count += 1;
        }
    }
    // Whether the first coefficient is among them decides how its sign is read.
    count
}

/// §5.11.39 `coeff_br`, up to four times.
#[inline]
fn read_range(symbols: &mut SymbolDecoder, cdf: &mut Cdf4) -> u32 {
    const MAX_STEP: u32 = BR_CDF_SIZE as u32 - 1;
    let mut level = 0;
    for _ in 0..COEFF_BASE_RANGE / MAX_STEP {
        let step = u32::from(symbols.symbol(cdf));
        level += step;
        if step < MAX_STEP {
            break;
        }
    }
    level
}

/// §8.3.2: the context of `coeff_base_eob`.
fn eob_context(c: usize, area: usize) -> usize {
    match c {
        0 => 0,
        c if c <= area / 8 => 1,
        c if c <= area / 4 => 2,
        _ => 3,
    }
}

/// §5.11.39: signs and Golomb codes, from the first coefficient to the last.
fn read_signs(
    symbols: &mut SymbolDecoder,
    dc_sign: &mut crate::entropy::cdf::Cdf2,
    scratch: &CoefficientScratch,
    count: usize,
) -> TileResult<LevelSums> {
    let mut sums = LevelSums::default();
    let has_dc = scratch.levels[0] != 0;
    for (index, &level) in scratch.coded[..count].iter().rev().enumerate() {
        let is_dc = index == 0 && has_dc;
        let is_negative = if is_dc {
            symbols.flag(dc_sign)
        } else {
            symbols.bit()
        };
        let mut level = u32::from(level);
        if level > MAX_CODED_LEVEL {
            level = (read_golomb(symbols)? + MAX_CODED_LEVEL) & 0xF_FFFF;
        }
        if is_dc && level > 0 {
            sums.dc_category = if is_negative { 1 } else { 2 };
        }
        sums.total += u64::from(level);
        sums.negative += u64::from(is_negative);
    }
    Ok(sums)
}

/// §5.11.39: `x` of the Golomb code.
fn read_golomb(symbols: &mut SymbolDecoder) -> TileResult<u32> {
    let mut length = 1;
    while !symbols.bit() {
        length += 1;
        if length > 20 {
            let reason = "a coefficient is larger than AV1 allows";
            return Err(TileError {
                section: "6.10.37",
                reason,
            });
        }
    }
    Ok((1..length).fold(1, |x, _| x << 1 | u32::from(symbols.bit())))
}
