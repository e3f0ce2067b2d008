//! Row by row from the top.

use ground::ids::TileId;
use trace::picture::Tiling;

pub(super) fn tiles(tiling: Tiling) -> Vec<TileId> {
    (0..tiling.tile_count()).map(TileId).collect()
}
