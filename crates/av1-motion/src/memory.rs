//! Memory whose amount a stream decides: asking for it fails instead of ending the process.
//!
//! Everything else the crate allocates has a size that is fixed by the format, below 100 kB.

use std::sync::Arc;

/// The system has no room for something that [`Limits`](crate::Limits) allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OutOfMemory {
    /// What was asked for.
    pub(crate) bytes: u64,
}

/// `count` copies of `value`.
pub(crate) fn filled<T: Clone>(value: T, count: usize) -> Result<Vec<T>, OutOfMemory> {
    let mut values = Vec::new();
    values
        .try_reserve_exact(count)
        .map_err(|_| out_of_memory::<T>(count))?;
    values.resize(count, value);
    Ok(values)
}

/// A copy of `values`.
pub(crate) fn copied<T: Copy>(values: &[T]) -> Result<Vec<T>, OutOfMemory> {
    let mut copy = Vec::new();
    append(&mut copy, values)?;
    Ok(copy)
}

/// A copy of `values` to be shared.
pub(crate) fn shared<T: Copy>(values: &[T]) -> Result<Arc<Vec<T>>, OutOfMemory> {
    copied(values).map(Arc::new)
}

/// Copies `values` to the end of `target`, which becomes no larger than that needs.
pub(crate) fn append<T: Copy>(target: &mut Vec<T>, values: &[T]) -> Result<(), OutOfMemory> {
    target
        .try_reserve_exact(values.len())
        .map_err(|_| out_of_memory::<T>(values.len()))?;
    target.extend_from_slice(values);
    Ok(())
}

/// Makes room for `additional` values; the room grows in ever larger steps.
#[inline]
pub(crate) fn reserve<T>(target: &mut Vec<T>, additional: usize) -> Result<(), OutOfMemory> {
    target
        .try_reserve(additional)
        .map_err(|_| out_of_memory::<T>(target.len() + additional))
}

fn out_of_memory<T>(count: usize) -> OutOfMemory {
    OutOfMemory {
        bytes: (count as u64).saturating_mul(size_of::<T>() as u64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_machine_has_is_an_error() {
        let error = filled(0_u64, 1 << 50).unwrap_err();
        assert_eq!(error, OutOfMemory { bytes: 1 << 53 });
        assert!(reserve(&mut vec![0_u8], 1 << 60).is_err());
    }

    #[test]
    fn memory_comes_filled_and_copied() {
        assert_eq!(filled(7, 3).unwrap(), [7, 7, 7]);
        let mut target = vec![1, 2];
        append(&mut target, &[3]).unwrap();
        assert_eq!(*shared(&target).unwrap(), [1, 2, 3]);
    }
}
