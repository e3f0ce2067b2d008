//! In which order tiles are handed out. One file a policy; none changes the image.

mod morton;
mod random;
mod scanline;

use crate::ids::TileId;
use crate::picture::Tiling;
use crate::topology::TileOrder;

/// Every tile of the image once. `seed` decides the random order alone.
pub fn tiles(order: TileOrder, tiling: Tiling, seed: u64) -> Vec<TileId> {
    match order {
        TileOrder::Scanline => scanline::tiles(tiling),
        TileOrder::Morton => morton::tiles(tiling),
        TileOrder::Random => random::tiles(tiling, seed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Sides;

    #[test]
    fn every_order_is_a_permutation_whatever_the_size() {
        let odd = [(1, 1), (7, 3), (250, 1), (1, 250), (33, 65)];
        for (width, height) in odd {
            let tiling = Tiling::new(Sides { width, height, tile_width: 2, tile_height: 3 }).expect("possible");
            for order in [TileOrder::Scanline, TileOrder::Morton, TileOrder::Random] {
                let mut tiles = tiles(order, tiling, 7);
                tiles.sort_unstable();
                assert!(tiles.into_iter().eq((0..tiling.tile_count()).map(TileId)), "{order:?} {width}x{height}");
            }
        }
    }
}
