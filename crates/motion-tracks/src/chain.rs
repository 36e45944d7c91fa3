//! The walk over the frames: points arrive, are thinned, and are carried on.

use std::collections::BTreeMap;

use crate::cells::{Cells, inside};
use crate::cover::Cover;
use crate::field::center;
use crate::link::{Layer, LinkOptions};
use crate::motion::{Follow, distance};
use crate::tracks::{Observation, Tracks};

/// A point that has reached a frame.
#[derive(Clone, Copy, Debug)]
struct Head {
    track: u32,
    xy: [f32; 2],
    /// Step that led here, as motion towards the past; none for a seed.
    step: Option<[f32; 2]>,
    /// Accumulated squared error, px².
    variance: f32,
    /// Whether the observation is already part of the track.
    settled: bool,
}

/// Marks the end of a track's list of observations, and a cell without a track.
pub(crate) const NONE: u32 = u32::MAX;

/// What is known of a track while it grows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Growth {
    pub(crate) length: u32,
    /// Smallest frame so far: anything below it is new without looking.
    first_frame: i32,
    /// Largest frame so far: anything above it is new as well.
    last_frame: i32,
    /// Newest observation.
    pub(crate) last: u32,
}

/// State of the walk.
pub(crate) struct Chain {
    pub(crate) options: LinkOptions,
    pub(crate) observations: Vec<Observation>,
    /// Observation before each one in the same track.
    pub(crate) previous: Vec<u32>,
    pub(crate) growth: Vec<Growth>,
    /// Points that wait for their frame's turn, by display index.
    pending: BTreeMap<i32, Vec<Head>>,
    /// Cells taken in frames that come up once more.
    taken: BTreeMap<i32, Vec<bool>>,
    /// Points whose cells are not to be used, by frame.
    occupied: BTreeMap<i32, Vec<[f32; 2]>>,
    /// First frame that tracks may still gain observations in.
    floor: i32,
}

impl Chain {
    pub(crate) fn new(options: LinkOptions) -> Self {
        Self {
            options,
            occupied: BTreeMap::new(),
            floor: i32::MIN,
            observations: Vec::new(),
            previous: Vec::new(),
            growth: Vec::new(),
            pending: BTreeMap::new(),
            taken: BTreeMap::new(),
        }
    }

    /// Handles one coded frame; `again` tells that one decoded earlier has the same display index.
    pub(crate) fn visit(&mut self, layer: &Layer, cover: &Cover, seeds: &[[f32; 2]], again: bool) {
        let arrivals = self.pending.remove(&layer.frame).unwrap_or_default();
        let mut cells = self.cells(layer.frame, layer.width, layer.height);
        if let Some(taken) = self.taken.remove(&layer.frame) {
            cells.taken = taken;
        }
        let mut heads = self.settle(layer.frame, arrivals, &mut cells);
        heads.extend(self.seed(layer.frame, seeds, &mut cells));
        for head in heads {
            if !self.carry(layer, cover, &head) && again {
                self.pending.entry(layer.frame).or_default().push(head);
            }
        }
        if again {
            self.taken.insert(layer.frame, cells.taken);
        }
    }

    /// Whether points wait for a frame's turn.
    pub(crate) fn awaits(&self, frame: i32) -> bool {
        self.pending.contains_key(&frame)
    }

    /// Whether tracks gain no more observations in a frame.
    pub(crate) fn is_closed(&self, frame: i32) -> bool {
        frame < self.floor
    }

    /// Points of the tracks that are long enough to be kept, in frames that are open.
    fn open_points(&self) -> impl Iterator<Item = (i32, [f32; 2])> {
        self.observations
            .iter()
            .filter(|seen| !self.is_closed(seen.frame) && self.is_kept(seen.track))
            .map(|seen| (seen.frame, seen.xy))
    }

    /// Takes the cells of its tracks from another chain's.
    pub(crate) fn occupy(&self, other: &mut Self) {
        for (frame, xy) in self.open_points() {
            other.occupied.entry(frame).or_default().push(xy);
        }
    }

