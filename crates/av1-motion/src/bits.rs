//! §4.10, §8.1: fixed-length and variable-length codes.

use std::borrow::Cow;

use crate::error::{Error, Result};

/// §4.9, §8.1: reads syntax elements from a byte string, high bit first.
#[derive(Debug, Clone)]
pub(crate) struct BitReader<'a> {
    data: &'a [u8],
    /// Bits read so far.
    position: usize,
    /// Offset of `data[0]` in whatever the caller counts, for error messages only.
    base_offset: u64,
}

impl<'a> BitReader<'a> {
    /// Reads `data`, whose first byte is byte `base_offset` in error messages.
    pub(crate) fn new(data: &'a [u8], base_offset: u64) -> Self {
        Self {
            data,
            position: 0,
            base_offset,
        }
    }

    /// §4.9 `get_position`: bits read so far.
    pub(crate) fn position(&self) -> usize {
        self.position
    }

    /// Bits not yet read.
    pub(crate) fn remaining(&self) -> usize {
        self.data.len() * 8 - self.position
    }

    /// Offset of the byte that holds the next bit, base included.
    pub(crate) fn byte_offset(&self) -> u64 {
        self.base_offset + (self.position / 8) as u64
    }

    /// A broken rule at the current position.
    pub(crate) fn malformed(
        &self,
        section: &'static str,
        reason: impl Into<Cow<'static, str>>,
    ) -> Error {
        Error::malformed(section, self.byte_offset(), reason)
    }

    /// A frame that is needed at the current position but not there.
    pub(crate) fn missing(
        &self,
        section: &'static str,
        reason: impl Into<Cow<'static, str>>,
    ) -> Error {
        Error::MissingReference {
            reason: reason.into(),
            section,
            byte_offset: self.byte_offset(),
        }
    }

    /// §4.10.2 f(n): unsigned number of `count` bits, 0 to 32.
    pub(crate) fn f(&mut self, count: u32) -> Result<u32> {
        debug_assert!(count <= 32);
        if count as usize > self.remaining() {
            return Err(Error::malformed(
                "8.1",
                self.base_offset + self.data.len() as u64,
                "the data ends inside a header",
            ));
        }
        let mut value = 0_u64;
        let mut needed = count as usize;
        while needed > 0 {
            let byte = u64::from(self.data[self.position / 8]);
            let available = 8 - self.position % 8;
            let taken = needed.min(available);
            let bits = (byte >> (available - taken)) & ((1 << taken) - 1);
            value = (value << taken) | bits;
            self.position += taken;
            needed -= taken;
        }
        Ok((value & 0xffff_ffff) as u32)
    }

    /// §4.10.2 f(n) for numbers of at most 8 bits.
    pub(crate) fn f8(&mut self, count: u32) -> Result<u8> {
        debug_assert!(count <= 8);
        Ok((self.f(count)? & 0xff) as u8)
    }

    /// §4.10.2 f(n) for numbers of at most 16 bits.
    pub(crate) fn f16(&mut self, count: u32) -> Result<u16> {
        debug_assert!(count <= 16);
        Ok((self.f(count)? & 0xffff) as u16)
    }

    /// §4.10.2 f(1) as a truth value.
    pub(crate) fn flag(&mut self) -> Result<bool> {
        Ok(self.f(1)? == 1)
    }

    /// §4.10.3 `uvlc()`.
    pub(crate) fn uvlc(&mut self) -> Result<u32> {
        let mut leading_zeros = 0;
        while !self.flag()? {
            leading_zeros += 1;
        }
        if leading_zeros >= 32 {
            return Ok(u32::MAX);
        }
        Ok(self.f(leading_zeros)? + ((1 << leading_zeros) - 1))
    }

    /// §4.10.4 le(n): little-endian number of `count` bytes, 0 to 4.
    pub(crate) fn le(&mut self, count: u32) -> Result<u32> {
        let mut value = 0;
        for index in 0..count {
            value |= self.f(8)? << (8 * index);
        }
        Ok(value)
    }

