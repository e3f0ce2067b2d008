//! The records that were read, one by one, with all that is known of them.

use super::{ExportError, decode};
use crate::hardware::references::{Event, RecordNumbers};
use crate::replay::model::detail::Classes;
use crate::replay::origin::pixels::Pixels;
use crate::replay::{Trace, TraceError};
use ground::ids::{Attempt, NodeId, TileId};
use trace::database::{Layout, Section};
use trace::picture::Tiling;
use trace::tracer::RayKind;

/// What was recorded beside the references, and says what they are.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    pub layout: &'a Layout,
    /// By block of eight octree words, the level of its nodes.
    pub levels: &'a [u8],
    pub tiling: Tiling,
}

/// A record that was read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Access {
    pub node: NodeId,
    pub tile: TileId,
    pub attempt: Attempt,
    /// Column and row of the pixel in the image.
    pub pixel: Option<(u32, u32)>,
    pub ray: Option<RayKind>,
    pub section: Section,
    /// Of an octree node.
    pub level: Option<u32>,
    /// The record's index in its section.
    pub index: u32,
    /// Of its first byte.
    pub address: u64,
    pub bytes: u64,
}

/// Calls `visit` with each record that was read for the tiles given, in order. Returns how many there are.
///
/// # Errors
/// Of the trace, or of `visit`.
pub fn visit(
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    surroundings: Surroundings,
    mut visit: impl FnMut(&Access) -> Result<(), ExportError>,
) -> Result<u64, ExportError> {
    let Surroundings { layout, levels, tiling } = surroundings;
    let (numbers, classes) = (RecordNumbers::new(layout), Classes::new(layout, levels));
    let mut pixels = Pixels::new(tiling);
    let (mut words, mut accesses) = (Vec::new(), 0);
    for traced in tiles.iter().map(|&tile| &trace.tiles()[tile as usize]) {
        pixels.tile(traced.tile);
        let mut ray = None;
        for part in traced.parts.clone() {
            trace.read(part, &mut words)?;
            for &word in &words {
                let record = match decode(word)? {
                    Event::Ray(kind) => {
                        pixels.ray(kind);
                        ray = Some(kind);
                        continue;
                    }
                    Event::Read(record) if record < numbers.count() => record,
                    Event::Read(record) => {
                        let what = format!("record {record}, expected one below {}", numbers.count());
                        return Err(TraceError(what).into());
                    }
                    other => return Err(TraceError(format!("{other:?}, expected a read or a ray")).into()),
                };
                let (section, index) = numbers.place(record);
                visit(&Access {
                    node: traced.node,
                    tile: traced.tile,
                    attempt: traced.attempt,
                    pixel: pixels.place(),
                    ray,
                    section,
                    level: (section == Section::OctreeNodes).then(|| classes.level(index)),
                    index,
                    address: layout.address(section, index).0,
                    bytes: layout.record_bytes(section),
                })?;
                accesses += 1;
            }
        }
    }
    Ok(accesses)
}
