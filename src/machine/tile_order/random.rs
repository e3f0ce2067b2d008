//! Shuffled with the run's seed (Fisher and Yates 1938).

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use ground::ids::TileId;
use trace::picture::Tiling;

pub(super) fn tiles(tiling: Tiling, seed: u64) -> Vec<TileId> {
    let mut tiles: Vec<_> = (0..tiling.tile_count()).map(TileId).collect();
    let mut random = Pcg64::seed_from_u64(seed);
    for last in (1..tiles.len()).rev() {
        // The high half of the product: below last + 1, biased by less than 2⁻³².
        let other = (u128::from(random.next_u64()) * (last as u128 + 1)) >> 64;
        tiles.swap(last, other as usize);
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::picture::Sides;

    #[test]
    fn the_seed_decides() {
        let tiling = Tiling::new(Sides { width: 40, height: 25, tile_width: 1, tile_height: 1 }).expect("possible");
        assert_eq!(tiles(tiling, 1), tiles(tiling, 1));
        assert_ne!(tiles(tiling, 1), tiles(tiling, 2));
        let in_place = tiles(tiling, 3).iter().enumerate().filter(|(i, tile)| *i == tile.0 as usize).count();
        assert!(in_place < 10, "{in_place} of 1000 stayed, 1 is expected");
    }
}
