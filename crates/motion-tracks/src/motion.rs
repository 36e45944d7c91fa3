//! How a vector carries a point, and when two steps of a track agree.

use crate::filter::LocalFit;

/// What moves a point that is not at the centre of the block covering it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Carry {
    /// The block's vector, unchanged over the whole block.
    #[default]
    Translate,
    /// The mean of the block's vector and its neighbours' prediction, extrapolated with the slope of
    /// the neighbours' motion. Weights from the scatter of the neighbours did no better: noisy
    /// vectors and depth edges scatter alike.
    Fuse,
}

/// Which rows of a compound block a point follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Follow {
    /// One: the reference nearest in display order, the past one on a tie.
    #[default]
    Nearest,
    /// All: the point is observed in every reference.
    All,
}

/// Ends a track where its direction of motion turns: the paper's cosine test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cosine {
    /// The cosine between successive steps must be at least `1 - epsilon`.
    pub epsilon: f32,
    /// Steps shorter than this, in px, are not tested.
    pub tau: f32,
}

impl Cosine {
    /// Whether two steps agree; each is the motion towards the past, px.
    pub(crate) fn accepts(self, previous: [f32; 2], step: [f32; 2]) -> bool {
        let dot = previous[0] * step[0] + previous[1] * step[1];
        let lengths = [length(previous), length(step)];
        // `<=` for zero: a step without length has no direction, even with tau = 0.
        lengths
            .iter()
            .any(|&length| length < self.tau || length <= 0.0)
            || dot >= (1.0 - self.epsilon) * lengths[0] * lengths[1]
    }
}

pub(crate) fn length([x, y]: [f32; 2]) -> f32 {
    x.hypot(y)
}

pub(crate) fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    length([a[0] - b[0], a[1] - b[1]])
}

/// First-order motion of a block about its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Motion {
    pub(crate) vector: [f32; 2],
    pub(crate) linear: [f32; 4],
}

impl Motion {
    /// The motion that `carry` asks for; without a fit the block's own.
    pub(crate) fn new(carry: Carry, vector: [f32; 2], fit: Option<&LocalFit>) -> Self {
        let still = Self {
            vector,
            linear: [0.0; 4],
        };
        match (carry, fit) {
            (Carry::Translate, _) | (Carry::Fuse, None) => still,
            (Carry::Fuse, Some(fit)) => Self {
                vector: [0, 1].map(|axis| f32::midpoint(vector[axis], fit.vector[axis])),
                linear: fit.linear,
            },
        }
    }

    /// Offset from the block's centre of the point that arrives at `arrived`, also relative to the
    /// centre; none where the motion folds.
    pub(crate) fn origin_of(&self, arrived: [f32; 2]) -> Option<[f32; 2]> {
        let [xx, xy, yx, yy] = self.linear;
        let (a, d) = (1.0 + xx, 1.0 + yy);
        let determinant = a * d - xy * yx;
        let (x, y) = (arrived[0] - self.vector[0], arrived[1] - self.vector[1]);
        // A picture does not shrink to a quarter, nor turn over, from one frame to another.
        (determinant > 0.25).then(|| {
            [
                (d * x - xy * y) / determinant,
                (a * y - yx * x) / determinant,
            ]
        })
    }

    /// Displacement of the point at `offset` px from the block's centre.
    pub(crate) fn at(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let [xx, xy, yx, yy] = self.linear;
        [
            self.vector[0] + xx * x + xy * y,
            self.vector[1] + yx * x + yy * y,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cosine_test_cuts_turns_and_leaves_short_steps_alone() {
        let cosine = Cosine {
            epsilon: 0.1,
            tau: 1.0,
        };
        assert!(cosine.accepts([10.0, 0.0], [10.0, 2.0]));
        assert!(!cosine.accepts([10.0, 0.0], [0.0, 10.0]));
        assert!(cosine.accepts([10.0, 0.0], [-0.9, 0.0]));
        assert!(
            Cosine {
                epsilon: 0.1,
                tau: 0.0
            }
            .accepts([10.0, 0.0], [0.0, 0.0])
        );
    }

    #[test]
    fn fusion_lies_half_way_between_the_block_and_its_neighbours() {
        let fit = LocalFit {
            residual: 1.0,
            spread: 0.1,
            vector: [1.0, 0.0],
            linear: [0.5, 0.0, 0.0, 0.0],
        };
        let fused = Motion::new(Carry::Fuse, [2.0, 4.0], Some(&fit));
        assert_eq!(fused.at([4.0, 0.0]), [3.5, 2.0]);
    }

    #[test]
    fn the_origin_of_a_point_is_where_the_motion_took_it_from() {
        let motion = Motion {
            vector: [3.0, -2.0],
            linear: [0.25, 0.5, -0.25, 0.0],
        };
        let moved = motion.at([4.0, 8.0]);
        assert_eq!(
            motion.origin_of([4.0 + moved[0], 8.0 + moved[1]]),
            Some([4.0, 8.0])
        );
        let folded = Motion {
            vector: [0.0; 2],
            linear: [-2.0, 0.0, 0.0, 0.0],
        };
        assert_eq!(folded.origin_of([1.0, 1.0]), None);
    }
}
