//! An image cut into tiles, the units of work.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::settings::ImageSettings;
use ground::ids::TileId;

/// Pixels of the image, row 0 on top.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Rect {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

impl Rect {
    pub fn pixel_count(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// The sides of an image and of its tiles, pixels, as written: what a [`Tiling`] is made of.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Sides {
    pub width: u32,
    pub height: u32,
    pub tile_width: u32,
    pub tile_height: u32,
}

/// Sides of which no tiling can be made.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum TilingError {
    #[error("{sides}, expected sides from 1 to {max}", max = ImageSettings::SIDE_MAX)]
    Side { sides: Sides },
    #[error("{sides} are {tiles} tiles, expected at most {max}", max = Tiling::TILES_MAX)]
    TooManyTiles { sides: Sides, tiles: u64 },
}

impl fmt::Display for Sides {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, tile_width, tile_height } = self;
        write!(f, "tiles of {tile_width}x{tile_height} pixels in an image of {width}x{height}")
    }
}

impl Sides {
    /// Tiles of sides that are not 0.
    const fn tile_count(&self) -> u64 {
        self.width.div_ceil(self.tile_width) as u64 * self.height.div_ceil(self.tile_height) as u64
    }

    const fn check(self) -> Result<(), TilingError> {
        let sides = [self.width, self.height, self.tile_width, self.tile_height];
        let mut i = 0;
        while i < sides.len() {
            if sides[i] == 0 || sides[i] > ImageSettings::SIDE_MAX {
                return Err(TilingError::Side { sides: self });
            }
            i += 1;
        }
        let tiles = self.tile_count();
        if tiles > Tiling::TILES_MAX {
            return Err(TilingError::TooManyTiles { sides: self, tiles });
        }
        Ok(())
    }
}

/// An image cut into tiles, row-major; those on the right and lower edge may be smaller. Proven, from wherever it comes:
/// each side is 1 to 65,536 pixels, and there are at most [`Self::TILES_MAX`] tiles.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(try_from = "Sides", into = "Sides")]
pub struct Tiling(Sides);

impl TryFrom<Sides> for Tiling {
    type Error = TilingError;

    fn try_from(sides: Sides) -> Result<Self, TilingError> {
        sides.check().map(|()| Self(sides))
    }
}

impl From<Tiling> for Sides {
    fn from(tiling: Tiling) -> Self {
        tiling.0
    }
}

impl Tiling {
    /// More tiles than this are more bookkeeping than image.
    pub const TILES_MAX: u64 = 1 << 24;

    /// As [`TryFrom`], for constants.
    pub const fn new(sides: Sides) -> Option<Self> {
        if sides.check().is_ok() { Some(Self(sides)) } else { None }
    }

    /// Of the image and its tiles.
    pub const fn sides(self) -> Sides {
        self.0
    }

    fn columns(self) -> u32 {
        self.0.width.div_ceil(self.0.tile_width)
    }

    /// 1 to [`Self::TILES_MAX`].
    pub fn tile_count(self) -> u32 {
        self.0.tile_count() as u32
    }

    /// Column and row of a tile.
    pub fn place(self, tile: TileId) -> (u32, u32) {
        (tile.0 % self.columns(), tile.0 / self.columns())
    }

    /// The pixels of a tile; `None` when there is no such tile.
    pub fn rect(self, tile: TileId) -> Option<Rect> {
        if tile.0 >= self.tile_count() {
            return None;
        }
        let (column, row) = self.place(tile);
        let Sides { width, height, tile_width, tile_height } = self.0;
        let (x, y) = (column * tile_width, row * tile_height);
        Some(Rect { x, y, width: tile_width.min(width - x), height: tile_height.min(height - y) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sides(width: u32, height: u32, tile_width: u32, tile_height: u32) -> Sides {
        Sides { width, height, tile_width, tile_height }
    }

    #[test]
    fn what_cannot_be_a_tiling_is_refused_from_files_and_from_the_wire() {
        for (wrong, expected) in [
            (sides(0, 1, 1, 1), "tiles of 1x1 pixels in an image of 0x1, expected sides from 1 to 65536"),
            (sides(8, 8, 0, 8), "tiles of 0x8 pixels in an image of 8x8, expected sides from 1 to 65536"),
            (sides(8, 65_537, 8, 8), "tiles of 8x8 pixels in an image of 8x65537, expected sides from 1 to 65536"),
            (
                sides(65_536, 257, 1, 1),
                "tiles of 1x1 pixels in an image of 65536x257 are 16842752 tiles, expected at most 16777216",
            ),
        ] {
            assert_eq!(Tiling::try_from(wrong).expect_err(expected).to_string(), expected);
            assert_eq!(Tiling::new(wrong), None);
            let json = serde_json::to_string(&wrong).expect("numbers");
            let error = serde_json::from_str::<Tiling>(&json).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn a_tiling_is_written_as_its_sides_and_reads_back() {
        let tiling = Tiling::new(sides(65_536, 256, 1, 1)).expect("the most tiles");
        assert_eq!(u64::from(tiling.tile_count()), Tiling::TILES_MAX);
        let json = serde_json::to_string(&tiling).expect("numbers");
        assert_eq!(json, serde_json::to_string(&tiling.sides()).expect("numbers"));
        assert_eq!(serde_json::from_str::<Tiling>(&json).expect("its own"), tiling);
    }

    #[test]
    fn every_pixel_is_in_one_tile() {
        let tiling = Tiling::new(sides(10, 7, 4, 3)).expect("possible");
        let mut times = [0; 70];
        for rect in (0..tiling.tile_count()).map(|tile| tiling.rect(TileId(tile)).expect("there")) {
            for (x, y) in
                (rect.y..rect.y + rect.height).flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)))
            {
                times[(y * 10 + x) as usize] += 1;
            }
        }
        assert_eq!(times, [1; 70]);
        assert_eq!(tiling.rect(TileId(9)), None);
    }
}
