//! Containers that hold nothing but AV1: IVF, the low-overhead format ("Section 5") and the
//! length-delimited format (Annex B). They are split into units of OBUs, nothing more.

mod annexb;
mod ivf;
mod probe;
mod section5;
mod source;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::Result;
use crate::limits::Limits;

use ivf::Ivf;
use probe::probe;
use source::Source;

/// Kinds of container that [`ContainerReader`] tells apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ContainerKind {
    /// Packets with timestamps.
    Ivf,
    /// §5.2: OBUs that carry their own sizes.
    Section5,
    /// Annex B: temporal units, frame units and OBUs with lengths.
    AnnexB,
}

/// A run of OBUs in the low-overhead format: a temporal unit, or in IVF a packet, which may be one
/// layer of a temporal unit only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unit {
    /// The OBUs. Those from Annex B have been given size fields.
    pub data: Vec<u8>,
    /// Presentation time in units of [`ContainerReader::time_base`], if the container has times.
    pub pts: Option<i64>,
    /// Offset in the file of the first byte of the OBUs.
    pub byte_offset: u64,
}

/// Splits a file into units, one at a time: memory is bounded by the largest unit.
#[derive(Debug)]
pub struct ContainerReader<R: Read> {
    source: Source<R>,
    layout: Layout,
    limits: Limits,
    /// No more units: the end or an error was reached.
    finished: bool,
}

#[derive(Debug)]
enum Layout {
    Ivf(Ivf),
    Section5,
    AnnexB,
}

impl ContainerReader<File> {
    /// Opens the file at `path` and finds out its kind from the first bytes.
    ///
    /// # Errors
    /// `Io` if the file cannot be read, `Unsupported` if it is a known container of another kind,
    /// `Malformed` if it is none of the three kinds or its header is damaged.
    pub fn open(path: impl AsRef<Path>, limits: &Limits) -> Result<Self> {
        Self::new(File::open(path)?, limits)
    }
}

impl<R: Read> ContainerReader<R> {
    /// Reads from `reader`, which need not be buffered. Errors as for [`ContainerReader::open`].
    ///
    /// # Errors
    /// See [`ContainerReader::open`].
    pub fn new(reader: R, limits: &Limits) -> Result<Self> {
        let mut source = Source::new(reader);
        let layout = match probe(source.peek(probe::PROBE_BYTES)?)? {
            ContainerKind::Ivf => Layout::Ivf(Ivf::read_header(&mut source)?),
            ContainerKind::Section5 => Layout::Section5,
            ContainerKind::AnnexB => Layout::AnnexB,
        };
        Ok(Self {
            source,
            layout,
            limits: limits.clone(),
            finished: false,
        })
    }

    /// What kind of container this is.
    pub fn kind(&self) -> ContainerKind {
        match self.layout {
            Layout::Ivf(_) => ContainerKind::Ivf,
            Layout::Section5 => ContainerKind::Section5,
            Layout::AnnexB => ContainerKind::AnnexB,
        }
    }

    /// Seconds per unit of time as (numerator, denominator), if the container says so.
    pub fn time_base(&self) -> Option<(u32, u32)> {
        match &self.layout {
            Layout::Ivf(ivf) => ivf.time_base(),
            Layout::Section5 | Layout::AnnexB => None,
        }
    }

    /// Width and height in pixels that the container claims. The stream may disagree.
    pub fn size(&self) -> Option<(u32, u32)> {
        match &self.layout {
            Layout::Ivf(ivf) => Some(ivf.size()),
            Layout::Section5 | Layout::AnnexB => None,
        }
    }

