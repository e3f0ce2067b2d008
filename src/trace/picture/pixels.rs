//! What is known of the pixels of a rectangle: colours, and what else was asked for.

use serde::{Deserialize, Serialize};

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

    /// So many pixels as they are where nothing is hit.
    pub fn of_background(pixels: usize, background: [f32; 3], aov: AovSet) -> Self {
        let planes = |wanted: bool| if wanted { pixels } else { 0 };
        Self {
            colour: vec![background; pixels],
            depth: vec![-1.0; planes(aov.depth)],
            normal: vec![[0.0; 3]; planes(aov.normal)],
            primitive: vec![-1; planes(aov.primitive)],
        }
    }

    /// Makes pixels black whose colours are not finite; how many.
    pub fn blacken_non_finite(&mut self) -> u64 {
        let mut count = 0;
        for colour in &mut self.colour {
            let [r, g, b] = *colour;
            if !(r.is_finite() & g.is_finite() & b.is_finite()) {
                *colour = [0.0; 3];
                count += 1;
            }
        }
        count
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
