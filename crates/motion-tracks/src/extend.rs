//! Second walk, in decode order: tracks reach on into the frames that refer to them.
//!
//! The first walk can only follow a vector from its frame into the reference, and starts at block
//! centres. Read the other way round, a block also tells where a point of its reference lies in the
//! block's own frame. So tracks gain observations in frames that nothing else refers to, and
//! in large blocks, which hold one centre but many points.

use std::collections::BTreeMap;

use crate::cells::Cells;
use crate::chain::{Chain, NONE};
use crate::field::{center, half_sizes};
use crate::link::Layer;

/// A track's point in one frame.
#[derive(Clone, Copy, Debug)]
struct Point {
    track: u32,
    xy: [f32; 2],
    variance: f32,
}

/// State of the second walk.
pub(crate) struct Extension<'a> {
    chain: &'a mut Chain,
    points: BTreeMap<i32, Vec<Point>>,
}

impl<'a> Extension<'a> {
    /// Takes the tracks that are long enough to be kept.
    pub(crate) fn new(chain: &'a mut Chain) -> Self {
        let mut points: BTreeMap<i32, Vec<Point>> = BTreeMap::new();
        for observation in &chain.observations {
            if chain.is_kept(observation.track) {
                let point = Point {
                    track: observation.track,
                    xy: observation.xy,
                    variance: observation.variance,
                };
                points.entry(observation.frame).or_default().push(point);
            }
        }
        Self { chain, points }
    }

    /// Handles one coded frame; they are visited in decode order.
    pub(crate) fn visit(&mut self, layer: &Layer) {
        let mut cells = self.chain.cells(layer.frame, layer.width, layer.height);
        for point in self.points.get(&layer.frame).into_iter().flatten() {
            cells.claim(point.xy);
        }
        let mut references = layer.references.clone();
        references.sort_unstable_by_key(|reference| (reference.abs_diff(layer.frame), *reference));
        references.dedup();
        for reference in references {
            self.extend_from(layer, reference, &mut cells);
        }
    }

    fn extend_from(&mut self, layer: &Layer, reference: i32, cells: &mut Cells) {
        let Some(mut points) = self.points.get(&reference).cloned() else {
            return;
        };
        points.retain(|point| self.chain.is_new(point.track, layer.frame));
        let length = |point: &Point| self.chain.growth[point.track as usize].length;
        points.sort_by_key(|point| (std::cmp::Reverse(length(point)), point.track));
        let landing = Landing::new(layer, reference);
        for point in points {
            let Some((xy, row)) = landing.origin_of(layer, point.xy) else {
                continue;
            };
            let agrees = self.goes_straight(&point, reference, xy, layer.frame);
            let variance = point.variance + layer.variance(row);
            if agrees && self.chain.holds(variance) && cells.contains(xy) && cells.claim(xy) {
                self.chain.observe(point.track, layer.frame, xy, variance);
                let point = Point {
                    xy,
                    variance,
                    ..point
                };
                self.points.entry(layer.frame).or_default().push(point);
            }
        }
    }

    /// Whether the step from `xy` in `frame` to the point agrees with the track's next one.
    fn goes_straight(&self, point: &Point, reference: i32, xy: [f32; 2], frame: i32) -> bool {
        let (Some(cosine), true) = (self.chain.options.cosine, reference < frame) else {
            return true;
        };
        let step = [point.xy[0] - xy[0], point.xy[1] - xy[1]];
        let mut nearest: Option<(i32, [f32; 2])> = None;
        let mut at = self.chain.growth[point.track as usize].last;
        while at != NONE {
            let observation = &self.chain.observations[at as usize];
            if observation.frame < reference
                && nearest.is_none_or(|(found, _)| found < observation.frame)
            {
                nearest = Some((observation.frame, observation.xy));
            }
            at = self.chain.previous[at as usize];
        }
        nearest.is_none_or(|(_, next)| {
            cosine.accepts(step, [next[0] - point.xy[0], next[1] - point.xy[1]])
        })
    }
}

