//! Traces a tile, the unit of work.

use glam::DVec3;

use super::hit::SurfacePoint;
use super::memory_port::MemoryPort;
use super::primary::PrimaryRays;
use super::shade::Shader;
use super::stats::TraceStats;
use super::view::View;
use crate::database::Header;
use crate::database::records::PrimitiveId;
use crate::picture::{AovSet, Pixels, Rect};

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
        let mut pixels = Pixels::of_background(rect.pixel_count(), [0.0; 3], aov);
        let mut stats = TraceStats::default();
        let places = (rect.y..rect.y + rect.height).flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)));
        for (at, (x, y)) in places.enumerate() {
            let direction = self.camera.direction(x, y);
            let seen = self.shader.primary(port, self.camera.eye, direction, &mut stats)?;
            pixels.colour[at] = seen.radiance.to_array();
            if let Some((primitive, point)) = seen.first {
                first_hit(&mut pixels, at, &self.camera, direction, primitive, &point);
            }
        }
        stats.non_finite_pixels = pixels.blacken_non_finite();
        Ok((pixels, stats))
    }
}

/// Fills the planes that there are besides the colour, from what a pixel's ray hits first.
#[inline(always)]
pub(super) fn first_hit(
    pixels: &mut Pixels,
    at: usize,
    camera: &PrimaryRays,
    direction: DVec3,
    primitive: PrimitiveId,
    point: &SurfacePoint,
) {
    if let Some(depth) = pixels.depth.get_mut(at) {
        *depth = camera.depth(point, direction);
    }
    if let Some(normal) = pixels.normal.get_mut(at) {
        *normal = point.normal_to_eye(direction);
    }
    if let Some(id) = pixels.primitive.get_mut(at) {
        *id = primitive.0 as i32;
    }
}
