//! Reading frames on several threads: each takes from a queue the first thing that can be done, and
//! results are handed out in decode order whatever thread they came from.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::Found;
use super::queue::{Outcome, Queue, QueuedFrame, Task};
use crate::error::{Error, Result};
use crate::interrupt::Interrupt;
use crate::motion::Frame;

/// Frames in the queue, for each thread: enough for two segments of common lengths, so that every
/// thread can work on one of its own.
const FRAMES_PER_THREAD: usize = 64;
/// More would wait for each other.
const MAX_THREADS: usize = 256;
/// How often a waiting caller asks whether to stop.
const PATIENCE: Duration = Duration::from_millis(10);

/// The threads, and the frames on their way through them.
pub(super) struct Threads {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
    capacity: usize,
    /// Everything not handed out yet, in order.
    pending: VecDeque<Pending>,
    /// The unit of the last frame.
    last_unit: Option<Arc<Vec<u8>>>,
    /// No more frames will come.
    is_closed: bool,
}

enum Pending {
    Done(Result<Box<Frame>>),
    Queued(Arc<QueuedFrame>),
}

#[derive(Default)]
struct Shared {
    queue: Mutex<Queue>,
    /// Something can be begun, or the end has come.
    has_work: Condvar,
    /// An outcome is there.
    has_outcome: Condvar,
    /// What was begun is to be given up.
    is_stopped: AtomicBool,
}

impl Threads {
    /// As many threads as the system gives, up to `count`; none if it gives none.
    pub(super) fn new(count: usize) -> Option<Self> {
        let shared = Arc::new(Shared::default());
        let workers: Vec<_> = (0..count.min(MAX_THREADS))
            .map_while(|_| {
                let shared = shared.clone();
                thread::Builder::new().spawn(move || shared.work()).ok()
            })
            .collect();
        (!workers.is_empty()).then(|| Self {
            shared,
            capacity: FRAMES_PER_THREAD * workers.len(),
            workers,
            pending: VecDeque::new(),
            last_unit: None,
            is_closed: false,
        })
    }

    /// Puts a frame at the end.
    pub(super) fn push(&mut self, found: Found) {
        let mut job = match found {
            Found::Shown(frame) => return self.pending.push_back(Pending::Done(Ok(frame))),
            Found::Coded(job) => *job,
        };
        let shared = self.shared.clone();
        job.interrupt = Interrupt::new(move || shared.is_stopped.load(Ordering::Relaxed));
        let frame = Arc::new(QueuedFrame::new(job, &mut self.last_unit));
        self.pending.push_back(Pending::Queued(frame.clone()));
        self.shared.lock().push(frame);
        self.shared.has_work.notify_one();
    }

    /// Puts an error at the end.
    pub(super) fn push_error(&mut self, error: Error) {
        self.pending.push_back(Pending::Done(Err(error)));
    }

    /// Says that nothing follows but, perhaps, a last error.
    pub(super) fn close(&mut self, last: Option<Error>) {
        self.pending
            .extend(last.map(|error| Pending::Done(Err(error))));
        self.is_closed = true;
    }

    /// Says that something may follow.
    pub(super) fn open(&mut self) {
        self.is_closed = false;
    }

    pub(super) fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// The next frame, if it is there or if there is no room for more.
    pub(super) fn next(&mut self, interrupt: &Interrupt) -> Result<Option<Frame>> {
        let is_full = self.pending.len() >= self.capacity || self.shared.lock().is_full();
        self.take(is_full, interrupt)
    }

    /// The next frame when no more will come.
    pub(super) fn drain(&mut self, interrupt: &Interrupt) -> Result<Option<Frame>> {
        self.take(true, interrupt)
    }

