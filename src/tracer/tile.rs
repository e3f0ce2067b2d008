//! Traces a tile, the unit of work.

use super::memory_port::MemoryPort;
use super::primary::PrimaryRays;
use super::shade::Shader;
use super::stats::TraceStats;
use super::view::View;
use crate::database::Header;
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
