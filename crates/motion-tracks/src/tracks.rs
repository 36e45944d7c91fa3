//! The result: observations grouped by track.

/// Point tracks in compressed sparse rows.
///
/// Observations of track `t` are `offsets[t]..offsets[t + 1]`; their frames strictly increase.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// Start of each track, and the total at the end: one more than there are tracks.
    pub offsets: Vec<i64>,
    /// Display index of each observation.
    pub frames: Vec<i32>,
    /// Position of each observation in px.
    pub points: Vec<[f32; 2]>,
}

/// One observation while the chain is being built.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observation {
    pub(crate) track: u32,
    pub(crate) frame: i32,
    pub(crate) xy: [f32; 2],
    /// Accumulated squared error since the track's start, px².
    pub(crate) variance: f32,
}

impl Tracks {
    /// Groups observations by track and sorts each track by frame; drops tracks that are too short.
    ///
    /// A frame that occurs twice in a track keeps its first entry. Tracks keep the order of their
    /// numbers.
    pub(crate) fn collect(observations: &[Observation], num_tracks: u32, min_length: u32) -> Self {
        let mut starts = vec![0_usize; num_tracks as usize + 1];
        for observation in observations {
            starts[observation.track as usize + 1] += 1;
        }
        for track in 0..num_tracks as usize {
            starts[track + 1] += starts[track];
        }
        let mut sorted = observations.to_vec();
        let mut fill = starts.clone();
        for observation in observations {
            let slot = &mut fill[observation.track as usize];
            sorted[*slot] = *observation;
            *slot += 1;
        }
        let mut tracks = Self::empty();
        for track in 0..num_tracks as usize {
            tracks.push_track(&mut sorted[starts[track]..starts[track + 1]], min_length);
        }
        tracks
    }

    fn push_track(&mut self, observations: &mut [Observation], min_length: u32) {
        observations.sort_by_key(|observation| observation.frame);
        let start = self.frames.len();
        for observation in observations {
            if self.frames.len() == start || self.frames.last() != Some(&observation.frame) {
                self.frames.push(observation.frame);
                self.points.push(observation.xy);
            }
        }
        if self.frames.len() - start < min_length as usize {
            self.frames.truncate(start);
            self.points.truncate(start);
        } else if self.frames.len() > start {
            let end = i64::try_from(self.frames.len()).expect("fewer than 2^63 observations");
            self.offsets.push(end);
        }
    }

    /// Adds tracks behind the others.
    pub(crate) fn append(&mut self, tracks: &Self) {
        let before = self.offsets.last().copied().unwrap_or_default();
        self.offsets
            .extend(tracks.offsets.iter().skip(1).map(|end| before + end));
        self.frames.extend_from_slice(&tracks.frames);
        self.points.extend_from_slice(&tracks.points);
    }

    /// No tracks.
    #[must_use]
    pub fn empty() -> Self {
        Self {
            offsets: vec![0],
            ..Self::default()
        }
    }

    /// Number of tracks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether there is no track at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observation(track: u32, frame: i32, x: f32) -> Observation {
        Observation {
            track,
            frame,
            xy: [x, 0.0],
            variance: 0.0,
        }
    }

    #[test]
    fn observations_are_grouped_by_track_and_sorted_by_frame() {
        let mixed = [
            observation(0, 5, 1.0),
            observation(1, 5, 2.0),
            observation(0, 4, 3.0),
            observation(1, 6, 4.0),
        ];
        let tracks = Tracks::collect(&mixed, 2, 2);
        assert_eq!(tracks.offsets, [0, 2, 4]);
        assert_eq!(tracks.frames, [4, 5, 5, 6]);
        assert_eq!(tracks.points[0], [3.0, 0.0]);
    }

    #[test]
    fn short_tracks_leave_no_trace_and_a_repeated_frame_counts_once() {
        let mixed = [
            observation(0, 5, 1.0),
            observation(1, 5, 2.0),
            observation(1, 5, 9.0),
            observation(1, 6, 4.0),
        ];
        let tracks = Tracks::collect(&mixed, 2, 2);
        assert_eq!((tracks.len(), tracks.points[0]), (1, [2.0, 0.0]));
        assert!(Tracks::collect(&mixed, 2, 3).is_empty());
    }
}
