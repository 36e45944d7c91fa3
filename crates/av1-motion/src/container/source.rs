//! A byte stream that knows its position and can look ahead.

use std::io::Read;

use crate::error::{Error, Result};
use crate::memory;

/// Smallest amount asked of the reader at once.
const CHUNK: usize = 64 << 10;

/// A reader with a window of bytes that were fetched but not consumed.
#[derive(Debug)]
pub(super) struct Source<R> {
    reader: R,
    buffer: Vec<u8>,
    /// Consumed bytes of `buffer`.
    consumed: usize,
    /// Offset in the stream of the next byte.
    position: u64,
}

impl<R: Read> Source<R> {
    pub(super) fn new(reader: R) -> Self {
        Self {
            reader,
            buffer: Vec::new(),
            consumed: 0,
            position: 0,
        }
    }

    /// Offset in the stream of the next byte.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// The next `count` bytes, or fewer at the end, without consuming them.
    pub(super) fn peek(&mut self, count: usize) -> Result<&[u8]> {
        self.fetch(count)?;
        let available = &self.buffer[self.consumed..];
        Ok(&available[..count.min(available.len())])
    }

    /// The next `count` bytes. `section` and `what` describe them if the stream ends too early.
    pub(super) fn take(
        &mut self,
        count: u64,
        section: &'static str,
        what: &'static str,
    ) -> Result<Vec<u8>> {
        let wanted = usize::try_from(count).unwrap_or(usize::MAX);
        let buffered = &self.buffer[self.consumed..];
        let buffered = &buffered[..wanted.min(buffered.len())];
        let mut bytes = memory::copied(buffered)?;
        self.consumed += bytes.len();
        // What is not in the window yet goes past it. Memory grows with what the stream delivers.
        let missing = (wanted - bytes.len()) as u64;
        let mut limited = self.reader.by_ref().take(missing);
        if missing > 0 {
            limited.read_to_end(&mut bytes)?;
        }
        if bytes.len() < wanted {
            let reason = format!(
                "the file ends inside {what}: {count} bytes are needed, {} are there",
                bytes.len()
            );
            // The window is empty: they stay there to be read.
            (self.buffer, self.consumed) = (bytes, 0);
            return Err(Error::malformed(section, self.position, reason));
        }
        self.position += count;
        Ok(bytes)
    }

    /// Consumes `count` bytes that were seen by [`Source::peek`].
    pub(super) fn skip(&mut self, count: usize) {
        self.consumed += count;
        self.position += count as u64;
    }

    /// Makes `count` bytes available, or all up to the end. Memory grows with what the stream
    /// delivers, not with what it promises.
    fn fetch(&mut self, count: usize) -> Result<()> {
        if self.buffer.len() - self.consumed >= count {
            return Ok(());
        }
        self.buffer.drain(..self.consumed);
        self.consumed = 0;
        let missing = (count - self.buffer.len()).max(CHUNK) as u64;
        let mut limited = self.reader.by_ref().take(missing);
        limited.read_to_end(&mut self.buffer)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looking_ahead_consumes_nothing() {
        let mut source = Source::new(&b"abcdef"[..]);
        assert_eq!(source.peek(2).unwrap(), b"ab");
        assert_eq!(source.take(3, "", "").unwrap(), b"abc");
        assert_eq!(source.position(), 3);
        assert_eq!(source.peek(9).unwrap(), b"def");
        assert!(source.take(4, "", "").is_err());
        assert_eq!(source.take(3, "", "").unwrap(), b"def");
        assert!(source.peek(1).unwrap().is_empty());
    }

    #[test]
    fn a_promise_of_gigabytes_allocates_nothing() {
        let mut source = Source::new(&b"abc"[..]);
        assert!(source.take(u64::from(u32::MAX), "", "").is_err());
        assert!(source.buffer.capacity() < 1 << 20);
    }
}
