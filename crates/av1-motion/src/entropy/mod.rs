//! §8.2, §8.3 Entropy decoding: the symbol decoder and the distributions it adapts.

pub(crate) mod cdf;
pub(crate) mod cdf_set;
pub(crate) mod symbol;
