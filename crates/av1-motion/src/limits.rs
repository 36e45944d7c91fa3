//! What a stream may cost.

use crate::error::{Error, Result};

/// Upper bounds on what a stream may ask for, checked before anything is allocated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Luma samples of one frame (upscaled width times height). The default, 35 651 584, is the
    /// largest picture of level 6.x (Annex A.3).
    pub max_frame_area: u64,
    /// Tiles of one frame. The default, 4096, is the most the syntax can express (64 x 64).
    pub max_tiles: u32,
    /// Bytes of one unit of a container (a packet or a temporal unit). Default 256 MiB.
    pub max_unit_bytes: u64,
    /// Frames decoded from one stream, hidden ones included. `None`, the default, means no bound.
    pub max_frames: Option<u64>,
    /// Luma samples of all frames of one unit. Empty areas cost next to no bytes, so that bytes do
    /// not bound the time a unit takes; this does. Every frame header counts as at least 4096
    /// samples, also one that only shows an earlier frame or that cannot be read. The default,
    /// 1 140 850 688, is 32 of the largest pictures, or 550 of 1920x1080; encoders put fewer than
    /// ten frames into a unit.
    pub max_unit_samples: u64,
    /// Luma samples of all frames of the stream, counted likewise. `None`, the default, means no
    /// bound: an honest stream can be of any length. A service that reads files of strangers should
    /// set it: one core reads 50 million (noise) to 5 billion (empty areas) samples a second.
    pub max_samples: Option<u64>,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_frame_area: 35_651_584,
            max_tiles: 4096,
            max_unit_bytes: 256 << 20,
            max_frames: None,
            max_unit_samples: 32 * 35_651_584,
            max_samples: None,
        }
    }
}

impl Limits {
    /// Refuses a frame of more than `max_frame_area` luma samples.
    pub(crate) fn check_frame_area(&self, width: u32, height: u32) -> Result<()> {
        let area = u64::from(width) * u64::from(height);
        check("max_frame_area", area, self.max_frame_area)
    }

    /// Refuses a frame of more than `max_tiles` tiles.
    pub(crate) fn check_tiles(&self, tiles: u32) -> Result<()> {
        check("max_tiles", tiles.into(), self.max_tiles.into())
    }

    /// Refuses a container unit of more than `max_unit_bytes` bytes.
    pub(crate) fn check_unit_bytes(&self, bytes: u64) -> Result<()> {
        check("max_unit_bytes", bytes, self.max_unit_bytes)
    }
}

/// Fewest luma samples that a frame header counts as.
const MIN_SAMPLES_PER_HEADER: u64 = 64 * 64;

/// The work a stream has asked for so far, in luma samples.
#[derive(Debug, Default)]
pub(crate) struct Work {
    unit: u64,
    total: u64,
}

impl Work {
    /// Another unit begins.
    pub(crate) fn begin_unit(&mut self) {
        self.unit = 0;
    }

    /// Counts a frame header before it is read.
    pub(crate) fn add_header(&mut self, limits: &Limits) -> Result<()> {
        self.add(MIN_SAMPLES_PER_HEADER, limits)
    }

    /// Counts the tiles of a frame before they are read; its header was counted already.
    pub(crate) fn add_frame(&mut self, width: u32, height: u32, limits: &Limits) -> Result<()> {
        let samples = u64::from(width) * u64::from(height);
        self.add(samples.saturating_sub(MIN_SAMPLES_PER_HEADER), limits)
    }

    fn add(&mut self, samples: u64, limits: &Limits) -> Result<()> {
        self.unit = self.unit.saturating_add(samples);
        self.total = self.total.saturating_add(samples);
        check("max_unit_samples", self.unit, limits.max_unit_samples)?;
        check(
            "max_samples",
            self.total,
            limits.max_samples.unwrap_or(u64::MAX),
        )
    }
}

fn check(limit: &'static str, value: u64, maximum: u64) -> Result<()> {
    if value > maximum {
        return Err(Error::LimitExceeded {
            limit,
            value,
            maximum,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_without_a_picture_are_work_too() {
        let limits = Limits {
            max_unit_samples: 10_000,
            ..Limits::default()
        };
        let mut work = Work::default();
        assert!(work.add_header(&limits).is_ok());
        assert!(work.add_header(&limits).is_ok());
        assert!(matches!(
            work.add_header(&limits),
            Err(Error::LimitExceeded {
                limit: "max_unit_samples",
                value: 12_288,
                maximum: 10_000
            })
        ));
        work.begin_unit();
        assert!(work.add_header(&limits).is_ok());
    }

    #[test]
    fn the_work_of_a_stream_adds_up_over_its_units() {
        let limits = Limits {
            max_samples: Some(200_000),
            ..Limits::default()
        };
        let mut work = Work::default();
        for _ in 0..2 {
            work.begin_unit();
            work.add_header(&limits).unwrap();
            work.add_frame(320, 240, &limits).unwrap();
        }
        work.begin_unit();
        work.add_header(&limits).unwrap();
        let error = work.add_frame(320, 240, &limits).unwrap_err();
        assert!(matches!(
            error,
            Error::LimitExceeded {
                limit: "max_samples",
                value: 230_400,
                ..
            }
        ));
    }

    #[test]
    fn a_frame_of_exactly_the_largest_area_is_accepted() {
        let limits = Limits {
            max_frame_area: 64,
            ..Limits::default()
        };
        assert!(limits.check_frame_area(8, 8).is_ok());
        assert!(matches!(
            limits.check_frame_area(13, 5),
            Err(Error::LimitExceeded {
                limit: "max_frame_area",
                value: 65,
                maximum: 64
            })
        ));
    }
}
