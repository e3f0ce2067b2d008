//! A tile: the unit of work. Its pixels, and what it takes to trace them.

use serde::{Deserialize, Serialize};

use crate::ids::TileId;

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

/// An image cut into tiles, row-major; those on the right and lower edge may be smaller.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Tiling {
    pub width: u32,
    pub height: u32,
    pub tile_width: u32,
    pub tile_height: u32,
}

impl Tiling {
    fn columns(self) -> u32 {
        self.width.div_ceil(self.tile_width)
    }

    pub fn tile_count(self) -> u32 {
        self.columns() * self.height.div_ceil(self.tile_height)
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
        let (x, y) = (column * self.tile_width, row * self.tile_height);
        Some(Rect { x, y, width: self.tile_width.min(self.width - x), height: self.tile_height.min(self.height - y) })
    }
}

/// Which arbitrary output variables of the first hit are wanted besides the colour.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct AovSet {
    /// Distance along the unit direction in world units, −1 where nothing is hit.
    pub depth: bool,
    /// Unit geometric normal turned to the eye, 0 where nothing is hit.
    pub normal: bool,
    /// Primitive id, −1 where nothing is hit.
    pub primitive: bool,
}

impl AovSet {
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }
}

/// The traced pixels of a rectangle, row-major. Planes that were not asked for are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pixels {
    /// Linear RGB.
    pub colour: Vec<[f32; 3]>,
    pub depth: Vec<f32>,
    pub normal: Vec<[f32; 3]>,
    pub primitive: Vec<i32>,
}

impl Pixels {
    /// Bytes of `pixels` pixels as [`Self::write_bytes`] lays them out.
    pub fn byte_len(pixels: usize, aov: AovSet) -> usize {
        let per_pixel = 12 + 4 * usize::from(aov.depth) + 12 * usize::from(aov.normal) + 4 * usize::from(aov.primitive);
        pixels * per_pixel
    }

    /// Appends the planes one after the other, little-endian: colour, depth, normal, primitive.
    pub fn write_bytes(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(bytemuck::cast_slice(&self.colour));
        out.extend_from_slice(bytemuck::cast_slice(&self.depth));
        out.extend_from_slice(bytemuck::cast_slice(&self.normal));
        out.extend_from_slice(bytemuck::cast_slice(&self.primitive));
    }

    /// The reverse of [`Self::write_bytes`]; `None` when the length is not that of `pixels` pixels.
    pub fn from_bytes(pixels: usize, aov: AovSet, bytes: &[u8]) -> Option<Self> {
        if bytes.len() != Self::byte_len(pixels, aov) {
            return None;
        }
        let mut rest = bytes;
        let mut take = |wanted: bool, bytes_per_pixel: usize| {
            let (plane, tail) = rest.split_at(if wanted { pixels * bytes_per_pixel } else { 0 });
            rest = tail;
            plane
        };
        Some(Self {
            colour: bytemuck::pod_collect_to_vec(take(true, 12)),
            depth: bytemuck::pod_collect_to_vec(take(aov.depth, 4)),
            normal: bytemuck::pod_collect_to_vec(take(aov.normal, 12)),
            primitive: bytemuck::pod_collect_to_vec(take(aov.primitive, 4)),
        })
    }
}

/// To come.
#[derive(Debug)]
pub struct TileTracer {}
