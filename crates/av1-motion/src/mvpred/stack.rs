//! §7.10.2 Find MV stack process.

use crate::motion::MotionVector;
use crate::tables::block_size::{BLOCK_HEIGHT, BLOCK_WIDTH};
use crate::tables::symbols::{MAX_REF_MV_STACK_SIZE, MV_BORDER, REF_CAT_LEVEL};
use crate::tile::{Block, BlockContext, TileDecoder};

/// §7.10.2: candidate vectors of a block, best first, and the contexts they imply.
pub(crate) struct MvStack {
    /// `RefStackMv`.
    pub(crate) mvs: [[MotionVector; 2]; MAX_REF_MV_STACK_SIZE],
    /// `WeightStack`.
    weights: [u32; MAX_REF_MV_STACK_SIZE],
    /// `NumMvFound`.
    pub(crate) num_found: usize,
    /// `GlobalMvs`.
    pub(crate) global_mvs: [MotionVector; 2],
    /// `NewMvContext`.
    pub(crate) new_mv_context: usize,
    /// `RefMvContext`.
    pub(crate) ref_mv_context: usize,
    /// `ZeroMvContext`.
    pub(crate) zero_mv_context: usize,
}

impl MvStack {
    /// §7.10.2.14 `DrlCtxStack[ idx ]`.
    pub(crate) fn drl_context(&self, idx: usize) -> usize {
        if idx + 1 >= self.num_found {
            return 0;
        }
        match (
            self.weights[idx] >= REF_CAT_LEVEL,
            self.weights[idx + 1] >= REF_CAT_LEVEL,
        ) {
            (true, true) => 0,
            (true, false) => 1,
            (false, _) => 2,
        }
    }

    /// §7.10.2.6, §7.10.2.8, §7.10.2.9: adds `weight` to an equal entry or appends one; its index, or
    /// one past the end when there is no room. The second vector of single prediction is zero
    /// throughout.
    pub(super) fn add(&mut self, mvs: [MotionVector; 2], weight: u32) -> usize {
        let (found, key) = (self.num_found, key(mvs));
        let index = self.mvs[..found]
            .iter()
            .position(|&entry| self::key(entry) == key)
            .unwrap_or(found);
        if index < found {
            self.weights[index] += weight;
        } else if found < MAX_REF_MV_STACK_SIZE {
            self.push(mvs, weight);
        }
        index
    }

    /// Adds to the weight of an entry that [`MvStack::add`] named.
    #[inline]
    pub(super) fn add_weight(&mut self, index: usize, weight: u32) {
        if let Some(sum) = self.weights.get_mut(index) {
            *sum += weight;
        }
    }

    /// Appends an entry; the caller knows that there is room.
    #[inline]
    pub(super) fn push(&mut self, mvs: [MotionVector; 2], weight: u32) {
        self.mvs[self.num_found] = mvs;
        self.weights[self.num_found] = weight;
        self.num_found += 1;
    }

    /// §7.10.2.11 Sorting process: a stable sort by falling weight, without branches on the weights.
    /// The nearest candidates stay in front, because [`REF_CAT_LEVEL`] is more than all others weigh.
    fn sort(&mut self) {
        const ENTRIES: usize = MAX_REF_MV_STACK_SIZE;
        let mut keys = [0_u16; ENTRIES];
        for (i, key) in keys.iter_mut().enumerate() {
            *key = (self.weights[i] * ENTRIES as u32) as u16 + (ENTRIES - 1 - i) as u16;
        }
        let mut ranks = [0_u16; ENTRIES];
        for other in keys {
            for (rank, key) in ranks.iter_mut().zip(keys) {
                *rank += u16::from(other > key);
            }
        }
        let (mvs, weights) = (self.mvs, self.weights);
        for i in 0..self.num_found {
            let rank = ranks[i] as usize & (ENTRIES - 1);
            self.mvs[rank] = mvs[i];
            self.weights[rank] = weights[i];
        }
    }
}

/// Two vectors as one word, which is compared at once.
#[inline]
fn key(mvs: [MotionVector; 2]) -> u64 {
    let half = |mv: MotionVector| u64::from(mv.row as u16) | u64::from(mv.col as u16) << 16;
    half(mvs[0]) | half(mvs[1]) << 32
}

