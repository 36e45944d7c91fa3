//! Ctrl-C while Rust is at work: Python's signal handlers run only when they are asked to.

use std::io::{self, Read};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between two looks at Python's signals.
const PATIENCE: Duration = Duration::from_millis(50);
/// Most bytes read from a file between two looks at the time.
const READ_BYTES: usize = 1 << 20;

/// Looks at Python's signals from code that does not hold the GIL.
#[derive(Clone)]
pub(crate) struct Signals(Arc<Mutex<State>>);

struct State {
    last_look: Instant,
    /// What a signal handler raised; `KeyboardInterrupt` as a rule.
    raised: Option<PyErr>,
}

impl Signals {
    pub(crate) fn new() -> Self {
        let state = State {
            last_look: Instant::now(),
            raised: None,
        };
        Self(Arc::new(Mutex::new(state)))
    }

    /// Whether a handler raised an exception. Asks Python at most every [`PATIENCE`], and only the
    /// main thread gets an answer from it.
    pub(crate) fn are_pending(&self) -> bool {
        let mut state = self.lock();
        if state.raised.is_some() || state.last_look.elapsed() < PATIENCE {
            return state.raised.is_some();
        }
        state.last_look = Instant::now();
        // Who waits for the GIL must hold nothing that the holder of the GIL may wait for.
        drop(state);
        let raised = Python::try_attach(|py| py.check_signals().err()).flatten();
        let is_pending = raised.is_some();
        if is_pending {
            self.lock().raised = raised;
        }
        is_pending
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the exception, so that the next call starts anew.
    pub(crate) fn take(&self) -> Option<PyErr> {
        self.lock().raised.take()
    }
}

/// A reader that stops for signals, also where the operating system lets it wait.
pub(crate) struct Interruptible<R> {
    reader: R,
    signals: Signals,
}

impl<R> Interruptible<R> {
    pub(crate) fn new(reader: R, signals: Signals) -> Self {
        Self { reader, signals }
    }
}

impl<R: Read> Read for Interruptible<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = buffer.len().min(READ_BYTES);
        loop {
            if self.signals.are_pending() {
                return Err(io::Error::other("interrupted"));
            }
            match self.reader.read(&mut buffer[..length]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {
                    std::thread::sleep(PATIENCE);
                }
                result => return result,
            }
        }
    }
}
