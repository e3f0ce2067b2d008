//! A tile: the unit of work. Its pixels, and what it takes to trace them.

use serde::{Deserialize, Serialize};

use super::memory_port::MemoryPort;
use super::primary::PrimaryRays;
use super::shade::Shader;
use super::stats::TraceStats;
use super::view::View;
use crate::database::Header;
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
        self.columns().saturating_mul(self.height.div_ceil(self.tile_height))
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

    /// No pixels yet, and memory for so many.
    pub fn with_room(pixels: usize, aov: AovSet) -> Self {
        let room = |wanted: bool| if wanted { pixels } else { 0 };
        Self {
            colour: Vec::with_capacity(pixels),
            depth: Vec::with_capacity(room(aov.depth)),
            normal: Vec::with_capacity(room(aov.normal)),
            primitive: Vec::with_capacity(room(aov.primitive)),
        }
    }

    /// Adds the pixels below these ones.
    pub fn append(&mut self, below: &Self) {
        self.colour.extend_from_slice(&below.colour);
        self.depth.extend_from_slice(&below.depth);
        self.normal.extend_from_slice(&below.normal);
        self.primitive.extend_from_slice(&below.primitive);
    }

    /// The planes' bytes, little-endian: colour, depth, normal, primitive.
    pub fn planes(&self) -> [&[u8]; 4] {
        [
            bytemuck::cast_slice(&self.colour),
            bytemuck::cast_slice(&self.depth),
            bytemuck::cast_slice(&self.normal),
            bytemuck::cast_slice(&self.primitive),
        ]
    }

    /// Appends the planes one after the other.
    pub fn write_bytes(&self, out: &mut Vec<u8>) {
        self.planes().iter().for_each(|plane| out.extend_from_slice(plane));
    }

    /// Whether the colours of `pixels` pixels, with which their bytes begin, are finite: a tracer writes no others.
    pub fn have_finite_colours(pixels: usize, bytes: &[u8]) -> bool {
        const EXPONENT: u32 = 0x7f80_0000;
        let (channels, _) = bytes.as_chunks::<4>();
        channels.iter().take(3 * pixels).all(|channel| u32::from_le_bytes(*channel) & EXPONENT != EXPONENT)
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

/// Traces tiles of one view, with any memory behind.
pub struct TileTracer {
    camera: PrimaryRays,
    shader: Shader,
}

impl TileTracer {
    /// `mailbox` changes how often a primitive is tested, never the image.
    pub fn new(header: &Header, view: &View, mailbox: bool) -> Self {
        Self { camera: PrimaryRays::new(header, view), shader: Shader::new(header, view, mailbox) }
    }

    /// Traces the pixels of `rect`, row by row.
    ///
    /// # Errors
    /// The port's: the tile is lost, the tracer is not.
    pub fn trace<M: MemoryPort>(
        &mut self,
        port: &mut M,
        rect: Rect,
        aov: AovSet,
    ) -> Result<(Pixels, TraceStats), M::Error> {
        let mut pixels = Pixels::default();
        pixels.colour.reserve_exact(rect.pixel_count());
        let mut stats = TraceStats::default();
        for y in rect.y..rect.y + rect.height {
            for x in rect.x..rect.x + rect.width {
                self.pixel(port, x, y, aov, &mut pixels, &mut stats)?;
            }
        }
        Ok((pixels, stats))
    }

    fn pixel<M: MemoryPort>(
        &mut self,
        port: &mut M,
        x: u32,
        y: u32,
        aov: AovSet,
        pixels: &mut Pixels,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let direction = self.camera.direction(x, y);
        let seen = self.shader.primary(port, self.camera.eye, direction, stats)?;
        let finite = seen.radiance.is_finite();
        stats.non_finite_pixels += u64::from(!finite);
        pixels.colour.push(if finite { seen.radiance.to_array() } else { [0.0; 3] });
        if aov.depth {
            pixels.depth.push(seen.first.map_or(-1.0, |(_, point)| self.camera.depth(&point, direction)));
        }
        if aov.normal {
            pixels.normal.push(seen.first.map_or([0.0; 3], |(_, point)| point.normal_to_eye(direction)));
        }
        if aov.primitive {
            pixels.primitive.push(seen.first.map_or(-1, |(primitive, _)| primitive.0 as i32));
        }
        Ok(())
    }
}