/// The search for the candidates of one block.
pub(super) struct Search<'a> {
    pub(super) tile: &'a TileDecoder<'a>,
    pub(super) block: &'a Block,
    pub(super) is_compound: bool,
    pub(super) stack: &'a mut MvStack,
    /// `FoundMatch`.
    pub(super) found_match: bool,
    /// Whether `NewMvCount` is not 0.
    pub(super) found_new_mv: bool,
}

impl TileDecoder<'_> {
    /// §7.10.2 `find_mv_stack`.
    pub(crate) fn find_mv_stack(&self, block: &Block, context: &BlockContext) -> MvStack {
        let is_compound = block.is_compound();
        let mut global_mvs = [self.global_mv(block, 0), MotionVector::ZERO];
        if is_compound {
            global_mvs[1] = self.global_mv(block, 1);
        }
        let mut stack = MvStack {
            mvs: [[MotionVector::ZERO; 2]; MAX_REF_MV_STACK_SIZE],
            weights: [0; MAX_REF_MV_STACK_SIZE],
            num_found: 0,
            global_mvs,
            new_mv_context: 0,
            ref_mv_context: 0,
            zero_mv_context: 0,
        };
        let mut search = Search {
            tile: self,
            block,
            is_compound,
            stack: &mut stack,
            found_match: false,
            found_new_mv: false,
        };
        search.run(context);
        stack
    }
}

impl Search<'_> {
    /// §7.10.2, the ordered steps.
    fn run(&mut self, context: &BlockContext) {
        let (width4, height4) = (self.block.width4() as i32, self.block.height4() as i32);
        self.scan_row(-1);
        let mut found_above = self.take_match();
        self.scan_col(-1);
        let mut found_left = self.take_match();
        if width4.max(height4) <= 16 {
            self.scan_point(-1, width4);
        }
        found_above |= self.take_match();
        let close_matches = usize::from(found_above) + usize::from(found_left);
        let num_nearest = self.stack.num_found;
        let has_new = self.found_new_mv;
        for weight in &mut self.stack.weights[..num_nearest] {
            *weight += REF_CAT_LEVEL;
        }
        if self.tile.frame.header.use_ref_frame_mvs {
            self.temporal_scan();
        }
        self.scan_point(-1, -1);
        found_above |= self.take_match();
        self.scan_row(-3);
        found_above |= self.take_match();
        self.scan_col(-3);
        found_left |= self.take_match();
        if height4 > 1 {
            self.scan_row(-5);
        }
        found_above |= self.take_match();
        if width4 > 1 {
            self.scan_col(-5);
        }
        found_left |= self.take_match();
        let total_matches = usize::from(found_above) + usize::from(found_left);
        if self.stack.num_found > 1 {
            self.stack.sort();
        }
        if self.stack.num_found < 2 {
            self.extra_search(context);
        }
        self.set_contexts(close_matches, total_matches, has_new);
        self.clamp();
    }

    /// Reads and clears `FoundMatch`.
    fn take_match(&mut self) -> bool {
        std::mem::take(&mut self.found_match)
    }

    /// §7.10.2.14: `NewMvContext` and `RefMvContext`.
    fn set_contexts(&mut self, close_matches: usize, total_matches: usize, has_new: bool) {
        let new = usize::from(has_new);
        (self.stack.new_mv_context, self.stack.ref_mv_context) = match close_matches {
            0 => (total_matches.min(1), total_matches),
            1 => (3 - new, 2 + total_matches),
            _ => (5 - new, 5),
        };
    }

    /// §7.10.2.14: keeps the candidates near the frame.
    fn clamp(&mut self) {
        let size = self.block.size as usize;
        let frame = &self.tile.frame.header.size;
        let limits = |mi: u32, mi_end: u32, samples: u8| {
            let border = MV_BORDER + i32::from(samples) * 8;
            let (mi, samples4) = (mi as i32, i32::from(samples) / 4);
            let to_start = -(mi * 4 * 8);
            let to_end = (mi_end as i32 - samples4 - mi) * 4 * 8;
            let narrow = |limit: i32| limit.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
            (narrow(to_start - border), narrow(to_end + border))
        };
        let rows = limits(self.block.mi_row, frame.mi_rows, BLOCK_HEIGHT[size]);
        let cols = limits(self.block.mi_col, frame.mi_cols, BLOCK_WIDTH[size]);
        // The second vector of single prediction stays zero.
        for mv in self.stack.mvs[..self.stack.num_found].as_flattened_mut() {
            mv.row = mv.row.max(rows.0).min(rows.1);
            mv.col = mv.col.max(cols.0).min(cols.1);
        }
    }
}
