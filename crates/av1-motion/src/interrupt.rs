//! Stopping in the middle of a frame.

use std::fmt;
use std::sync::Arc;

/// Tells whether to stop. It is asked every few superblocks (some thousand times a second), from
/// whatever thread reads a tile.
#[derive(Clone, Default)]
pub(crate) struct Interrupt(Option<Arc<dyn Fn() -> bool + Send + Sync>>);

impl Interrupt {
    pub(crate) fn new(should_stop: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(should_stop)))
    }

    /// Whether the caller wants to stop.
    pub(crate) fn is_raised(&self) -> bool {
        self.0.as_ref().is_some_and(|should_stop| should_stop())
    }
}

impl fmt::Debug for Interrupt {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = if self.0.is_some() { "set" } else { "none" };
        write!(formatter, "Interrupt({state})")
    }
}
