//! Neighbour consistency: does a vector agree with an affine motion of the blocks around it?

use crate::curvature::{Support, add_curvature};
use crate::field::{Field, center};
use crate::motion::distance;
use crate::neighbors::{NeighborSearch, Neighbors};

/// Upper bound of [`FitOptions::neighbors`].
pub(crate) const MAX_NEIGHBORS: usize = 32;

/// How the local motion is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Number of nearest blocks with the same reference that vote, at most 32.
    pub neighbors: usize,
    /// With fewer neighbours than this a vector stays unconfirmed: its residual is infinite.
    pub min_neighbors: usize,
    /// Reweighting rounds after the first fit.
    pub rounds: usize,
    /// Weight of the prior "no linear part", relative to the sum of the weights.
    pub ridge: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            neighbors: 12,
            min_neighbors: 4,
            rounds: 3,
            ridge: 0.02,
        }
    }
}

/// What the neighbours of a block say about its motion; the block itself has no vote.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFit {
    /// Distance between the block's vector and `vector`, px; infinite if unconfirmed.
    pub residual: f32,
    /// Robust scatter of the neighbours' vectors about the fit, px; infinite if unconfirmed.
    pub spread: f32,
    /// Motion of the surroundings at the block's centre, px; the block's own vector if unconfirmed.
    pub vector: [f32; 2],
    /// `[dx/dx, dx/dy, dy/dx, dy/dy]` of the vector field, px per px; zero if unconfirmed.
    pub linear: [f32; 4],
}

/// Fits the motion around every row from the nearest blocks that use the same reference.
///
/// Neighbours are weighted by distance and, in each further round, by their own residual (Cauchy),
/// so that a minority of wrong vectors does not bend the fit. Then what the fits miss in common is
/// added: motion is curved. Scaling the blocks leaves the choice of neighbours alone: equal
/// distances are ordered by row.
///
/// # Panics
/// If the field does not pass [`Field::validate`].
#[must_use]
pub fn fit_neighbors(field: &Field<'_>, options: &FitOptions) -> Vec<LocalFit> {
    let unconfirmed = |&vector: &[f32; 2]| LocalFit {
        residual: f32::INFINITY,
        spread: f32::INFINITY,
        vector,
        linear: [0.0; 4],
    };
    let mut fits: Vec<LocalFit> = field.vectors.iter().map(unconfirmed).collect();
    let mut support = Support::default();
    let count = options.neighbors.clamp(1, MAX_NEIGHBORS);
    for rows in rows_by_reference(field.references) {
        let search = NeighborSearch::new(field.blocks, &rows);
        for &row in &rows {
            let neighbors = search.nearest(row, count);
            if neighbors.len() >= options.min_neighbors.max(1) {
                fits[row as usize] = fit_row(field, row, &neighbors, options, &mut support);
            }
        }
    }
    add_curvature(field.vectors, &mut fits, &support);
    fits
}

/// Row numbers of each reference, references ascending.
fn rows_by_reference(references: &[i32]) -> Vec<Vec<u32>> {
    let mut values: Vec<i32> = references.to_vec();
    values.sort_unstable();
    values.dedup();
    let mut groups = vec![Vec::new(); values.len()];
    for (reference, row) in references.iter().zip(0_u32..) {
        if let Ok(group) = values.binary_search(reference) {
            groups[group].push(row);
        }
    }
    groups
}

/// One neighbour, relative to the block: offset in units of the farthest one's distance, and vector.
#[derive(Clone, Copy, Default)]
struct Vote {
    u: f64,
    v: f64,
    mv: [f64; 2],
    near: f64,
    weight: f64,
    residual: f64,
}

fn fit_row(
    field: &Field<'_>,
    row: u32,
    neighbors: &Neighbors,
    options: &FitOptions,
    support: &mut Support,
) -> LocalFit {
    let mut storage = [Vote::default(); MAX_NEIGHBORS];
    let votes = &mut storage[..neighbors.len()];
    let scale = gather(field, row, neighbors, votes);
    let mut model = solve(votes, options.ridge);
    let mut spread = reweight(votes, &model);
    for _ in 0..options.rounds {
        model = solve(votes, options.ridge);
        spread = reweight(votes, &model);
    }
    let weights = votes.iter().map(|vote| narrow(vote.weight));
    support.push(row, neighbors.rows().zip(weights));
    let [x, y] = model;
    let vector = [narrow(x[0]), narrow(y[0])];
    LocalFit {
        residual: distance(field.vectors[row as usize], vector),
        spread: narrow(spread),
        vector,
        linear: [x[1], x[2], y[1], y[2]].map(|slope| narrow(slope / scale)),
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "the result is delivered in single precision"
)]
fn narrow(value: f64) -> f32 {
    value as f32
}

/// Fills the votes; returns the distance of the farthest neighbour in px.
fn gather(field: &Field<'_>, row: u32, neighbors: &Neighbors, votes: &mut [Vote]) -> f64 {
    let [x, y] = center(field.blocks[row as usize]).map(f64::from);
    let mut farthest = 0.0_f64;
    for (vote, neighbor) in votes.iter_mut().zip(neighbors.rows()) {
        let at = center(field.blocks[neighbor as usize]).map(f64::from);
        (vote.u, vote.v) = (at[0] - x, at[1] - y);
        vote.mv = field.vectors[neighbor as usize].map(f64::from);
        farthest = farthest.max(vote.u.hypot(vote.v));
    }
    let scale = farthest.max(1.0);
    for vote in votes {
        vote.u /= scale;
        vote.v /= scale;
        vote.near = 1.0 / (0.25 + vote.u * vote.u + vote.v * vote.v);
        vote.weight = vote.near;
    }
    scale
}

