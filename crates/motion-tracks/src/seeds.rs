//! Where tracks may start in a frame.

use crate::cells::Cells;
use crate::cover::Cover;
use crate::field::{center, half_sizes};
use crate::link::{Layer, LinkOptions};
use crate::motion::{Carry, Motion, distance};

/// The points of one kind of tracks.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Seeds {
    /// In the most accurate blocks first: the centre of each, and in blocks that move as one, with a
    /// spacing, also points so many px apart.
    Blocks { spacing: Option<u32> },
    /// The middle of every cell, so many px wide, that a usable block covers.
    Cells { side: u32 },
}

impl Seeds {
    /// Those of the tracks that are matched.
    pub(crate) fn in_blocks(options: &LinkOptions) -> Self {
        // Points that are translated know no slope: nothing tells which blocks move as one.
        let spacing = match options.carry {
            Carry::Translate => None,
            Carry::Fuse => options.cell.map(|side| side.saturating_mul(2).max(1)),
        };
        Self::Blocks { spacing }
    }

    pub(crate) fn of(self, layer: &Layer, cover: &Cover) -> Vec<[f32; 2]> {
        match self {
            Self::Blocks { spacing } => in_blocks(layer, cover, spacing),
            Self::Cells { side } => Cells::middles(side, layer.width, layer.height)
                .filter(|&xy| cover.rows_at(xy).next().is_some())
                .collect(),
        }
    }
}

fn in_blocks(layer: &Layer, cover: &Cover, spacing: Option<u32>) -> Vec<[f32; 2]> {
    let mut rows: Vec<usize> = (0..layer.len())
        .filter(|&row| cover.is_first(&layer.block(row), row))
        .collect();
    if !layer.errors.is_empty() {
        rows.sort_by(|&a, &b| layer.errors[a].total_cmp(&layer.errors[b]));
    }
    let mut points = Vec::with_capacity(rows.len());
    for row in rows {
        let block = layer.block(row);
        match spacing {
            Some(spacing) if moves_as_one(&layer.motion(row), block) => {
                points.extend(lattice(block, spacing));
            }
            _ => points.push(center(block)),
        }
    }
    points
}

/// Difference of the motion at a block's corner from that at its centre below which the block moves
/// as one, px: a quarter of the finest step of a vector. Elsewhere points off the centre lean.
const SAME_MOTION: f32 = 1.0 / 32.0;

fn moves_as_one(motion: &Motion, block: [i32; 4]) -> bool {
    let [x, y] = half_sizes(block);
    [[x, y], [x, -y]]
        .iter()
        .all(|&corner| distance(motion.at(corner), motion.vector) < SAME_MOTION)
}

/// Points of a block about `spacing` px apart, evenly and around the centre.
#[expect(clippy::cast_precision_loss, reason = "sides are below 2^16 px")]
fn lattice([x, y, w, h]: [i32; 4], spacing: u32) -> impl Iterator<Item = [f32; 2]> {
    let count = |side: i32| (side.unsigned_abs() / spacing).max(1);
    let at = |start: i32, side: i32, index: u32, count: u32| {
        start as f32 + side as f32 * (index as f32 + 0.5) / count as f32
    };
    let (columns, lines) = (count(w), count(h));
    (0..lines).flat_map(move |line| {
        (0..columns).map(move |column| [at(x, w, column, columns), at(y, h, line, lines)])
    })
}
