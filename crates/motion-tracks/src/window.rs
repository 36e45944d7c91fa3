//! The walks over one window of frames.
//!
//! A reference always decodes before the frame that uses it. Going backwards, every point that can
//! reach a frame has therefore arrived when the frame's turn comes, whatever the prediction structure.
//! A second walk, in decode order, reaches into the frames that refer to a track's.
//!
//! A clip is cut into windows. Tracks that live at the border are carried on first, the way of the
//! second walk: they have the best claim on the cells. Then the window is walked as a whole clip is,
//! around them; new points may go on into the last frames before it, where room was left.

use std::collections::BTreeMap;

use crate::chain::Chain;
use crate::cover::Cover;
use crate::extend::Extension;
use crate::link::Layer;
use crate::seeds::Seeds;

/// Display frames before the newest one of a window that stay open for the next window: hidden frames
/// come up to 32 early.
pub(crate) const REACH: i32 = 32;

/// Chains layers of which the first `num_chained` were chained before, with all that led to them.
pub(crate) fn chain_window(chain: &mut Chain, layers: &[Layer], num_chained: usize, seeds: Seeds) {
    extend(chain, &layers[num_chained..]);
    chain.occupy_own();
    walk_back(chain, layers, num_chained, seeds);
    if chain.options.extend {
        extend(chain, layers);
    }
}

fn extend(chain: &mut Chain, layers: &[Layer]) {
    let mut extension = Extension::new(chain);
    for layer in layers {
        extension.visit(layer);
    }
}

fn walk_back(chain: &mut Chain, layers: &[Layer], num_chained: usize, seeds: Seeds) {
    let mut codings: BTreeMap<i32, u32> = BTreeMap::new();
    for layer in layers {
        *codings.entry(layer.frame).or_default() += 1;
    }
    for (index, layer) in layers.iter().enumerate().rev() {
        // A hidden frame and the overlay that is shown for it carry one display index.
        let again = codings.get_mut(&layer.frame).is_some_and(|left| {
            *left -= 1;
            *left > 0
        });
        let is_fresh = index >= num_chained;
        if !is_fresh && !chain.awaits(layer.frame) {
            continue;
        }
        let blocks: Vec<[i32; 4]> = (0..layer.len()).map(|row| layer.block(row)).collect();
        let cover = Cover::new(layer.width, layer.height, &blocks);
        let points = if is_fresh {
            seeds.of(layer, &cover)
        } else {
            Vec::new()
        };
        chain.visit(layer, &cover, &points, again);
    }
    let (width, height) = layers.iter().fold((1, 1), |size, layer| {
        (size.0.max(layer.width), size.1.max(layer.height))
    });
    chain.settle_rest(width, height);
}
