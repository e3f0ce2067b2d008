//! The hinge of the program: the only way that traversal and shading read the database.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::database::records::{Cone, LeafEntry, Material, Normals, OctreeWord, Polygon, Sphere, Surface, Triangle};

/// What a ray is cast for. Memory traffic is counted by it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum RayKind {
    Primary,
    Shadow,
    Reflection,
    Refraction,
}

impl RayKind {
    pub const COUNT: usize = 4;
    pub const ALL: [Self; Self::COUNT] = [Self::Primary, Self::Shadow, Self::Reflection, Self::Refraction];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Shadow => "shadow",
            Self::Reflection => "reflection",
            Self::Refraction => "refraction",
        }
    }
}

/// Typed reads of the database's records, by value, indexed from the start of their section.
///
/// Plain slices implement it (nothing is counted), a local memory does (hits, misses, fetches), tests do.
/// An error ends the tile, not the process; slices of a verified database have none.
pub trait MemoryPort {
    type Error;

    /// The reads from here on are made for a ray of this kind.
    fn set_ray_kind(&mut self, kind: RayKind);

    /// Word `index` of the octree nodes; `level` is for counting, the root's is 0.
    fn octree_node(&mut self, index: u32, level: u32) -> Result<OctreeWord, Self::Error>;
    fn leaf_entry(&mut self, index: u32) -> Result<LeafEntry, Self::Error>;
    fn triangle(&mut self, index: u32) -> Result<Triangle, Self::Error>;
    fn sphere(&mut self, index: u32) -> Result<Sphere, Self::Error>;
    fn cone(&mut self, index: u32) -> Result<Cone, Self::Error>;
    /// Indexed by primitive id.
    fn surface(&mut self, index: u32) -> Result<Surface, Self::Error>;
    fn normals(&mut self, index: u32) -> Result<Normals, Self::Error>;
    fn material(&mut self, index: u32) -> Result<Material, Self::Error>;
    /// Where polygons are objects.
    fn polygon(&mut self, index: u32) -> Result<Polygon, Self::Error>;

    /// The error for a record that cannot be right, such as a tree deeper than the header says.
    fn corrupt(&mut self, what: &'static str) -> Self::Error;
}

/// Gives a macro every read that is of a record by its index alone: its name, section and record.
#[macro_export]
macro_rules! plain_reads {
    ($each:ident) => {
        $each! {
            leaf_entry: LeafLists -> $crate::database::records::LeafEntry,
            triangle: Triangles -> $crate::database::records::Triangle,
            sphere: Spheres -> $crate::database::records::Sphere,
            cone: Cones -> $crate::database::records::Cone,
            surface: Surfaces -> $crate::database::records::Surface,
            normals: Normals -> $crate::database::records::Normals,
            material: Materials -> $crate::database::records::Material,
            polygon: Polygons -> $crate::database::records::Polygon,
        }
    };
}
pub use plain_reads;
