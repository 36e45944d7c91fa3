//! §5.11.40 Compute transform type, §5.11.47 Transform type, §5.11.48 Get transform set.

use super::{Block, BlockContext, TileDecoder};
use crate::tables::contexts::FILTER_INTRA_MODE_TO_INTRA_DIR;
use crate::tables::symbols::{
    DCT_DCT, TX_SET_DCTONLY, TX_SET_INTER_1, TX_SET_INTER_2, TX_SET_INTER_3, TX_SET_INTRA_1,
    TX_SET_INTRA_2,
};
use crate::tables::tx_size::{TX_16X16, TX_32X32, TX_SIZE_SQR, TX_SIZE_SQR_UP};
use crate::tables::tx_type::{
    MODE_TO_TXFM, TX_TYPE_IN_SET_INTER, TX_TYPE_IN_SET_INTRA, TX_TYPE_INTER_INV_SET1,
    TX_TYPE_INTER_INV_SET2, TX_TYPE_INTER_INV_SET3, TX_TYPE_INTRA_INV_SET1, TX_TYPE_INTRA_INV_SET2,
};

impl TileDecoder<'_> {
    /// §5.11.48 `get_tx_set`.
    fn tx_set(&self, block: &Block, size: u8) -> u8 {
        let (sqr, sqr_up) = (TX_SIZE_SQR[size as usize], TX_SIZE_SQR_UP[size as usize]);
        let is_reduced = self.frame.header.reduced_tx_set;
        if sqr_up > TX_32X32 {
            return TX_SET_DCTONLY;
        }
        if block.is_inter {
            if is_reduced || sqr_up == TX_32X32 {
                TX_SET_INTER_3
            } else if sqr == TX_16X16 {
                TX_SET_INTER_2
            } else {
                TX_SET_INTER_1
            }
        } else if sqr_up == TX_32X32 {
            TX_SET_DCTONLY
        } else if is_reduced || sqr == TX_16X16 {
            TX_SET_INTRA_2
        } else {
            TX_SET_INTRA_1
        }
    }

    /// §5.11.47 `transform_type` of a luma transform block.
    pub(super) fn read_transform_type(&mut self, block: &Block, size: u8) -> u8 {
        let set = self.tx_set(block, size);
        if set == TX_SET_DCTONLY || !self.frame.codes_tx_type[block.segment_id as usize] {
            return DCT_DCT;
        }
        let sqr = TX_SIZE_SQR[size as usize] as usize;
        let (symbols, cdfs) = (&mut self.symbols, &mut *self.cdfs);
        if block.is_inter {
            return match set {
                TX_SET_INTER_1 => {
                    let symbol = symbols.symbol(&mut cdfs.inter_tx_type_set1[sqr]);
                    TX_TYPE_INTER_INV_SET1[symbol as usize]
                }
                TX_SET_INTER_2 => {
                    let symbol = symbols.symbol(&mut cdfs.inter_tx_type_set2);
                    TX_TYPE_INTER_INV_SET2[symbol as usize]
                }
                _ => {
                    let symbol = symbols.flag(&mut cdfs.inter_tx_type_set3[sqr]);
                    TX_TYPE_INTER_INV_SET3[usize::from(symbol)]
                }
            };
        }
        let direction = if block.use_filter_intra {
            FILTER_INTRA_MODE_TO_INTRA_DIR[block.filter_intra_mode as usize]
        } else {
            block.y_mode
        } as usize;
        if set == TX_SET_INTRA_1 {
            let symbol = symbols.symbol(&mut cdfs.intra_tx_type_set1[sqr][direction]);
            TX_TYPE_INTRA_INV_SET1[symbol as usize]
        } else {
            let symbol = symbols.symbol(&mut cdfs.intra_tx_type_set2[sqr][direction]);
            TX_TYPE_INTRA_INV_SET2[symbol as usize]
        }
    }

    /// §5.11.40 `compute_tx_type` of a chroma transform block at (`x4`, `y4`) of its plane.
    pub(super) fn chroma_tx_type(
        &self,
        block: &Block,
        context: &BlockContext,
        size: u8,
        x4: u32,
        y4: u32,
    ) -> u8 {
        if context.lossless || TX_SIZE_SQR_UP[size as usize] > TX_32X32 {
            return DCT_DCT;
        }
        let set = self.tx_set(block, size) as usize;
        let (tx_type, is_in_set) = if block.is_inter {
            let color = &self.frame.sequence.color;
            let col = block.mi_col.max(x4 << color.subsampling_x);
            let row = block.mi_row.max(y4 << color.subsampling_y);
            let tx_type = self.grid.tx_type[self.grid.cell(row, col)];
            (tx_type, TX_TYPE_IN_SET_INTER[set][tx_type as usize])
        } else {
            let tx_type = MODE_TO_TXFM[block.uv_mode as usize];
            (tx_type, TX_TYPE_IN_SET_INTRA[set][tx_type as usize])
        };
        if is_in_set == 1 { tx_type } else { DCT_DCT }
    }
}
