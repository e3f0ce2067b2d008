//! The whole database in this process's own memory: reads are plain loads, nothing is counted.

use std::convert::Infallible;

use super::memory_port::{MemoryPort, RayKind};
use crate::database::Section;
use crate::database::primitives::Primitives;
use crate::database::records::{Cone, LeafEntry, Material, Normals, OctreeWord, Polygon, Sphere, Surface, Triangle};
use crate::database::verify::Verified;

/// A view of a verified database; indices that come from its own records are in range.
#[derive(Clone, Copy, Debug)]
pub struct Slices<'a> {
    octree: &'a [OctreeWord],
    leaf_lists: &'a [LeafEntry],
    pub(super) primitives: Primitives<'a>,
    pub(super) surfaces: &'a [Surface],
    pub(super) normals: &'a [Normals],
    pub(super) materials: &'a [Material],
    polygons: &'a [Polygon],
}

impl<'a> Slices<'a> {
    pub fn new(verified: &'a Verified) -> Self {
        let database = verified.unpadded();
        Self {
            octree: database.records(Section::OctreeNodes),
            leaf_lists: database.records(Section::LeafLists),
            primitives: Primitives::of(verified),
            surfaces: database.records(Section::Surfaces),
            normals: database.records(Section::Normals),
            materials: database.records(Section::Materials),
            polygons: database.records(Section::Polygons),
        }
    }
}

macro_rules! plain_read {
    ($($read:ident: $($section:ident).+ -> $record:ty),* $(,)?) => {$(
        #[inline(always)]
        fn $read(&mut self, index: u32) -> Result<$record, Infallible> {
            Ok(self.$($section).+[index as usize])
        }
    )*};
}

impl MemoryPort for Slices<'_> {
    type Error = Infallible;

    #[inline(always)]
    fn set_ray_kind(&mut self, _kind: RayKind) {}

    #[inline(always)]
    fn octree_node(&mut self, index: u32, _level: u32) -> Result<OctreeWord, Infallible> {
        Ok(self.octree[index as usize])
    }

    plain_read! {
        leaf_entry: leaf_lists -> LeafEntry,
        triangle: primitives.triangles -> Triangle,
        sphere: primitives.spheres -> Sphere,
        cone: primitives.cones -> Cone,
        surface: surfaces -> Surface,
        normals: normals -> Normals,
        material: materials -> Material,
        polygon: polygons -> Polygon,
    }

    fn corrupt(&mut self, what: &'static str) -> Infallible {
        unreachable!("a verified database is sound, but: {what}")
    }
}
