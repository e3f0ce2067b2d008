//! The pixels of a whole image.

use bytemuck::Pod;
use sha2::{Digest, Sha256};

use crate::picture::{AovSet, ImageSettings, Pixels, Rect};

/// The planes of a whole image, row-major, row 0 on top. What was not traced yet is black and nowhere hit.
#[derive(Clone, Debug)]
pub struct FrameBuffer {
    width: u32,
    height: u32,
    aov: AovSet,
    pixels: Pixels,
}

#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FrameBufferError {
    #[error("an image of {width}x{height} pixels, expected 1 to {} a side", ImageSettings::SIDE_MAX)]
    Size { width: u32, height: u32 },
    #[error("no memory for an image of {width}x{height} pixels")]
    Memory { width: u32, height: u32 },
    #[error("the pixels do not fill {rect:?} of an image of {width}x{height} pixels")]
    Rect { rect: Rect, width: u32, height: u32 },
}

impl FrameBuffer {
    /// # Errors
    /// A side is 0 or above [`ImageSettings::SIDE_MAX`], or there is not enough memory.
    pub fn new(width: u32, height: u32, aov: AovSet) -> Result<Self, FrameBufferError> {
        let sides = 1..=ImageSettings::SIDE_MAX;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(FrameBufferError::Size { width, height });
        }
        let count = width as usize * height as usize;
        // `vec!` takes zeroed pages that cost nothing until they are written, but ends the process where there
        // are none: asked for once without that risk.
        if Vec::<u8>::new().try_reserve_exact(Pixels::byte_len(count, aov)).is_err() {
            return Err(FrameBufferError::Memory { width, height });
        }
        let plane = |wanted: bool| if wanted { count } else { 0 };
        let pixels = Pixels {
            colour: vec![[0.0; 3]; count],
            depth: vec![-1.0; plane(aov.depth)],
            normal: vec![[0.0; 3]; plane(aov.normal)],
            primitive: vec![-1; plane(aov.primitive)],
        };
        Ok(Self { width, height, aov, pixels })
    }

    /// Pixels of a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    pub fn aov(&self) -> AovSet {
        self.aov
    }

    pub fn pixels(&self) -> &Pixels {
        &self.pixels
    }

    /// Puts the pixels of a rectangle into their place.
    ///
    /// # Errors
    /// The rectangle is not inside the image, or the planes are not its size; nothing is changed then.
    pub fn blit(&mut self, rect: Rect, pixels: &Pixels) -> Result<(), FrameBufferError> {
        let count = rect.pixel_count();
        let plane = |wanted: bool| if wanted { count } else { 0 };
        let fits = pixels.colour.len() == count
            && pixels.depth.len() == plane(self.aov.depth)
            && pixels.normal.len() == plane(self.aov.normal)
            && pixels.primitive.len() == plane(self.aov.primitive);
        if !fits || !self.contains(rect) {
            return Err(self.misfit(rect));
        }
        copy_rows(&mut self.pixels.colour, self.width, rect, bytemuck::cast_slice(&pixels.colour));
        copy_rows(&mut self.pixels.depth, self.width, rect, bytemuck::cast_slice(&pixels.depth));
        copy_rows(&mut self.pixels.normal, self.width, rect, bytemuck::cast_slice(&pixels.normal));
        copy_rows(&mut self.pixels.primitive, self.width, rect, bytemuck::cast_slice(&pixels.primitive));
        Ok(())
    }

    /// [`Self::blit`] of what [`Pixels::write_bytes`] wrote, without an intermediate copy.
    ///
    /// # Errors
    /// As those of [`Self::blit`].
    pub fn blit_bytes(&mut self, rect: Rect, bytes: &[u8]) -> Result<(), FrameBufferError> {
        let count = rect.pixel_count();
        if bytes.len() != Pixels::byte_len(count, self.aov) || !self.contains(rect) {
            return Err(self.misfit(rect));
        }
        let plane = |wanted: bool, bytes_per_pixel: usize| if wanted { count * bytes_per_pixel } else { 0 };
        let (colour, rest) = bytes.split_at(plane(true, 12));
        let (depth, rest) = rest.split_at(plane(self.aov.depth, 4));
        let (normal, primitive) = rest.split_at(plane(self.aov.normal, 12));
        copy_rows(&mut self.pixels.colour, self.width, rect, colour);
        copy_rows(&mut self.pixels.depth, self.width, rect, depth);
        copy_rows(&mut self.pixels.normal, self.width, rect, normal);
        copy_rows(&mut self.pixels.primitive, self.width, rect, primitive);
        Ok(())
    }

    /// As if the rectangle had not been traced; what of it is outside of the image does not matter.
    pub fn clear(&mut self, rect: Rect) {
        clear_rows(&mut self.pixels.colour, self.width, rect, [0.0; 3]);
        clear_rows(&mut self.pixels.depth, self.width, rect, -1.0);
        clear_rows(&mut self.pixels.normal, self.width, rect, [0.0; 3]);
        clear_rows(&mut self.pixels.primitive, self.width, rect, -1);
    }

    /// The bytes of a rectangle inside of the image as [`Pixels::write_bytes`] would lay them out, row by row.
    pub fn rows(&self, rect: Rect) -> impl Iterator<Item = &[u8]> {
        let Pixels { colour, depth, normal, primitive } = &self.pixels;
        let colour = rows(colour, self.width, rect);
        let depth = rows(depth, self.width, rect);
        let normal = rows(normal, self.width, rect);
        let primitive = rows(primitive, self.width, rect);
        colour.chain(depth).chain(normal).chain(primitive)
    }

    /// SHA-256 of the linear f32 RGB, row-major, little-endian; hexadecimal.
    pub fn sha256(&self) -> String {
        let digest = Sha256::digest(bytemuck::cast_slice::<_, u8>(&self.pixels.colour));
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn contains(&self, rect: Rect) -> bool {
        let inside = |start: u32, length: u32, side: u32| start.checked_add(length).is_some_and(|end| end <= side);
        inside(rect.x, rect.width, self.width) && inside(rect.y, rect.height, self.height)
    }

    fn misfit(&self, rect: Rect) -> FrameBufferError {
        FrameBufferError::Rect { rect, width: self.width, height: self.height }
    }
}

