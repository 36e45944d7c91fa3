//! What affine fits of a curved motion miss.
//!
//! Around a block the motion of a scene is not affine: on a road seen from a car it grows with the
//! square of the distance to the horizon. A fit through the neighbours then passes beside the block,
//! always on the same side, and what is smoothed with it leans: over many frames that bends a camera
//! path, although every single vector becomes more exact. Neighbours lean as the block does, so what
//! their own vectors have left over tells by how much.

use crate::filter::{LocalFit, MIN_SCALE};
use crate::motion::distance;

/// Which rows voted on which, and with what weight.
#[derive(Default)]
pub(crate) struct Support {
    rows: Vec<(u32, usize)>,
    votes: Vec<(u32, f32)>,
}

impl Support {
    /// Adds the votes on one row.
    pub(crate) fn push(&mut self, row: u32, votes: impl Iterator<Item = (u32, f32)>) {
        self.votes.extend(votes);
        self.rows.push((row, self.votes.len()));
    }
}

/// Residual, in units of the scatter around it, from which on a vector is no witness.
const CUT: f32 = 1.4;

/// Moves every fit by the mean of what its neighbours' fits miss of their own vectors.
///
/// Wrong vectors would bend this mean as they would bend a fit: those far from their own
/// surroundings have no vote (Tukey's weights).
pub(crate) fn add_curvature(vectors: &[[f32; 2]], fits: &mut [LocalFit], support: &Support) {
    let witnesses: Vec<f32> = fits.iter().map(steadiness).collect();
    let mut shifts = Vec::with_capacity(support.rows.len());
    let mut start = 0;
    for &(_, end) in &support.rows {
        let (mut total, mut sum) = (0.0, [0.0; 2]);
        for &(neighbor, weight) in &support.votes[start..end] {
            let neighbor = neighbor as usize;
            let weight = weight * witnesses[neighbor];
            total += weight;
            let (own, fitted) = (vectors[neighbor], fits[neighbor].vector);
            sum = [0, 1].map(|axis| sum[axis] + weight * (own[axis] - fitted[axis]));
        }
        start = end;
        shifts.push(sum.map(|sum| if total > 0.0 { sum / total } else { 0.0 }));
    }
    for (&(row, _), shift) in support.rows.iter().zip(shifts) {
        let fit = &mut fits[row as usize];
        fit.vector = [0, 1].map(|axis| fit.vector[axis] + shift[axis]);
        fit.residual = distance(vectors[row as usize], fit.vector);
    }
}

/// How much the vector of a row counts as a witness, 0 to 1.
fn steadiness(fit: &LocalFit) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "a constant")]
    let scale = fit.spread.max(MIN_SCALE as f32);
    // Infinite residuals come with an infinite spread: the ratio is no number, and the maximum 0.
    let ratio = fit.residual / (CUT * scale);
    (1.0 - ratio * ratio).max(0.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(residual: f32, spread: f32) -> LocalFit {
        LocalFit {
            residual,
            spread,
            vector: [0.0; 2],
            linear: [0.0; 4],
        }
    }

    #[test]
    fn what_fits_miss_in_common_is_added() {
        let mut fits = vec![fit(0.1, 0.1); 3];
        let vectors = [[0.1, 0.0]; 3];
        let mut support = Support::default();
        support.push(0, [(1, 1.0), (2, 3.0)].into_iter());
        add_curvature(&vectors, &mut fits, &support);
        assert!(distance(fits[0].vector, [0.1, 0.0]) < 1e-6 && fits[0].residual < 1e-6);
        assert_eq!(fits[1], fit(0.1, 0.1));
    }

    #[test]
    fn vectors_far_from_their_surroundings_and_unconfirmed_ones_are_no_witnesses() {
        let mut fits = vec![
            fit(0.0, 0.1),
            fit(9.0, 0.1),
            fit(f32::INFINITY, f32::INFINITY),
        ];
        let before = fits.clone();
        let mut support = Support::default();
        support.push(0, [(1, 1.0), (2, 1.0)].into_iter());
        add_curvature(&[[0.0; 2], [9.0, 0.0], [5.0, 5.0]], &mut fits, &support);
        assert_eq!(fits, before);
    }
}