/// Smallest residual scale of the reweighting, px: vectors are quantised and search is not exact.
pub(crate) const MIN_SCALE: f64 = 0.25;

/// Cauchy weights about the current model; returns the median residual, px.
fn reweight(votes: &mut [Vote], [x, y]: &[[f64; 3]; 2]) -> f64 {
    let mut sorted = [0.0_f64; MAX_NEIGHBORS];
    for (vote, slot) in votes.iter_mut().zip(&mut sorted) {
        let dx = x[0] + x[1] * vote.u + x[2] * vote.v - vote.mv[0];
        let dy = y[0] + y[1] * vote.u + y[2] * vote.v - vote.mv[1];
        vote.residual = dx.hypot(dy);
        *slot = vote.residual;
    }
    let residuals = &mut sorted[..votes.len()];
    residuals.sort_unstable_by(f64::total_cmp);
    let median = residuals[residuals.len() / 2];
    let scale = median.max(MIN_SCALE);
    for vote in votes {
        let normalized = vote.residual / scale;
        vote.weight = vote.near / (1.0 + normalized * normalized);
    }
    median
}

/// Weighted least squares of `mv = m0 + m1 u + m2 v`, both components; the ridge holds m1, m2 small.
#[expect(
    clippy::many_single_char_names,
    reason = "the sums of the normal equations"
)]
fn solve(votes: &[Vote], ridge: f64) -> [[f64; 3]; 2] {
    let (mut s, mut su, mut sv, mut suu, mut suv, mut svv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let mut right = [[0.0_f64; 3]; 2];
    for vote in votes {
        let (w, u, v) = (vote.weight, vote.u, vote.v);
        let (wu, wv) = (w * u, w * v);
        s += w;
        su += wu;
        sv += wv;
        suu += wu * u;
        suv += wu * v;
        svv += wv * v;
        for (sums, mv) in right.iter_mut().zip(vote.mv) {
            sums[0] += w * mv;
            sums[1] += wu * mv;
            sums[2] += wv * mv;
        }
    }
    // Eliminating the constant leaves a 2x2 system that the ridge keeps invertible.
    let (mu, mv) = (su / s, sv / s);
    let hold = ridge * s + f64::EPSILON;
    let (a, b, d) = (suu - su * mu + hold, suv - su * mv, svv - sv * mv + hold);
    let determinant = a * d - b * b;
    right.map(|[t, tu, tv]| {
        let (p, q) = (tu - t * mu, tv - t * mv);
        let (slope_u, slope_v) = ((d * p - b * q) / determinant, (a * q - b * p) / determinant);
        [t / s - slope_u * mu - slope_v * mv, slope_u, slope_v]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8 px blocks on a square grid whose vectors follow `motion` of the block centre.
    fn grid(side: i32, motion: impl Fn([f32; 2]) -> [f32; 2]) -> (Vec<[i32; 4]>, Vec<[f32; 2]>) {
        let blocks: Vec<[i32; 4]> = (0..side * side)
            .map(|i| [8 * (i % side), 8 * (i / side), 8, 8])
            .collect();
        let vectors = blocks.iter().map(|&block| motion(center(block))).collect();
        (blocks, vectors)
    }

    fn fit(blocks: &[[i32; 4]], vectors: &[[f32; 2]], references: &[i32]) -> Vec<LocalFit> {
        let field = Field {
            frame: 1,
            width: 256,
            height: 256,
            blocks,
            vectors,
            references,
            energies: &[],
        };
        fit_neighbors(&field, &FitOptions::default())
    }

    #[test]
    fn a_field_of_one_translation_fits_itself_exactly() {
        let (blocks, vectors) = grid(6, |_| [3.25, -1.5]);
        for fit in fit(&blocks, &vectors, &[0; 36]) {
            assert!(fit.residual < 1e-5 && fit.linear.iter().all(|slope| slope.abs() < 1e-6));
        }
    }

    #[test]
    fn one_wrong_vector_stands_out_and_does_not_bend_its_neighbours() {
        let (blocks, mut vectors) = grid(7, |_| [4.0, 0.0]);
        vectors[24] = [-20.0, 9.0];
        let fits = fit(&blocks, &vectors, &[0; 49]);
        assert!(fits[24].residual > 25.0);
        assert!(
            (0..49)
                .filter(|&row| row != 24)
                .all(|row| fits[row].residual < 0.5)
        );
    }

    #[test]
    fn a_zoom_is_seen_as_a_linear_part() {
        let (blocks, vectors) = grid(9, |[x, y]| [0.05 * (x - 36.0), 0.05 * (y - 36.0)]);
        let middle = fit(&blocks, &vectors, &[0; 81])[40];
        assert!(middle.residual < 0.05);
        assert!((middle.linear[0] - 0.05).abs() < 0.01 && middle.linear[1].abs() < 0.01);
        assert!((middle.linear[3] - 0.05).abs() < 0.01);
    }

    #[test]
    fn blocks_of_another_reference_have_no_vote() {
        let (blocks, vectors) = grid(6, |[x, _]| {
            if (x - 4.0) % 16.0 == 0.0 {
                [5.0, 0.0]
            } else {
                [-5.0, 0.0]
            }
        });
        let references: Vec<i32> = (0..36).map(|i| i % 2).collect();
        assert!(
            fit(&blocks, &vectors, &references)
                .iter()
                .all(|fit| fit.residual < 1e-4)
        );
    }

    #[test]
    fn a_block_with_too_few_neighbours_stays_unconfirmed_with_its_own_vector() {
        let (blocks, vectors) = grid(2, |_| [1.0, 2.0]);
        for fit in fit(&blocks, &vectors, &[0; 4]) {
            assert_eq!((fit.residual, fit.vector), (f32::INFINITY, [1.0, 2.0]));
        }
    }
}
