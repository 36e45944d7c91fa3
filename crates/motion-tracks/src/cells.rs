//! Square cells of a frame, and what lies inside it.

/// Square cells of one frame that hold at most one track each; without a side nothing is limited.
pub(crate) struct Cells {
    side: Option<u32>,
    width: u32,
    height: u32,
    pub(crate) taken: Vec<bool>,
}

impl Cells {
    pub(crate) fn new(side: Option<u32>, width: u32, height: u32) -> Self {
        let side = side.map(|side| side.max(1));
        let count = side.map_or(0, |side| {
            width.div_ceil(side) as usize * height.div_ceil(side) as usize
        });
        Self {
            side,
            width,
            height,
            taken: vec![false; count],
        }
    }

    /// Middles of all cells inside the picture, line by line.
    #[expect(
        clippy::cast_precision_loss,
        reason = "pictures are at most 2^16 px wide and high"
    )]
    pub(crate) fn middles(side: u32, width: u32, height: u32) -> impl Iterator<Item = [f32; 2]> {
        let half = side as f32 / 2.0;
        (0..height.div_ceil(side)).flat_map(move |line| {
            (0..width.div_ceil(side))
                .map(move |column| [(column * side) as f32 + half, (line * side) as f32 + half])
        })
    }

    pub(crate) fn contains(&self, xy: [f32; 2]) -> bool {
        inside(xy, self.width, self.height)
    }

    /// Takes the cell at `xy`; false if it was taken. Points outside the picture belong to no cell.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked to be inside"
    )]
    pub(crate) fn claim(&mut self, xy: [f32; 2]) -> bool {
        let Some(side) = self.side else { return true };
        if !self.contains(xy) {
            return false;
        }
        let columns = self.width.div_ceil(side) as usize;
        let cell = (xy[1] as u32 / side) as usize * columns + (xy[0] as u32 / side) as usize;
        // A frame of another size under the same display index keeps its own picture limits.
        self.taken
            .get_mut(cell)
            .is_some_and(|taken| !std::mem::replace(taken, true))
    }
}

/// Whether a point, px, lies in a picture.
#[expect(
    clippy::cast_precision_loss,
    reason = "pictures are at most 2^16 px wide and high"
)]
pub(crate) fn inside([x, y]: [f32; 2], width: u32, height: u32) -> bool {
    x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32
}
