//! For which pixel references are made: a tile's primary rays begin its pixels, row by row.

use ground::ids::TileId;
use trace::picture::{Rect, Tiling};
use trace::tracer::RayKind;

/// Follows a stream of references over the pixels of the image.
#[derive(Clone, Copy, Debug)]
pub struct Pixels {
    tiling: Tiling,
    rect: Rect,
    /// Primary rays of the tile so far.
    begun: u32,
}

impl Pixels {
    pub fn new(tiling: Tiling) -> Self {
        Self { tiling, rect: Rect { x: 0, y: 0, width: 0, height: 0 }, begun: 0 }
    }

    /// A tile begins. One that the image does not have is without pixels.
    pub fn tile(&mut self, tile: TileId) {
        self.rect = self.tiling.rect(tile).unwrap_or(Rect { x: 0, y: 0, width: 0, height: 0 });
        self.begun = 0;
    }

    /// A ray begins.
    #[inline(always)]
    pub fn ray(&mut self, kind: RayKind) {
        self.begun = self.begun.saturating_add(u32::from(kind == RayKind::Primary));
    }

    /// Column and row of the pixel in the image; `None` before the tile's first pixel and after its last.
    #[inline(always)]
    pub fn place(&self) -> Option<(u32, u32)> {
        let pixel = self.begun.checked_sub(1)?;
        let (column, row) = (pixel.checked_rem(self.rect.width)?, pixel.checked_div(self.rect.width)?);
        (row < self.rect.height).then(|| (self.rect.x + column, self.rect.y + row))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::picture::Sides;

    #[test]
    fn primary_rays_go_row_by_row_and_no_further_than_the_tile() {
        let mut pixels =
            Pixels::new(Tiling::new(Sides { width: 5, height: 4, tile_width: 3, tile_height: 2 }).expect("possible"));
        // The upper right tile is two pixels wide.
        pixels.tile(TileId(1));
        assert_eq!(pixels.place(), None);
        let mut places = Vec::new();
        for _ in 0..5 {
            pixels.ray(RayKind::Primary);
            let place = pixels.place();
            pixels.ray(RayKind::Shadow);
            assert_eq!(pixels.place(), place);
            places.push(place);
        }
        assert_eq!(places, [Some((3, 0)), Some((4, 0)), Some((3, 1)), Some((4, 1)), None]);
        pixels.tile(TileId(4));
        pixels.ray(RayKind::Primary);
        assert_eq!(pixels.place(), None, "there are four tiles");
    }
}