/// Side of the bins of [`Landing`], px.
const BIN: i32 = 32;

/// Where the blocks of one frame come to lie in one reference.
struct Landing {
    columns: i32,
    lines: i32,
    starts: Vec<u32>,
    rows: Vec<u32>,
}

impl Landing {
    fn new(layer: &Layer, reference: i32) -> Self {
        let side =
            |length: u32| i32::try_from(length.div_ceil(BIN.unsigned_abs())).unwrap_or(i32::MAX);
        let (columns, lines) = (side(layer.width), side(layer.height));
        let mut landing = Self {
            columns,
            lines,
            starts: Vec::new(),
            rows: Vec::new(),
        };
        let mut entries: Vec<(u32, u32)> = Vec::new();
        for (row, index) in (0..layer.len()).zip(0_u32..) {
            if layer.references[row] == reference {
                landing.bins_of(layer, row, |bin| entries.push((bin, index)));
            }
        }
        landing.starts = vec![0; (columns * lines).unsigned_abs() as usize + 1];
        for &(bin, _) in &entries {
            landing.starts[bin as usize + 1] += 1;
        }
        for bin in 1..landing.starts.len() {
            landing.starts[bin] += landing.starts[bin - 1];
        }
        entries.sort_unstable();
        landing.rows = entries.iter().map(|&(_, row)| row).collect();
        landing
    }

    /// Calls `visit` with every bin that the moved block touches.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "vectors are at most 2^16 px long"
    )]
    fn bins_of(&self, layer: &Layer, row: usize, mut visit: impl FnMut(u32)) {
        let [x, y, w, h] = layer.block(row);
        let mut low = [i32::MAX; 2];
        let mut high = [i32::MIN; 2];
        let (half_width, half_height) = (f64::from(w) / 2.0, f64::from(h) / 2.0);
        for (sign_x, sign_y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            let offset = [(sign_x * half_width) as f32, (sign_y * half_height) as f32];
            let moved = layer.motion(row).at(offset);
            let corner = [f64::from(x) + half_width, f64::from(y) + half_height];
            for axis in 0..2 {
                let at = (corner[axis] + f64::from(offset[axis] + moved[axis])) as i32;
                low[axis] = low[axis].min(at.div_euclid(BIN));
                high[axis] = high[axis].max(at.div_euclid(BIN));
            }
        }
        for line in low[1].max(0)..=high[1].min(self.lines - 1) {
            for column in low[0].max(0)..=high[0].min(self.columns - 1) {
                visit((line * self.columns + column).unsigned_abs());
            }
        }
    }

    /// Point of the frame that its block moves to `xy` in the reference; the one nearest to its
    /// block's centre where blocks land on each other.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "observations lie inside the picture"
    )]
    fn origin_of(&self, layer: &Layer, xy: [f32; 2]) -> Option<([f32; 2], usize)> {
        let [column, line] = xy.map(|value| (value as i32).div_euclid(BIN));
        if !(0..self.columns).contains(&column) || !(0..self.lines).contains(&line) {
            return None;
        }
        let bin = (line * self.columns + column).unsigned_abs() as usize;
        let rows = &self.rows[self.starts[bin] as usize..self.starts[bin + 1] as usize];
        let mut best: Option<(f32, [f32; 2], usize)> = None;
        for &row in rows {
            let block = layer.block(row as usize);
            let middle = center(block);
            let arrived = [xy[0] - middle[0], xy[1] - middle[1]];
            let Some(offset) = layer.motion(row as usize).origin_of(arrived) else {
                continue;
            };
            let reach = half_sizes(block);
            let eccentricity = (offset[0].abs() / reach[0]).max(offset[1].abs() / reach[1]);
            if eccentricity < 1.0 && best.is_none_or(|(found, ..)| eccentricity < found) {
                best = Some((
                    eccentricity,
                    [middle[0] + offset[0], middle[1] + offset[1]],
                    row as usize,
                ));
            }
        }
        best.map(|(_, origin, row)| (origin, row))
    }
}