    /// Takes the cells of its tracks from those that are still to start.
    pub(crate) fn occupy_own(&mut self) {
        let points: Vec<_> = self.open_points().collect();
        for (frame, xy) in points {
            self.occupied.entry(frame).or_default().push(xy);
        }
    }

    /// Whether a track is long enough to be kept.
    pub(crate) fn is_kept(&self, track: u32) -> bool {
        self.growth[track as usize].length >= self.options.min_length
    }

    /// The cells of a frame that are free of other tracks.
    pub(crate) fn cells(&self, frame: i32, width: u32, height: u32) -> Cells {
        let mut cells = Cells::new(self.options.cell, width, height);
        for &xy in self.occupied.get(&frame).into_iter().flatten() {
            cells.claim(xy);
        }
        cells
    }

    /// Turns arrivals into observations: in every free cell the longest track, then the older one.
    fn settle(&mut self, frame: i32, mut arrivals: Vec<Head>, cells: &mut Cells) -> Vec<Head> {
        arrivals.retain(|head| head.settled || self.is_new(head.track, frame));
        let mut arrivals = meet(arrivals);
        let length = |head: &Head| self.growth[head.track as usize].length;
        arrivals.sort_by_key(|head| (!head.settled, std::cmp::Reverse(length(head)), head.track));
        // Sorted this way the first to ask for a cell has the best claim.
        arrivals.retain_mut(|head| {
            if !head.settled && self.is_new(head.track, frame) && cells.claim(head.xy) {
                self.observe(head.track, frame, head.xy, head.variance);
                head.settled = true;
            }
            head.settled
        });
        arrivals
    }

    /// Starts a track in every cell that is still free.
    fn seed(&mut self, frame: i32, seeds: &[[f32; 2]], cells: &mut Cells) -> Vec<Head> {
        let mut heads = Vec::new();
        for &xy in seeds {
            if !cells.contains(xy) || !cells.claim(xy) {
                continue;
            }
            let Some(track) = self.start_track() else {
                break;
            };
            self.observe(track, frame, xy, 0.0);
            heads.push(Head {
                track,
                xy,
                step: None,
                variance: 0.0,
                settled: true,
            });
        }
        heads
    }

    /// Number of a new track; none if there are too many.
    fn start_track(&mut self) -> Option<u32> {
        let track = u32::try_from(self.growth.len()).ok()?;
        self.growth.push(Growth {
            length: 0,
            first_frame: i32::MAX,
            last_frame: i32::MIN,
            last: NONE,
        });
        Some(track)
    }

    pub(crate) fn observe(&mut self, track: u32, frame: i32, xy: [f32; 2], variance: f32) {
        let growth = &mut self.growth[track as usize];
        self.observations.push(Observation {
            track,
            frame,
            xy,
            variance,
        });
        self.previous.push(growth.last);
        growth.last =
            u32::try_from(self.observations.len() - 1).expect("fewer than 2^32 observations");
        growth.length += 1;
        growth.first_frame = growth.first_frame.min(frame);
        growth.last_frame = growth.last_frame.max(frame);
    }

    /// Whether a track has not been seen in a frame yet.
    pub(crate) fn is_new(&self, track: u32, frame: i32) -> bool {
        let growth = &self.growth[track as usize];
        if frame < growth.first_frame || frame > growth.last_frame {
            return true;
        }
        let mut at = growth.last;
        while at != NONE {
            if self.observations[at as usize].frame == frame {
                return false;
            }
            at = self.previous[at as usize];
        }
        true
    }

    /// Moves a point into the references of the block that covers it; false if there is no vector.
    fn carry(&mut self, layer: &Layer, cover: &Cover, head: &Head) -> bool {
        let nearest = |&row: &usize| {
            let reference = layer.references[row];
            (
                reference.abs_diff(layer.frame),
                reference > layer.frame,
                row,
            )
        };
        match self.options.follow {
            Follow::Nearest => {
                let Some(row) = cover.rows_at(head.xy).min_by_key(nearest) else {
                    return false;
                };
                self.step(layer, row, head);
                true
            }
            Follow::All => {
                let mut covered = false;
                for row in cover.rows_at(head.xy) {
                    self.step(layer, row, head);
                    covered = true;
                }
                covered
            }
        }
    }

