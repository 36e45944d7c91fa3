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
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_frame_area: 35_651_584,
            max_tiles: 4096,
            max_unit_bytes: 256 << 20,
            max_frames: None,
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