    fn take(&mut self, waits: bool, interrupt: &Interrupt) -> Result<Option<Frame>> {
        if let Some(Pending::Queued(frame)) = self.pending.front() {
            match self.shared.outcome(frame, waits, interrupt) {
                Ok(None) => return Ok(None),
                Ok(Some(Ok(result))) => self.pending[0] = Pending::Done(result),
                Ok(Some(Err(panic))) => resume_unwind(panic),
                Err(Interrupted) => {
                    self.give_up();
                    return Err(Error::Interrupted);
                }
            }
        }
        match self.pending.pop_front() {
            Some(Pending::Done(result)) => result.map(|frame| Some(*frame)),
            _ => Ok(None),
        }
    }

    /// Ends everything that was begun; later frames may go on.
    fn give_up(&mut self) {
        self.shared.is_stopped.store(true, Ordering::Relaxed);
        let mut queue = self.shared.lock();
        queue.abandon();
        while !queue.is_empty() {
            queue = wait(&self.shared.has_outcome, queue);
        }
        queue.forget();
        drop(queue);
        self.pending.clear();
        self.shared.is_stopped.store(false, Ordering::Relaxed);
    }
}

impl Drop for Threads {
    fn drop(&mut self) {
        self.shared.is_stopped.store(true, Ordering::Relaxed);
        let mut queue = self.shared.lock();
        queue.abandon();
        queue.is_closed = true;
        drop(queue);
        self.shared.has_work.notify_all();
        for worker in self.workers.drain(..) {
            // A thread that panicked has told so where its outcome was taken.
            let _ = worker.join();
        }
    }
}

/// The caller wants to stop.
struct Interrupted;

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What came of a frame; nothing yet, when the caller does not wait.
    fn outcome(
        &self,
        frame: &QueuedFrame,
        waits: bool,
        interrupt: &Interrupt,
    ) -> std::result::Result<Option<Outcome>, Interrupted> {
        let mut queue = self.lock();
        loop {
            if let Some(outcome) = queue.take_outcome(frame) {
                drop(queue);
                // There is room again.
                self.has_work.notify_all();
                return Ok(Some(outcome));
            }
            if !waits {
                return Ok(None);
            }
            // Only the caller's thread may get an answer, and it must hold nothing meanwhile.
            drop(wait(&self.has_outcome, queue));
            if interrupt.is_raised() {
                return Err(Interrupted);
            }
            queue = self.lock();
        }
    }

    /// The life of a thread.
    fn work(&self) {
        let mut queue = self.lock();
        loop {
            let Some(task) = queue.next_task() else {
                if queue.is_closed {
                    return;
                }
                queue = self
                    .has_work
                    .wait(queue)
                    .unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            drop(queue);
            let result = catch_unwind(AssertUnwindSafe(|| self.perform(&task)));
            if let Err(panic) = result {
                let (Task::Start(frame) | Task::Tile(frame, ..)) = &task;
                frame.job.state.settle(None);
                self.conclude(frame, Err(panic));
            }
            queue = self.lock();
        }
    }

    fn perform(&self, task: &Task) {
        match task {
            Task::Start(frame) => match frame.job.start() {
                Ok(reader) => {
                    self.lock().begin(frame, reader);
                    self.has_work.notify_all();
                }
                Err(error) => {
                    let result = frame.job.settle_with(Err(error));
                    self.conclude(frame, Ok(result));
                }
            },
            Task::Tile(frame, reader, index) => {
                let output = frame.job.read_tile(reader, *index);
                let complete = self.lock().add_tile(frame, *index, output);
                if let Some(tiles) = complete {
                    let result = frame.job.finish(reader, tiles.into_iter());
                    self.conclude(frame, Ok(result.map(Box::new)));
                }
            }
        }
    }

    fn conclude(&self, frame: &QueuedFrame, outcome: Outcome) {
        self.lock().conclude(frame, outcome);
        self.has_outcome.notify_all();
        self.has_work.notify_all();
    }
}

/// Waits for a while.
fn wait<'q>(condition: &Condvar, queue: MutexGuard<'q, Queue>) -> MutexGuard<'q, Queue> {
    condition
        .wait_timeout(queue, PATIENCE)
        .unwrap_or_else(PoisonError::into_inner)
        .0
}
