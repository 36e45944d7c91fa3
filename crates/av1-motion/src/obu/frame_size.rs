//! §5.9.5 to §5.9.9: coded, upscaled and render size.

use crate::bits::BitReader;
use crate::error::Result;
use crate::limits::Limits;
use crate::refs::ReferenceSlot;
use crate::tables::symbols::SUPERRES_NUM;

use super::sequence_header::SequenceHeader;

/// §3 `SUPERRES_DENOM_MIN`.
const SUPERRES_DENOM_MIN: u8 = 9;
/// §3 `SUPERRES_DENOM_BITS`.
const SUPERRES_DENOM_BITS: u32 = 3;

/// Sizes of a frame in luma samples, and in 4x4 cells of the coded frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FrameSize {
    /// `FrameWidth`: coded width, after superres downscaling.
    pub(crate) frame_width: u32,
    pub(crate) frame_height: u32,
    /// `UpscaledWidth`: width after superres upscaling.
    pub(crate) upscaled_width: u32,
    pub(crate) render_width: u32,
    pub(crate) render_height: u32,
    pub(crate) use_superres: bool,
    /// `SuperresDenom`: 8 without superres, else 9 to 16.
    pub(crate) superres_denom: u8,
    /// `MiCols`: always even.
    pub(crate) mi_cols: u32,
    /// `MiRows`: always even.
    pub(crate) mi_rows: u32,
}

impl Default for FrameSize {
    fn default() -> Self {
        Self {
            frame_width: 0,
            frame_height: 0,
            upscaled_width: 0,
            render_width: 0,
            render_height: 0,
            use_superres: false,
            superres_denom: 8,
            mi_cols: 0,
            mi_rows: 0,
        }
    }
}

impl FrameSize {
    /// §5.9.5 `frame_size` followed by §5.9.6 `render_size`.
    pub(crate) fn parse(
        reader: &mut BitReader<'_>,
        sequence: &SequenceHeader,
        frame_size_override: bool,
        limits: &Limits,
    ) -> Result<Self> {
        let mut size = Self {
            upscaled_width: sequence.max_frame_width,
            frame_height: sequence.max_frame_height,
            ..Self::default()
        };
        if frame_size_override {
            size.upscaled_width = reader.f(sequence.frame_width_bits.into())? + 1;
            size.frame_height = reader.f(sequence.frame_height_bits.into())? + 1;
            if size.upscaled_width > sequence.max_frame_width
                || size.frame_height > sequence.max_frame_height
            {
                return Err(reader.malformed(
                    "6.8.4",
                    format!(
                        "a frame of {}x{} exceeds the sequence's {}x{}",
                        size.upscaled_width,
                        size.frame_height,
                        sequence.max_frame_width,
                        sequence.max_frame_height
                    ),
                ));
            }
        }
        size.parse_superres(reader, sequence, limits)?;
        size.parse_render_size(reader)?;
        Ok(size)
    }

    /// §5.9.7 `frame_size_with_refs`; `references` are the slots of `LAST_FRAME` to
    /// `ALTREF_FRAME`.
    pub(crate) fn parse_with_refs<'s>(
        reader: &mut BitReader<'_>,
        sequence: &SequenceHeader,
        references: impl IntoIterator<Item = &'s ReferenceSlot>,
        limits: &Limits,
    ) -> Result<Self> {
        for reference in references {
            let found_ref = reader.flag()?;
            if found_ref {
                let mut size = Self {
                    upscaled_width: reference.upscaled_width,
                    frame_height: reference.frame_height,
                    render_width: reference.render_width,
                    render_height: reference.render_height,
                    ..Self::default()
                };
                size.parse_superres(reader, sequence, limits)?;
                return Ok(size);
            }
        }
        Self::parse(reader, sequence, true, limits)
    }

    /// §5.9.8 `superres_params` and §5.9.9 `compute_image_size`, from `upscaled_width` and
    /// `frame_height`.
    fn parse_superres(
        &mut self,
        reader: &mut BitReader<'_>,
        sequence: &SequenceHeader,
        limits: &Limits,
    ) -> Result<()> {
        limits.check_frame_area(self.upscaled_width, self.frame_height)?;
        self.use_superres = sequence.enable_superres && reader.flag()?;
        if self.use_superres {
            self.superres_denom = reader.f8(SUPERRES_DENOM_BITS)? + SUPERRES_DENOM_MIN;
        }
        let denominator = u32::from(self.superres_denom);
        self.frame_width = (self.upscaled_width * SUPERRES_NUM + denominator / 2) / denominator;
        self.mi_cols = 2 * ((self.frame_width + 7) >> 3);
        self.mi_rows = 2 * ((self.frame_height + 7) >> 3);
        Ok(())
    }

    /// §5.9.6 `render_size`.
    fn parse_render_size(&mut self, reader: &mut BitReader<'_>) -> Result<()> {
        let render_and_frame_size_different = reader.flag()?;
        if render_and_frame_size_different {
            self.render_width = reader.f(16)? + 1;
            self.render_height = reader.f(16)? + 1;
        } else {
            self.render_width = self.upscaled_width;
            self.render_height = self.frame_height;
        }
        Ok(())
    }

    /// §6.8.6: a reference may be at most twice as large and at most 16 times smaller.
    pub(crate) fn can_scale_from(&self, reference: &ReferenceSlot) -> bool {
        2 * self.frame_width >= reference.upscaled_width
            && 2 * self.frame_height >= reference.frame_height
            && self.frame_width <= 16 * reference.upscaled_width
            && self.frame_height <= 16 * reference.frame_height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(width: u32, height: u32) -> SequenceHeader {
        SequenceHeader {
            frame_width_bits: 8,
            frame_height_bits: 8,
            max_frame_width: width,
            max_frame_height: height,
            ..SequenceHeader::default()
        }
    }

    #[test]
    fn the_grid_of_cells_is_even_and_covers_the_frame() {
        let mut reader = BitReader::new(&[0], 0);
        let size =
            FrameSize::parse(&mut reader, &sequence(211, 117), false, &Limits::default()).unwrap();
        assert_eq!((size.mi_cols, size.mi_rows), (54, 30));
        assert_eq!((size.render_width, size.render_height), (211, 117));
        assert_eq!(reader.position(), 1);
    }

    #[test]
    fn superres_narrows_the_coded_frame_only() {
        let mut sequence = sequence(100, 50);
        sequence.enable_superres = true;
        // use_superres 1, coded_denom 7 (16), render size equal.
        let mut reader = BitReader::new(&[0b1111_0000], 0);
        let size = FrameSize::parse(&mut reader, &sequence, false, &Limits::default()).unwrap();
        assert_eq!(size.frame_width, 50);
        assert_eq!(size.upscaled_width, 100);
        assert_eq!(size.render_width, 100);
        assert_eq!(size.mi_cols, 14);
    }

    #[test]
    fn a_frame_larger_than_its_sequence_is_malformed() {
        let mut reader = BitReader::new(&[100, 0, 0], 0);
        let result = FrameSize::parse(&mut reader, &sequence(100, 50), true, &Limits::default());
        assert!(matches!(
            result,
            Err(crate::error::Error::Malformed {
                section: "6.8.4",
                ..
            })
        ));
    }
}