    fn step(&mut self, layer: &Layer, row: usize, head: &Head) {
        let middle = center(layer.block(row));
        let offset = [head.xy[0] - middle[0], head.xy[1] - middle[1]];
        let moved = layer.motion(row).at(offset);
        let xy = [head.xy[0] + moved[0], head.xy[1] + moved[1]];
        let reference = layer.references[row];
        if !inside(xy, layer.width, layer.height) || self.is_closed(reference) {
            return;
        }
        let sign = if reference < layer.frame { 1.0 } else { -1.0 };
        let step = moved.map(|component| component * sign);
        let agrees = match (self.options.cosine, head.step) {
            (Some(cosine), Some(previous)) => cosine.accepts(previous, step),
            _ => true,
        };
        let variance = head.variance + layer.variance(row);
        if agrees && self.holds(variance) {
            let arrival = Head {
                track: head.track,
                xy,
                step: Some(step),
                variance,
                settled: false,
            };
            self.pending.entry(reference).or_default().push(arrival);
        }
    }

    /// Whether a track may go on with this accumulated squared error.
    pub(crate) fn holds(&self, variance: f32) -> bool {
        self.options
            .max_drift
            .is_none_or(|limit| variance <= limit * limit)
    }

    /// Settles the points that wait for frames that never came, newest frame first.
    pub(crate) fn settle_rest(&mut self, width: u32, height: u32) {
        while let Some((frame, arrivals)) = self.pending.pop_last() {
            let mut cells = self.cells(frame, width, height);
            self.settle(frame, arrivals, &mut cells);
        }
    }

    /// Closes the frames before `floor`: gives away the tracks that end there, keeps the others, and
    /// forgets what is too short.
    pub(crate) fn close(&mut self, floor: i32) -> Tracks {
        let mut open = Self::new(self.options);
        open.floor = self.floor.max(floor);
        let numbers: Vec<Option<u32>> = (0..)
            .zip(&self.growth)
            .map(|(track, growth)| {
                let goes_on = !open.is_closed(growth.last_frame) && self.is_kept(track);
                goes_on.then(|| open.start_track())?
            })
            .collect();
        let mut closed = std::mem::replace(self, open);
        closed.observations.retain(|seen| {
            let number = numbers[seen.track as usize];
            if let Some(track) = number {
                self.observe(track, seen.frame, seen.xy, seen.variance);
            }
            number.is_none()
        });
        closed.finish()
    }

    /// Groups the observations.
    pub(crate) fn finish(self) -> Tracks {
        let tracks = u32::try_from(self.growth.len()).expect("tracks are numbered in 32 bits");
        Tracks::collect(&self.observations, tracks, self.options.min_length)
    }
}

/// One arrival per track: those that agree are averaged by their accuracy, of others the most
/// accurate stays. A direct vector from far away so pulls back what short ones have drifted.
fn meet(mut arrivals: Vec<Head>) -> Vec<Head> {
    arrivals.sort_by(|a, b| {
        (a.track, !a.settled)
            .cmp(&(b.track, !b.settled))
            .then(a.variance.total_cmp(&b.variance))
    });
    arrivals
        .chunk_by(|a, b| a.track == b.track)
        .map(average)
        .collect()
}

/// Smallest variance of an arrival, px²: vectors are quantised.
const MIN_VARIANCE: f32 = 0.01;

/// Average of arrivals of one track, the most accurate first.
fn average(arrivals: &[Head]) -> Head {
    let mut best = arrivals[0];
    // Without an error model nothing is known of the accuracy: the first to arrive stays.
    if best.settled || best.variance <= 0.0 {
        return best;
    }
    let (mut total, mut sum) = (0.0, [0.0; 2]);
    for head in arrivals {
        let distance = distance(head.xy, best.xy);
        let variance = head.variance.max(MIN_VARIANCE);
        if distance * distance <= 9.0 * (variance + best.variance.max(MIN_VARIANCE)) {
            total += 1.0 / variance;
            sum = [0, 1].map(|axis| sum[axis] + (head.xy[axis] - best.xy[axis]) / variance);
        }
    }
    best.xy = [0, 1].map(|axis| best.xy[axis] + sum[axis] / total);
    best
}