    /// The next unit, or `None` at the end of the file. After an error there is no further unit.
    ///
    /// # Errors
    /// `Malformed` if the file is damaged or ends inside a unit, `LimitExceeded` if a unit is
    /// larger than [`Limits::max_unit_bytes`], `Io` if the file cannot be read.
    pub fn next_unit(&mut self) -> Result<Option<Unit>> {
        if self.finished {
            return Ok(None);
        }
        let (source, limits) = (&mut self.source, &self.limits);
        let unit = match self.layout {
            Layout::Ivf(_) => ivf::next_unit(source, limits),
            Layout::Section5 => section5::next_unit(source, limits),
            Layout::AnnexB => annexb::next_unit(source, limits),
        };
        self.finished = !matches!(unit, Ok(Some(_)));
        unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    /// Temporal delimiter, then a padding OBU with the given bytes.
    const UNIT_A: [u8; 6] = [0x12, 0x00, 0x7a, 0x02, 0xaa, 0x80];
    const UNIT_B: [u8; 5] = [0x12, 0x00, 0x7a, 0x01, 0x80];

    fn ivf_file() -> Vec<u8> {
        let mut file = b"DKIF\0\0\x20\0AV01".to_vec();
        file.extend([0x40, 0x01, 0xf0, 0x00]);
        file.extend(30_u32.to_le_bytes());
        file.extend(1_u32.to_le_bytes());
        file.extend([0; 8]);
        for (pts, unit) in [(0_u64, &UNIT_A[..]), (2, &UNIT_B[..])] {
            file.extend(u32::try_from(unit.len()).unwrap().to_le_bytes());
            file.extend(pts.to_le_bytes());
            file.extend(unit);
        }
        file
    }

    fn section5_file() -> Vec<u8> {
        [&UNIT_A[..], &UNIT_B[..]].concat()
    }

    fn annexb_file() -> Vec<u8> {
        vec![
            7, 6, 1, 0x10, 3, 0x78, 0xaa, 0x80, // the padding has no size field
            7, 6, 1, 0x10, 3, 0x7a, 0x01, 0x80, // the padding has one
        ]
    }

    fn units(file: &[u8]) -> (Vec<Vec<u8>>, Option<Error>) {
        let mut reader = match ContainerReader::new(file, &Limits::default()) {
            Ok(reader) => reader,
            Err(error) => return (Vec::new(), Some(error)),
        };
        let mut units = Vec::new();
        loop {
            match reader.next_unit() {
                Ok(Some(unit)) => units.push(unit.data),
                Ok(None) => return (units, None),
                Err(error) => return (units, Some(error)),
            }
        }
    }

    #[test]
    fn every_container_gives_the_same_units() {
        for file in [ivf_file(), section5_file(), annexb_file()] {
            let (units, error) = units(&file);
            assert!(error.is_none(), "{error:?}");
            assert_eq!(units, [UNIT_A.to_vec(), UNIT_B.to_vec()]);
        }
    }

    #[test]
    fn kinds_are_told_apart_by_their_first_bytes() {
        let kind = |file: Vec<u8>| {
            let reader = ContainerReader::new(&file[..], &Limits::default());
            reader.unwrap().kind()
        };
        assert_eq!(kind(ivf_file()), ContainerKind::Ivf);
        assert_eq!(kind(section5_file()), ContainerKind::Section5);
        assert_eq!(kind(annexb_file()), ContainerKind::AnnexB);
    }

    #[test]
    fn ivf_has_times_a_size_and_offsets() {
        let file = ivf_file();
        let mut reader = ContainerReader::new(&file[..], &Limits::default()).unwrap();
        assert_eq!(reader.time_base(), Some((1, 30)));
        assert_eq!(reader.size(), Some((320, 240)));
        let first = reader.next_unit().unwrap().unwrap();
        let second = reader.next_unit().unwrap().unwrap();
        assert_eq!((first.pts, first.byte_offset), (Some(0), 44));
        assert_eq!((second.pts, second.byte_offset), (Some(2), 62));
    }

    #[test]
    fn a_file_cut_inside_a_unit_gives_the_units_before_it_and_an_error() {
        let files = [
            (ivf_file(), vec![32, 50]),
            (annexb_file(), vec![8]),
            // A cut between OBUs cannot be noticed here: the last unit is merely shorter.
            (section5_file(), vec![2, 6, 8]),
        ];
        for (file, unnoticed) in files {
            let whole = units(&file).0.concat();
            for length in 0..file.len() {
                let (units, error) = units(&file[..length]);
                assert!(whole.starts_with(&units.concat()), "{length}");
                if unnoticed.contains(&length) {
                    assert!(error.is_none(), "{length}: {error:?}");
                } else {
                    assert!(matches!(error, Some(Error::Malformed { .. })), "{length}");
                }
            }
        }
    }

    #[test]
    fn damage_is_reported_once() {
        let file = ivf_file();
        let mut reader = ContainerReader::new(&file[..55], &Limits::default()).unwrap();
        assert!(reader.next_unit().unwrap().is_some());
        assert!(reader.next_unit().is_err());
        assert!(reader.next_unit().unwrap().is_none());
    }

    #[test]
    fn units_beyond_the_limit_are_refused_before_they_are_read() {
        let limits = Limits {
            max_unit_bytes: 5,
            ..Limits::default()
        };
        for file in [ivf_file(), section5_file(), annexb_file()] {
            let mut reader = ContainerReader::new(&file[..], &limits).unwrap();
            assert!(matches!(
                reader.next_unit(),
                Err(Error::LimitExceeded {
                    limit: "max_unit_bytes",
                    ..
                })
            ));
        }
    }
}
