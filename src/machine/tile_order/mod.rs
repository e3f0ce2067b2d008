//! In which order tiles are handed out, and to which nodes. One file per order; none changes the image.

mod morton;
mod random;
mod scanline;

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use ground::ids::TileId;
use trace::picture::Tiling;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TileOrder {
    /// Row by row from the top.
    Scanline,
    /// Along a Z-shaped curve, so that tiles handed out together lie together.
    Morton,
    /// Shuffled with the run's seed.
    Random,
}

/// Its name in a topology file.
impl fmt::Display for TileOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Assignment {
    /// A node that asks gets the next tile: balanced, not reproducible.
    OnDemand,
    /// The i-th tile in order goes to node i mod nodes: counts are reproducible.
    Interleaved,
}

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
    use trace::picture::Sides;

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