    /// §4.10.5 `leb128()`, with the two rules of that section.
    pub(crate) fn leb128(&mut self) -> Result<u32> {
        let mut value = 0_u64;
        for index in 0..8 {
            let byte = u64::from(self.f(8)?);
            value |= (byte & 0x7f) << (7 * index);
            if byte & 0x80 == 0 {
                return u32::try_from(value)
                    .map_err(|_| self.malformed("4.10.5", "a leb128 number exceeds 32 bits"));
            }
        }
        Err(self.malformed("4.10.5", "a leb128 number is longer than 8 bytes"))
    }

    /// §4.10.6 su(n): signed number of `count` bits, 1 to 31.
    pub(crate) fn su(&mut self, count: u32) -> Result<i32> {
        debug_assert!((1..32).contains(&count));
        let value = self.f(count)?.cast_signed();
        let sign_mask = 1 << (count - 1);
        Ok(if value & sign_mask == 0 {
            value
        } else {
            value - 2 * sign_mask
        })
    }

    /// §4.10.6 su(1+6), the form of all coded deltas: -64 to 63.
    pub(crate) fn su7(&mut self) -> Result<i8> {
        // Moving the sign to bit 7 and back extends it.
        Ok((self.f8(7)? << 1).cast_signed() >> 1)
    }

    /// §4.10.7 ns(n): number in `0..count`; `count` is 1 to 2^30.
    pub(crate) fn ns(&mut self, count: u32) -> Result<u32> {
        debug_assert!((1..=1 << 30).contains(&count));
        let width = count.ilog2() + 1;
        let short_codes = (1 << width) - count;
        let value = self.f(width - 1)?;
        if value < short_codes {
            return Ok(value);
        }
        Ok((value << 1) - short_codes + self.f(1)?)
    }

    /// Skips `count` whole bytes, which the caller knows to be there.
    pub(crate) fn skip_bytes(&mut self, count: usize) {
        debug_assert!(count * 8 <= self.remaining());
        self.position += count * 8;
    }

    /// §5.3.5 `byte_alignment`: skips to the next byte; the skipped bits must be zero.
    pub(crate) fn byte_alignment(&mut self) -> Result<()> {
        while !self.position.is_multiple_of(8) {
            if self.flag()? {
                return Err(self.malformed("6.2.5", "a byte-alignment bit is not zero"));
            }
        }
        Ok(())
    }

