//! §5.11.46 Palette mode info, §5.11.49 Palette tokens, §5.11.50 Palette color context.

use super::segment_id::count;
use super::{Block, BlockContext, TileDecoder};
use crate::entropy::cdf_set::CdfSet;
use crate::entropy::symbol::SymbolDecoder;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH, MI_HEIGHT_LOG2, MI_WIDTH_LOG2};
use crate::tables::contexts::{PALETTE_COLOR_CONTEXT, PALETTE_COLOR_HASH_MULTIPLIERS};
use crate::tables::symbols::{DC_PRED, PALETTE_COLORS, PALETTE_NUM_NEIGHBORS};

/// The colour indices of one block.
pub(super) struct PaletteScratch {
    map: [[u8; 64]; 64],
}

impl Default for PaletteScratch {
    fn default() -> Self {
        Self { map: [[0; 64]; 64] }
    }
}

impl TileDecoder<'_> {
    /// §5.11.46 `palette_mode_info`.
    pub(super) fn palette_mode_info(&mut self, block: &mut Block, context: &BlockContext) {
        let size = block.size as usize;
        let size_context = (MI_WIDTH_LOG2[size] + MI_HEIGHT_LOG2[size] - 2) as usize;
        if block.y_mode == DC_PRED {
            let cdf_context = count(context, |block| block.palette_size[0] > 0);
            let cdf = &mut self.cdfs.palette_y_mode[size_context][cdf_context];
            if self.symbols.flag(cdf) {
                let symbol = self
                    .symbols
                    .symbol(&mut self.cdfs.palette_y_size[size_context]);
                block.palette_size[0] = symbol + 2;
                self.read_palette_colors(block, context, 0);
            }
        }
        if block.has_chroma && block.uv_mode == DC_PRED {
            let cdf_context = usize::from(block.palette_size[0] > 0);
            if self
                .symbols
                .flag(&mut self.cdfs.palette_uv_mode[cdf_context])
            {
                let symbol = self
                    .symbols
                    .symbol(&mut self.cdfs.palette_uv_size[size_context]);
                block.palette_size[1] = symbol + 2;
                self.read_palette_colors(block, context, 1);
                self.read_palette_colors_v(block.palette_size[1].into());
            }
        }
    }

    /// §5.11.46: the colours of Y (plane 0) or U (plane 1), kept for the neighbours.
    fn read_palette_colors(&mut self, block: &Block, context: &BlockContext, plane: usize) {
        let bit_depth = u32::from(self.frame.sequence.color.bit_depth);
        let size = block.palette_size[plane] as usize;
        let (cache, cached) = self.palette_cache(block, context, plane);
        let symbols = &mut self.symbols;
        let mut colors = [0; PALETTE_COLORS];
        let mut idx = 0;
        for &color in &cache[..cached] {
            if idx == size {
                break;
            }
            if symbols.bit() {
                colors[idx] = color;
                idx += 1;
            }
        }
        if idx < size {
            colors[idx] = symbols.literal(bit_depth) as u16;
            idx += 1;
        }
        if idx < size {
            let max = (1 << bit_depth) - 1;
            let mut bits = bit_depth - 3 + symbols.literal(2);
            // Y differences are at least 1.
            let least = u32::from(plane == 0);
            while idx < size {
                let delta = symbols.literal(bits) + least;
                let color = (u32::from(colors[idx - 1]) + delta).min(max);
                colors[idx] = color as u16;
                bits = bits.min(ceil_log2(max + 1 - color - least));
                idx += 1;
            }
        }
        colors[..size].sort_unstable();
        let col = self.bounds.col(block.mi_col);
        let row = block.mi_row as usize & 31;
        self.above.palette[plane][col..col + block.width4()].fill(colors);
        self.left.palette[plane][row..row + block.height4()].fill(colors);
    }

    /// §5.11.46: the colours of V, which nothing later depends on.
    fn read_palette_colors_v(&mut self, size: usize) {
        let bit_depth = u32::from(self.frame.sequence.color.bit_depth);
        let symbols = &mut self.symbols;
        if !symbols.bit() {
            for _ in 0..size {
                symbols.literal(bit_depth);
            }
            return;
        }
        let bits = bit_depth - 4 + symbols.literal(2);
        symbols.literal(bit_depth);
        for _ in 1..size {
            if symbols.literal(bits) != 0 {
                symbols.bit();
            }
        }
    }

    /// §5.11.46 `get_palette_cache`: the colours above and to the left, sorted, without repetitions.
    fn palette_cache(
        &self,
        block: &Block,
        context: &BlockContext,
        plane: usize,
    ) -> ([u16; 2 * PALETTE_COLORS], usize) {
        let row = block.mi_row as usize & 31;
        let above = context
            .above
            .as_ref()
            .filter(|_| !block.mi_row.is_multiple_of(16))
            .map_or(0, |above| above.palette_size[plane] as usize);
        let left = context
            .left
            .as_ref()
            .map_or(0, |left| left.palette_size[plane] as usize);
        let above_colors = &self.above.palette[plane][self.bounds.col(block.mi_col)];
        let left_colors = &self.left.palette[plane][row];
        let mut cache = [0; 2 * PALETTE_COLORS];
        cache[..above].copy_from_slice(&above_colors[..above]);
        cache[above..above + left].copy_from_slice(&left_colors[..left]);
        let colors = &mut cache[..above + left];
        colors.sort_unstable();
        let mut unique = 0;
        for idx in 0..above + left {
            if unique == 0 || cache[idx] != cache[unique - 1] {
                cache[unique] = cache[idx];
                unique += 1;
            }
        }
        (cache, unique)
    }

    /// §5.11.49 `palette_tokens`.
    pub(super) fn palette_tokens(&mut self, block: &Block) {
        let size = block.size as usize;
        let frame = &self.frame.header.size;
        let color = &self.frame.sequence.color;
        let mut width = u32::from(BLOCK_WIDTH[size]).min((frame.mi_cols - block.mi_col) * 4);
        let mut height = u32::from(BLOCK_HEIGHT[size]).min((frame.mi_rows - block.mi_row) * 4);
        if block.palette_size[0] > 0 {
            self.read_color_map(0, block.palette_size[0], width as usize, height as usize);
        }
        if block.palette_size[1] > 0 {
            let block_width = BLOCK_WIDTH[size] >> color.subsampling_x;
            let block_height = BLOCK_HEIGHT[size] >> color.subsampling_y;
            width = (width >> color.subsampling_x) + if block_width < 4 { 2 } else { 0 };
            height = (height >> color.subsampling_y) + if block_height < 4 { 2 } else { 0 };
            self.read_color_map(1, block.palette_size[1], width as usize, height as usize);
        }
    }

    /// §5.11.49: the visible part of a colour map, along its anti-diagonals.
    fn read_color_map(&mut self, plane: usize, size: u8, width: usize, height: usize) {
        let map = &mut self.palette.map;
        map[0][0] = self.symbols.non_symmetric(size.into()) as u8;
        for i in 1..height + width - 1 {
            for j in (i.saturating_sub(height - 1)..=i.min(width - 1)).rev() {
                let (order, hash) = color_order(map, i - j, j, size as usize);
                let context = PALETTE_COLOR_CONTEXT[hash] as usize;
                let symbol =
                    read_color_idx(&mut self.symbols, &mut self.cdfs, plane, size, context);
                map[i - j][j] = order[symbol as usize];
            }
        }
    }
}

