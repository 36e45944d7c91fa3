//! The frames that threads work on: what can be done next, and what came of it.
//!
//! A frame is begun when the frames it depends on are settled; these come before it in the queue, so
//! that the first one can always be begun and nobody waits for nothing. Its tiles are then taken one
//! by one.

use std::any::Any;
use std::collections::VecDeque;
use std::sync::Arc;

use super::job::{FrameJob, FrameReader, TileBytes};
use crate::error::Result;
use crate::motion::Frame;
use crate::tile::{Block, TileOutput};

/// Bytes of frames that wait, coded or read. Beyond, only the first frame of the queue is read.
const MAX_WAITING_BYTES: usize = 64 << 20;

/// A result, or what a thread panicked with.
pub(super) type Outcome = std::result::Result<Result<Box<Frame>>, Box<dyn Any + Send>>;

/// A frame on its way through the threads.
pub(super) struct QueuedFrame {
    pub(super) job: FrameJob,
    /// Bytes that it keeps alive.
    coded_bytes: usize,
}

/// Frames from the moment their tiles are found until they are handed out.
#[derive(Default)]
pub(super) struct Queue {
    /// Frames without an outcome, in decode order.
    entries: VecDeque<Entry>,
    /// By decode index.
    outcomes: Vec<(u64, Outcome)>,
    /// Of the units of all frames that were not handed out yet, and of what was read of them.
    waiting_bytes: usize,
    pub(super) is_closed: bool,
}

struct Entry {
    frame: Arc<QueuedFrame>,
    stage: Stage,
}

enum Stage {
    Waiting,
    Starting,
    Reading(Reading),
}

struct Reading {
    reader: Arc<FrameReader>,
    /// Tiles given out.
    num_begun: usize,
    tiles: Vec<Option<Result<TileOutput>>>,
    num_read: usize,
}

/// The next thing for a thread to do.
pub(super) enum Task {
    Start(Arc<QueuedFrame>),
    Tile(Arc<QueuedFrame>, Arc<FrameReader>, usize),
}

impl Queue {
    /// Nothing is left to be read.
    pub(super) fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Forgets everything that was read.
    pub(super) fn forget(&mut self) {
        self.outcomes.clear();
        self.waiting_bytes = 0;
    }

    /// Nothing more should be put in.
    pub(super) fn is_full(&self) -> bool {
        self.waiting_bytes >= MAX_WAITING_BYTES
    }

    /// The first thing that can be done, which is given out with this.
    pub(super) fn next_task(&mut self) -> Option<Task> {
        let has_room = !self.is_full();
        for (place, entry) in self.entries.iter_mut().enumerate() {
            match &mut entry.stage {
                Stage::Waiting if (place == 0 || has_room) && entry.frame.job.is_ready() => {
                    entry.stage = Stage::Starting;
                    return Some(Task::Start(entry.frame.clone()));
                }
                Stage::Reading(reading) if reading.num_begun < reading.tiles.len() => {
                    reading.num_begun += 1;
                    let (reader, tile) = (reading.reader.clone(), reading.num_begun - 1);
                    return Some(Task::Tile(entry.frame.clone(), reader, tile));
                }
                _ => {}
            }
        }
        None
    }

    /// Takes back what was not begun.
    pub(super) fn abandon(&mut self) {
        self.entries.retain(|entry| {
            let is_begun = !matches!(entry.stage, Stage::Waiting);
            if !is_begun {
                entry.frame.job.state.settle(None);
            }
            is_begun
        });
    }

    /// Puts a frame at the end.
    pub(super) fn push(&mut self, frame: Arc<QueuedFrame>) {
        self.waiting_bytes += frame.coded_bytes;
        self.entries.push_back(Entry {
            frame,
            stage: Stage::Waiting,
        });
    }

    /// The tiles of a frame can be read.
    pub(super) fn begin(&mut self, frame: &QueuedFrame, reader: FrameReader) {
        if let Some(entry) = self.entry(frame) {
            entry.stage = Stage::Reading(Reading {
                reader: Arc::new(reader),
                num_begun: 0,
                tiles: frame.job.tiles.iter().map(|_| None).collect(),
                num_read: 0,
            });
        }
    }

    /// Takes a frame out and keeps what came of it.
    pub(super) fn conclude(&mut self, frame: &QueuedFrame, outcome: Outcome) {
        let decode_index = frame.decode_index();
        self.entries
            .retain(|entry| entry.frame.decode_index() != decode_index);
        self.waiting_bytes += outcome_bytes(&outcome);
        self.outcomes.push((decode_index, outcome));
    }

    /// What came of a frame, if anything has.
    pub(super) fn take_outcome(&mut self, frame: &QueuedFrame) -> Option<Outcome> {
        let decode_index = frame.decode_index();
        let place = self
            .outcomes
            .iter()
            .position(|(index, _)| *index == decode_index)?;
        let (_, outcome) = self.outcomes.swap_remove(place);
        self.waiting_bytes -= frame.coded_bytes + outcome_bytes(&outcome);
        Some(outcome)
    }

    /// Keeps a tile; returns all of them with the last one.
    pub(super) fn add_tile(
        &mut self,
        frame: &QueuedFrame,
        index: usize,
        output: Result<TileOutput>,
    ) -> Option<Vec<Result<TileOutput>>> {
        let Some(Entry {
            stage: Stage::Reading(reading),
            ..
        }) = self.entry(frame)
        else {
            return None;
        };
        reading.tiles[index] = Some(output);
        reading.num_read += 1;
        let is_complete = reading.num_read == reading.tiles.len();
        is_complete.then(|| {
            std::mem::take(&mut reading.tiles)
                .into_iter()
                .flatten()
                .collect()
        })
    }

    fn entry(&mut self, frame: &QueuedFrame) -> Option<&mut Entry> {
        let decode_index = frame.decode_index();
        self.entries
            .iter_mut()
            .find(|entry| entry.frame.decode_index() == decode_index)
    }
}

impl QueuedFrame {
    /// A frame keeps whole units alive, whatever else is in them. `last_unit` is the one that frames
    /// before it have counted already.
    pub(super) fn new(job: FrameJob, last_unit: &mut Option<Arc<Vec<u8>>>) -> Self {
        let mut coded_bytes = 0;
        for TileBytes { unit, .. } in &job.tiles {
            if !last_unit
                .as_ref()
                .is_some_and(|last| Arc::ptr_eq(last, unit))
            {
                coded_bytes += unit.len();
                *last_unit = Some(unit.clone());
            }
        }
        Self { job, coded_bytes }
    }

    fn decode_index(&self) -> u64 {
        self.job.state.decode_index
    }
}

/// About what a frame takes that was read: its blocks, and what it leaves in a reference slot.
fn outcome_bytes(outcome: &Outcome) -> usize {
    match outcome {
        Ok(Ok(frame)) => {
            let cells = frame.header.size.mi_rows as usize * frame.header.size.mi_cols as usize;
            frame.blocks.len() * size_of::<Block>() + 3 * cells
        }
        _ => 0,
    }
}
