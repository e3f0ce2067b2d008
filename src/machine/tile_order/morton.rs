//! Along a Z-shaped curve (G. M. Morton 1966), so that tiles handed out together lie together and nodes share
//! what they read.

use ground::ids::TileId;
use trace::picture::Tiling;

pub(super) fn tiles(tiling: Tiling) -> Vec<TileId> {
    let mut tiles: Vec<_> = (0..tiling.tile_count()).map(TileId).collect();
    tiles.sort_unstable_by_key(|&tile| {
        let (column, row) = tiling.place(tile);
        spread(column) | spread(row) << 1
    });
    tiles
}

/// Bit i of the value to bit 2i.
fn spread(value: u32) -> u64 {
    let mut bits = u64::from(value);
    for (shift, mask) in [
        (16, 0x0000_ffff_0000_ffff),
        (8, 0x00ff_00ff_00ff_00ff),
        (4, 0x0f0f_0f0f_0f0f_0f0f),
        (2, 0x3333_3333_3333_3333),
        (1, 0x5555_5555_5555_5555),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::picture::Sides;

    #[test]
    fn the_curve_is_z_shaped() {
        let tiling = Tiling::new(Sides { width: 4, height: 3, tile_width: 1, tile_height: 1 }).expect("possible");
        // 0 1 | 4 5
        // 2 3 | 6 7
        // 8 9 | 10 11
        let order: Vec<_> = tiles(tiling).into_iter().map(|tile| tile.0).collect();
        assert_eq!(order, [0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 10, 11]);
    }

    #[test]
    fn bits_are_spread() {
        for value in [0, 1, 2, 0b1011, 0xffff, 0x8000_0001, u32::MAX] {
            let slow = (0..32).map(|i| u64::from(value >> i & 1) << (2 * i)).sum::<u64>();
            assert_eq!(spread(value), slow, "{value:#x}");
        }
    }
}
