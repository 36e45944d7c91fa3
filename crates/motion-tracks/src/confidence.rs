//! How far off a vector is expected to be.

use crate::field::Field;
use crate::filter::{FitOptions, LocalFit, fit_neighbors};

/// Distribution of a vector's error, given how it fits its surroundings and how it was coded.
///
/// Its logarithm lies around a linear function of the evidence. Where the weights come from is the
/// caller's business.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorModel {
    /// Weights of: 1; a = ln(residual + 0.1); b = ln(spread + 0.1); a b; ln(1 + energy);
    /// ln(slope + 0.003). Residual and spread in px, energy in coefficient levels per 16 px, slope
    /// the norm of the linear part.
    pub weights: [f64; 6],
}

impl ErrorModel {
    /// Median error of a vector fused with its surroundings, px; infinite if it is unconfirmed.
    #[must_use]
    pub fn median_error(&self, fit: &LocalFit, energy: f32) -> f32 {
        if !fit.residual.is_finite() {
            return f32::INFINITY;
        }
        let a = (f64::from(fit.residual) + 0.1).ln();
        let b = (f64::from(fit.spread) + 0.1).ln();
        let slope: f64 = fit
            .linear
            .iter()
            .map(|&s| f64::from(s) * f64::from(s))
            .sum();
        let evidence = [
            1.0,
            a,
            b,
            a * b,
            f64::from(energy.max(0.0)).ln_1p(),
            (slope.sqrt() + 0.003).ln(),
        ];
        let log: f64 = self.weights.iter().zip(evidence).map(|(w, e)| w * e).sum();
        #[expect(clippy::cast_possible_truncation, reason = "an error of a vector fits")]
        let error = log.exp() as f32;
        error
    }
}

/// Median error of every row of a field, px.
///
/// # Panics
/// If the field does not pass [`Field::validate`].
#[must_use]
pub fn vector_errors(field: &Field<'_>, fit: &FitOptions, model: &ErrorModel) -> Vec<f32> {
    let fits = fit_neighbors(field, fit);
    let rows = fits.iter().enumerate();
    rows.map(|(row, fit)| model.median_error(fit, field.energy(row)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error grows with the residual and with what was coded, and with nothing else.
    const MODEL: ErrorModel = ErrorModel {
        weights: [0.0, 1.0, 0.0, 0.0, 1.0, 0.0],
    };

    fn fit(residual: f32) -> LocalFit {
        LocalFit {
            residual,
            spread: 0.25,
            vector: [0.0; 2],
            linear: [0.0; 4],
        }
    }

    #[test]
    fn the_error_follows_the_evidence() {
        assert!((MODEL.median_error(&fit(0.4), 0.0) - 0.5).abs() < 1e-6);
        assert!((MODEL.median_error(&fit(0.4), 3.0) - 2.0).abs() < 1e-5);
    }

    #[test]
    fn an_unconfirmed_vector_may_be_off_by_any_distance() {
        assert_eq!(MODEL.median_error(&fit(f32::INFINITY), 0.0), f32::INFINITY);
    }
}