/// §4.7 `CeilLog2`.
fn ceil_log2(value: u32) -> u32 {
    if value < 2 {
        0
    } else {
        (value - 1).ilog2() + 1
    }
}

/// §5.11.50 `get_palette_color_context`: `ColorOrder` and `ColorContextHash`.
fn color_order(
    map: &[[u8; 64]; 64],
    row: usize,
    col: usize,
    size: usize,
) -> ([u8; PALETTE_COLORS], usize) {
    let mut scores = [0_u8; PALETTE_COLORS];
    let mut order = [0, 1, 2, 3, 4, 5, 6, 7];
    if col > 0 {
        scores[map[row][col - 1] as usize] += 2;
    }
    if row > 0 && col > 0 {
        scores[map[row - 1][col - 1] as usize] += 1;
    }
    if row > 0 {
        scores[map[row - 1][col] as usize] += 2;
    }
    for i in 0..PALETTE_NUM_NEIGHBORS {
        let mut best = i;
        for j in i + 1..size {
            if scores[j] > scores[best] {
                best = j;
            }
        }
        scores[i..=best].rotate_right(1);
        order[i..=best].rotate_right(1);
    }
    let hash = scores
        .iter()
        .zip(PALETTE_COLOR_HASH_MULTIPLIERS)
        .map(|(&score, multiplier)| usize::from(score * multiplier))
        .sum();
    (order, hash)
}

/// §8.3.2 `palette_color_idx_y`, `palette_color_idx_uv`.
fn read_color_idx(
    symbols: &mut SymbolDecoder,
    cdfs: &mut CdfSet,
    plane: usize,
    size: u8,
    context: usize,
) -> u8 {
    macro_rules! read {
        ($y:ident, $uv:ident, $method:ident) => {{
            let cdf = if plane == 0 {
                &mut cdfs.$y[context]
            } else {
                &mut cdfs.$uv[context]
            };
            u8::from(symbols.$method(cdf))
        }};
    }
    match size {
        2 => read!(palette_size_2_y_color, palette_size_2_uv_color, flag),
        3 => read!(palette_size_3_y_color, palette_size_3_uv_color, symbol),
        4 => read!(palette_size_4_y_color, palette_size_4_uv_color, symbol),
        5 => read!(palette_size_5_y_color, palette_size_5_uv_color, symbol),
        6 => read!(palette_size_6_y_color, palette_size_6_uv_color, symbol),
        7 => read!(palette_size_7_y_color, palette_size_7_uv_color, symbol),
        _ => read!(palette_size_8_y_color, palette_size_8_uv_color, symbol),
    }
}