/// Copies a plane's rectangle; an empty plane (one that was not asked for) is left alone.
fn copy_rows<T: Pod>(plane: &mut [T], width: u32, rect: Rect, bytes: &[u8]) {
    let (row_bytes, width) = (rect.width as usize * size_of::<T>(), width as usize);
    if plane.is_empty() || row_bytes == 0 {
        return;
    }
    let rows = plane.chunks_exact_mut(width).skip(rect.y as usize);
    for (row, source) in rows.zip(bytes.chunks_exact(row_bytes)) {
        let (start, end) = (rect.x as usize, (rect.x + rect.width) as usize);
        bytemuck::cast_slice_mut::<_, u8>(&mut row[start..end]).copy_from_slice(source);
    }
}

fn clear_rows<T: Copy>(plane: &mut [T], width: u32, rect: Rect, with: T) {
    for row in plane.chunks_exact_mut(width as usize).skip(rect.y as usize).take(rect.height as usize) {
        row.iter_mut().skip(rect.x as usize).take(rect.width as usize).for_each(|pixel| *pixel = with);
    }
}

fn rows<T: Pod>(plane: &[T], width: u32, rect: Rect) -> impl Iterator<Item = &[u8]> {
    let rows = plane.chunks_exact(width as usize).skip(rect.y as usize).take(rect.height as usize);
    rows.map(move |row| bytemuck::cast_slice(&row[rect.x as usize..][..rect.width as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: AovSet = AovSet { depth: true, normal: true, primitive: true };

    fn numbered(rect: Rect) -> Pixels {
        let ids = |k: i32| (0..rect.pixel_count() as i32).map(move |i| 1000 * k + i);
        Pixels {
            colour: ids(1).map(|i| [i as f32; 3]).collect(),
            depth: ids(2).map(|i| i as f32).collect(),
            normal: ids(3).map(|i| [i as f32, 0.5, -1.0]).collect(),
            primitive: ids(4).collect(),
        }
    }

    #[test]
    fn a_rectangle_lands_in_its_place_and_nowhere_else() {
        let rect = Rect { x: 2, y: 1, width: 3, height: 2 };
        let pixels = numbered(rect);
        let mut frame = FrameBuffer::new(6, 4, ALL).expect("a small frame");
        frame.blit(rect, &pixels).expect("fits");
        for y in 0..4 {
            for x in 0..6 {
                let inside = (2..5).contains(&x) && (1..3).contains(&y);
                let (at, from) = (y * 6 + x, if inside { (y - 1) * 3 + x - 2 } else { 0 });
                let (colour, primitive) =
                    if inside { (pixels.colour[from], pixels.primitive[from]) } else { ([0.0; 3], -1) };
                assert_eq!(frame.pixels().colour[at], colour, "({x}, {y})");
                assert_eq!(frame.pixels().primitive[at], primitive, "({x}, {y})");
            }
        }
    }

    #[test]
    fn bytes_and_planes_give_the_same_frame() {
        let rect = Rect { x: 1, y: 0, width: 4, height: 3 };
        for aov in [ALL, AovSet::default(), AovSet { normal: true, ..AovSet::default() }] {
            let all = numbered(rect);
            let pixels = Pixels {
                colour: all.colour,
                depth: if aov.depth { all.depth } else { vec![] },
                normal: if aov.normal { all.normal } else { vec![] },
                primitive: if aov.primitive { all.primitive } else { vec![] },
            };
            let mut bytes = Vec::new();
            pixels.write_bytes(&mut bytes);
            let mut by_planes = FrameBuffer::new(5, 3, aov).expect("a small frame");
            let mut by_bytes = by_planes.clone();
            by_planes.blit(rect, &pixels).expect("fits");
            by_bytes.blit_bytes(rect, &bytes).expect("fits");
            assert_eq!(by_planes.pixels(), by_bytes.pixels());
            assert!(by_bytes.blit_bytes(rect, &bytes[1..]).is_err());
        }
    }

    #[test]
    fn a_rectangle_is_read_as_it_was_written_and_cleared_without_a_trace() {
        for aov in [ALL, AovSet::default()] {
            let mut frame = FrameBuffer::new(6, 4, aov).expect("a small frame");
            let empty = frame.pixels().clone();
            let rect = Rect { x: 2, y: 1, width: 3, height: 2 };
            let bytes: Vec<u8> = (0..Pixels::byte_len(6, aov)).map(|i| i as u8).collect();
            frame.blit_bytes(rect, &bytes).expect("fits");
            assert_eq!(frame.rows(rect).collect::<Vec<_>>().concat(), bytes);
            assert_ne!(frame.pixels(), &empty);
            frame.clear(rect);
            assert_eq!(frame.pixels(), &empty);
        }
    }

    #[test]
    fn a_rectangle_outside_is_refused() {
        let mut frame = FrameBuffer::new(6, 4, ALL).expect("a small frame");
        for rect in [
            Rect { x: 4, y: 0, width: 3, height: 1 },
            Rect { x: 0, y: 4, width: 1, height: 1 },
            Rect { x: u32::MAX, y: 0, width: 1, height: 1 },
        ] {
            assert!(frame.blit(rect, &numbered(rect)).is_err(), "{rect:?}");
        }
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for (width, height) in [(0, 1), (1, 0), (65_537, 1), (1, u32::MAX)] {
            assert_eq!(FrameBuffer::new(width, height, ALL).err(), Some(FrameBufferError::Size { width, height }));
        }
    }

    #[test]
    fn the_hash_is_of_the_little_endian_floats() {
        // printf '\0\0\200\077\0\0\0\100\0\0\0\077' | sha256sum
        let mut frame = FrameBuffer::new(1, 1, AovSet::default()).expect("a small frame");
        let pixels = Pixels { colour: vec![[1.0, 2.0, 0.5]], ..Pixels::default() };
        frame.blit(Rect { x: 0, y: 0, width: 1, height: 1 }, &pixels).expect("fits");
        assert_eq!(frame.sha256(), "fdd6aa4a2057d96e55c4c39c3048c44a5b8d508931201bcb4fc8b66771ae09f1");
    }
}
