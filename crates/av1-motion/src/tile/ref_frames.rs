//! §5.11.25 Ref frames.

use super::{Block, BlockContext, TileDecoder};
use crate::tables::symbols::{
    ALTREF_FRAME, ALTREF2_FRAME, BWDREF_FRAME, GOLDEN_FRAME, LAST_FRAME, LAST2_FRAME, LAST3_FRAME,
    NONE, SEG_LVL_GLOBALMV, SEG_LVL_REF_FRAME, SEG_LVL_SKIP,
};

/// §8.3.2 `count_refs` for every reference name at once.
struct ReferenceCounts([u8; 8]);

impl ReferenceCounts {
    fn new(context: &BlockContext) -> Self {
        let mut counts = [0; 8];
        for neighbor in [&context.above, &context.left].into_iter().flatten() {
            for reference in neighbor.ref_frame {
                if reference > 0 {
                    counts[reference as usize] += 1;
                }
            }
        }
        Self(counts)
    }

    /// §8.3.2 `ref_count_ctx`: compares how often two groups of references were used.
    fn context(&self, group0: &[i8], group1: &[i8]) -> usize {
        let total = |group: &[i8]| group.iter().map(|&name| self.0[name as usize]).sum::<u8>();
        match total(group0).cmp(&total(group1)) {
            std::cmp::Ordering::Less => 0,
            std::cmp::Ordering::Equal => 1,
            std::cmp::Ordering::Greater => 2,
        }
    }

    fn forward_or_backward(&self) -> usize {
        self.context(
            &[LAST_FRAME, LAST2_FRAME, LAST3_FRAME, GOLDEN_FRAME],
            &[BWDREF_FRAME, ALTREF2_FRAME, ALTREF_FRAME],
        )
    }

    fn last12_or_last3_gold(&self) -> usize {
        self.context(&[LAST_FRAME, LAST2_FRAME], &[LAST3_FRAME, GOLDEN_FRAME])
    }

    fn last_or_last2(&self) -> usize {
        self.context(&[LAST_FRAME], &[LAST2_FRAME])
    }

    fn last3_or_gold(&self) -> usize {
        self.context(&[LAST3_FRAME], &[GOLDEN_FRAME])
    }

    fn last2_or_last3_gold(&self) -> usize {
        self.context(&[LAST2_FRAME], &[LAST3_FRAME, GOLDEN_FRAME])
    }

    fn bwd_alt2_or_alt(&self) -> usize {
        self.context(&[BWDREF_FRAME, ALTREF2_FRAME], &[ALTREF_FRAME])
    }

    fn bwd_or_alt2(&self) -> usize {
        self.context(&[BWDREF_FRAME], &[ALTREF2_FRAME])
    }
}

impl TileDecoder<'_> {
    /// §5.11.25 `read_ref_frames`.
    pub(super) fn read_ref_frames(&mut self, block: &mut Block, context: &BlockContext) {
        let header = &self.frame.header;
        let is_active = |feature| {
            header
                .segmentation
                .feature_active(block.segment_id, feature)
        };
        block.ref_frame = if block.skip_mode {
            header.skip_mode_frame.map(|name| name as i8)
        } else if is_active(SEG_LVL_REF_FRAME) {
            let data = header.segmentation.feature_data[block.segment_id as usize];
            [data[SEG_LVL_REF_FRAME] as i8, NONE]
        } else if is_active(SEG_LVL_SKIP) || is_active(SEG_LVL_GLOBALMV) {
            [LAST_FRAME, NONE]
        } else {
            let counts = ReferenceCounts::new(context);
            let is_compound = header.reference_select
                && block.width4().min(block.height4()) >= 2
                && self
                    .symbols
                    .flag(&mut self.cdfs.comp_mode[comp_mode_context(context)]);
            if is_compound {
                self.read_compound_references(context, &counts)
            } else {
                [self.read_single_reference(&counts), NONE]
            }
        };
    }

    /// §5.11.25: `single_ref_p1` to `single_ref_p6`.
    fn read_single_reference(&mut self, counts: &ReferenceCounts) -> i8 {
        let (symbols, cdfs) = (&mut self.symbols, &mut self.cdfs.single_ref);
        if symbols.flag(&mut cdfs[counts.forward_or_backward()][0]) {
            if symbols.flag(&mut cdfs[counts.bwd_alt2_or_alt()][1]) {
                ALTREF_FRAME
            } else if symbols.flag(&mut cdfs[counts.bwd_or_alt2()][5]) {
                ALTREF2_FRAME
            } else {
                BWDREF_FRAME
            }
        } else if symbols.flag(&mut cdfs[counts.last12_or_last3_gold()][2]) {
            if symbols.flag(&mut cdfs[counts.last3_or_gold()][4]) {
                GOLDEN_FRAME
            } else {
                LAST3_FRAME
            }
        } else if symbols.flag(&mut cdfs[counts.last_or_last2()][3]) {
            LAST2_FRAME
        } else {
            LAST_FRAME
        }
    }

    /// §5.11.25: `comp_ref_type` and the pair of references.
    fn read_compound_references(
        &mut self,
        context: &BlockContext,
        counts: &ReferenceCounts,
    ) -> [i8; 2] {
        let (symbols, cdfs) = (&mut self.symbols, &mut *self.cdfs);
        let is_bidirectional =
            symbols.flag(&mut cdfs.comp_ref_type[comp_ref_type_context(context)]);
        if !is_bidirectional {
            let uni = &mut cdfs.uni_comp_ref;
            return if symbols.flag(&mut uni[counts.forward_or_backward()][0]) {
                [BWDREF_FRAME, ALTREF_FRAME]
            } else if !symbols.flag(&mut uni[counts.last2_or_last3_gold()][1]) {
                [LAST_FRAME, LAST2_FRAME]
            } else if symbols.flag(&mut uni[counts.last3_or_gold()][2]) {
                [LAST_FRAME, GOLDEN_FRAME]
            } else {
                [LAST_FRAME, LAST3_FRAME]
            };
        }
        let forward = if symbols.flag(&mut cdfs.comp_ref[counts.last12_or_last3_gold()][0]) {
            let is_gold = symbols.flag(&mut cdfs.comp_ref[counts.last3_or_gold()][2]);
            if is_gold { GOLDEN_FRAME } else { LAST3_FRAME }
        } else {
            let is_last2 = symbols.flag(&mut cdfs.comp_ref[counts.last_or_last2()][1]);
            if is_last2 { LAST2_FRAME } else { LAST_FRAME }
        };
        let backward = if symbols.flag(&mut cdfs.comp_bwd_ref[counts.bwd_alt2_or_alt()][0]) {
            ALTREF_FRAME
        } else if symbols.flag(&mut cdfs.comp_bwd_ref[counts.bwd_or_alt2()][1]) {
            ALTREF2_FRAME
        } else {
            BWDREF_FRAME
        };
        [forward, backward]
    }
}

