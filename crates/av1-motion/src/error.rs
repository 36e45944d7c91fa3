//! What can go wrong while reading a stream: whose fault, where, and in which section of the
//! specification.

use std::borrow::Cow;
use std::{fmt, io};

use crate::memory::OutOfMemory;

/// Result of everything in this crate that reads a stream.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a stream, or a part of it, could not be read.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The operating system could not deliver the bytes. The stream itself may be fine.
    Io(io::Error),
    /// The bytes break a rule of the specification. The file is damaged or its writer is wrong.
    Malformed {
        /// Section of the AV1 specification whose rule is broken, such as `"5.9.2"` or `"B.2"`;
        /// the name of the format if it has no such section (`"IVF"`).
        section: &'static str,
        /// Offset of the fault in the bytes that were handed over, counted from 0.
        byte_offset: u64,
        /// The broken rule in one sentence.
        reason: Cow<'static, str>,
    },
    /// The stream is legal, but it uses a feature this crate does not read. Nothing was guessed.
    Unsupported {
        /// Name of the feature.
        feature: String,
        /// Section of the AV1 specification that defines it.
        section: &'static str,
    },
    /// The stream asks for more than [`Limits`](crate::Limits) allows. Raise the limit if the
    /// source is trusted.
    LimitExceeded {
        /// Name of the field of `Limits`.
        limit: &'static str,
        /// What the stream asked for.
        value: u64,
        /// What was allowed.
        maximum: u64,
    },
    /// The system has no memory for something that [`Limits`](crate::Limits) allows. Lower
    /// [`Limits::max_frame_area`](crate::Limits::max_frame_area), or free memory.
    OutOfMemory {
        /// What was asked for in one piece.
        bytes: u64,
    },
    /// The caller asked to stop ([`Parser::interrupt_when`](crate::Parser::interrupt_when)). The
    /// frame that was being read is lost.
    Interrupted,
    /// A frame needs an earlier frame that was lost, damaged or never sent. Decoding can resume at
    /// the next frame that does not depend on it, at the latest at a key frame.
    MissingReference {
        /// Which frame is missing, and for what it is needed.
        reason: Cow<'static, str>,
        /// Section of the AV1 specification that asks for the frame.
        section: &'static str,
        /// Offset of the request in the bytes that were handed over, counted from 0.
        byte_offset: u64,
    },
    /// The caller chose an operating point that the stream does not have.
    OperatingPoint {
        /// What was chosen.
        chosen: usize,
        /// How many there are, counted from 0.
        available: usize,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(formatter, "could not read the stream: {error}"),
            Self::Malformed {
                section,
                byte_offset,
                reason,
            } => write!(
                formatter,
                "malformed stream at byte {byte_offset}: {reason} ({})",
                Place(section)
            ),
            Self::Unsupported { feature, section } => write!(
                formatter,
                "unsupported feature: {feature} ({})",
                Place(section)
            ),
            Self::LimitExceeded {
                limit,
                value,
                maximum,
            } => write!(
                formatter,
                "the stream needs {limit} = {value}, but the limit is {maximum}"
            ),
            Self::OutOfMemory { bytes } => write!(
                formatter,
                "there is no memory for {bytes} bytes that the stream needs \
                 (a lower limit on the frame area refuses such streams)"
            ),
            Self::Interrupted => formatter.write_str("reading was interrupted by its caller"),
            Self::MissingReference {
                reason,
                section,
                byte_offset,
            } => write!(
                formatter,
                "missing reference frame at byte {byte_offset}: {reason} ({})",
                Place(section)
            ),
            Self::OperatingPoint { chosen, available } => write!(
                formatter,
                "operating point {chosen} was chosen, but the stream has {available}; \
                 choose one from 0 to {}",
                available.saturating_sub(1)
            ),
        }
    }
}

/// A section, spelt out unless it is the name of a format.
struct Place<'s>(&'s str);

impl fmt::Display for Place<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.contains('.') {
            write!(formatter, "AV1 specification, section {}", self.0)
        } else {
            formatter.write_str(self.0)
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io(error) => Some(error),
            _ => None,
        }
    }
}

impl From<io::Error> for Error {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<OutOfMemory> for Error {
    fn from(error: OutOfMemory) -> Self {
        Self::OutOfMemory { bytes: error.bytes }
    }
}

impl Error {
    /// A broken rule of `section`, found at `byte_offset`.
    pub(crate) fn malformed(
        section: &'static str,
        byte_offset: u64,
        reason: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self::Malformed {
            section,
            byte_offset,
            reason: reason.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_malformed_error_names_place_rule_and_section() {
        let error = Error::malformed("5.3.2", 17, "obu_forbidden_bit is 1");
        assert_eq!(
            error.to_string(),
            "malformed stream at byte 17: obu_forbidden_bit is 1 (AV1 specification, section 5.3.2)"
        );
    }

    #[test]
    fn a_format_without_sections_is_only_named() {
        let error = Error::malformed("IVF", 0, "the file ends inside the header");
        assert!(error.to_string().ends_with("(IVF)"));
    }

    #[test]
    fn an_io_error_keeps_its_source() {
        let error = Error::from(io::Error::other("disk on fire"));
        assert!(std::error::Error::source(&error).is_some());
    }
}