    /// §5.3.4 `trailing_bits`: the rest of the data must be a one followed by zeros.
    pub(crate) fn trailing_bits(&mut self) -> Result<()> {
        if self.remaining() == 0 || !self.flag()? {
            return Err(self.malformed("6.2.4", "trailing_one_bit is missing"));
        }
        while self.remaining() > 0 {
            let count = if self.remaining() < 32 { 1 } else { 32 };
            if self.f(count)? != 0 {
                return Err(self.malformed("6.2.4", "a trailing_zero_bit is not zero"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reader(data: &[u8]) -> BitReader<'_> {
        BitReader::new(data, 100)
    }

    #[test]
    fn fixed_length_numbers_cross_byte_borders() {
        let mut bits = reader(&[0b1010_0110, 0b1100_0000, 0xff, 0xff, 0xff, 0xff]);
        assert_eq!(bits.f(3).unwrap(), 0b101);
        assert_eq!(bits.f(0).unwrap(), 0);
        assert_eq!(bits.f(7).unwrap(), 0b001_1011);
        assert_eq!(bits.position(), 10);
        assert_eq!(bits.f(6).unwrap(), 0);
        assert_eq!(bits.f(32).unwrap(), u32::MAX);
        assert_eq!(bits.remaining(), 0);
    }

    #[test]
    fn reading_past_the_end_reports_the_end() {
        let mut bits = reader(&[0xff]);
        assert!(matches!(
            bits.f(9),
            Err(Error::Malformed {
                byte_offset: 101,
                ..
            })
        ));
    }

    #[test]
    fn signed_numbers_use_twos_complement() {
        let mut bits = reader(&[0b1000_0000, 0b1111_1110, 0b0111_1111]);
        assert_eq!(bits.su(7).unwrap(), -64);
        assert_eq!(bits.f(1).unwrap(), 0);
        assert_eq!(bits.su(7).unwrap(), -1);
        assert_eq!(bits.f(1).unwrap(), 0);
        assert_eq!(bits.su(8).unwrap(), 127);
    }

    #[test]
    fn non_symmetric_numbers_follow_the_table_of_five() {
        // 00, 01, 10, 110, 111 of the table in §4.10.7.
        let mut bits = reader(&[0b0001_1011, 0b0111_0000]);
        let values: Vec<u32> = (0..5).map(|_| bits.ns(5).unwrap()).collect();
        assert_eq!(values, [0, 1, 2, 3, 4]);
        assert_eq!(bits.position(), 12);
        assert_eq!(bits.ns(1).unwrap(), 0);
        assert_eq!(bits.position(), 12);
    }

    #[test]
    fn variable_length_numbers_follow_their_zeros() {
        let mut bits = reader(&[0b1010_0110, 0b0100_0000]);
        assert_eq!(bits.uvlc().unwrap(), 0);
        assert_eq!(bits.uvlc().unwrap(), 1);
        assert_eq!(bits.uvlc().unwrap(), 2);
        assert_eq!(bits.uvlc().unwrap(), 3);
        assert_eq!(reader(&[0, 0, 0, 0, 0x80]).uvlc().unwrap(), u32::MAX);
        assert!(reader(&[0; 9]).uvlc().is_err());
        let largest_coded = [0, 0, 0, 1, 0xff, 0xff, 0xff, 0xfe];
        assert_eq!(reader(&largest_coded).uvlc().unwrap(), u32::MAX - 1);
    }

    #[test]
    fn leb128_accepts_padding_and_refuses_more_than_32_bits() {
        assert_eq!(reader(&[0xe5, 0x8e, 0x26]).leb128().unwrap(), 624_485);
        assert_eq!(reader(&[0x85, 0x80, 0x80, 0x00]).leb128().unwrap(), 5);
        let largest = [0xff, 0xff, 0xff, 0xff, 0x0f];
        assert_eq!(reader(&largest).leb128().unwrap(), u32::MAX);
        assert!(reader(&[0xff, 0xff, 0xff, 0xff, 0x1f]).leb128().is_err());
        assert!(reader(&[0x80; 9]).leb128().is_err());
        assert!(reader(&[0x80]).leb128().is_err());
    }

    #[test]
    fn little_endian_numbers_start_with_the_low_byte() {
        assert_eq!(reader(&[1, 2, 3, 4]).le(4).unwrap(), 0x0403_0201);
        assert_eq!(reader(&[7]).le(1).unwrap(), 7);
    }

    #[test]
    fn alignment_bits_must_be_zero() {
        let mut clean = reader(&[0b1000_0000, 1]);
        clean.f(1).unwrap();
        clean.byte_alignment().unwrap();
        clean.byte_alignment().unwrap();
        assert_eq!(clean.position(), 8);
        let mut dirty = reader(&[0b1000_0001]);
        dirty.f(1).unwrap();
        assert!(dirty.byte_alignment().is_err());
    }

    #[test]
    fn trailing_bits_are_a_one_and_zeros() {
        assert!(reader(&[0x80, 0, 0, 0, 0, 0]).trailing_bits().is_ok());
        assert!(reader(&[0x80, 0, 0, 0, 0, 1]).trailing_bits().is_err());
        assert!(reader(&[0x40]).trailing_bits().is_err());
        assert!(reader(&[]).trailing_bits().is_err());
    }
}