/// §8.3.2 `check_backward`.
fn is_backward(name: i8) -> bool {
    name >= BWDREF_FRAME
}

/// §8.3.2: the context of `comp_mode`.
fn comp_mode_context(context: &BlockContext) -> usize {
    let of_one = |neighbor: &Block| {
        if neighbor.is_single() {
            usize::from(is_backward(neighbor.ref_frame[0]))
        } else {
            3
        }
    };
    match (&context.above, &context.left) {
        (None, None) => 1,
        (Some(neighbor), None) | (None, Some(neighbor)) => of_one(neighbor),
        (Some(above), Some(left)) => match (above.is_single(), left.is_single()) {
            (true, true) => {
                usize::from(is_backward(above.ref_frame[0]) ^ is_backward(left.ref_frame[0]))
            }
            (false, false) => 4,
            (is_above_single, _) => {
                let single = if is_above_single { above } else { left };
                2 + usize::from(is_backward(single.ref_frame[0]) || single.is_intra_reference())
            }
        },
    }
}

/// §8.3.2: the context of `comp_ref_type`.
fn comp_ref_type_context(context: &BlockContext) -> usize {
    let same_direction = |a: i8, b: i8| is_backward(a) == is_backward(b);
    let is_compound = |block: &Block| !block.is_intra_reference() && !block.is_single();
    let is_uni = |block: &Block| {
        is_compound(block) && same_direction(block.ref_frame[0], block.ref_frame[1])
    };
    match (&context.above, &context.left) {
        (Some(above), Some(left)) if !above.is_intra_reference() && !left.is_intra_reference() => {
            let same = usize::from(same_direction(above.ref_frame[0], left.ref_frame[0]));
            match (is_compound(above), is_compound(left)) {
                (false, false) => 1 + 2 * same,
                (false, true) => {
                    if is_uni(left) {
                        3 + same
                    } else {
                        1
                    }
                }
                (true, false) => {
                    if is_uni(above) {
                        3 + same
                    } else {
                        1
                    }
                }
                (true, true) => match (is_uni(above), is_uni(left)) {
                    (false, false) => 0,
                    (true, true) => {
                        let both = (above.ref_frame[0] == BWDREF_FRAME)
                            == (left.ref_frame[0] == BWDREF_FRAME);
                        3 + usize::from(both)
                    }
                    _ => 2,
                },
            }
        }
        (Some(above), Some(left)) => {
            if is_compound(above) {
                1 + 2 * usize::from(is_uni(above))
            } else if is_compound(left) {
                1 + 2 * usize::from(is_uni(left))
            } else {
                2
            }
        }
        (Some(neighbor), None) | (None, Some(neighbor)) if is_compound(neighbor) => {
            4 * usize::from(is_uni(neighbor))
        }
        _ => 2,
    }
}
