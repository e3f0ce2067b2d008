//! The kinds of records that an image has.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::records::{Cone, LeafEntry, Material, Normals, OctreeWord, Polygon, Sphere, Surface, Triangle};

/// One kind of record each, in this order in the image.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Section {
    OctreeNodes,
    LeafLists,
    Triangles,
    Spheres,
    Cones,
    Surfaces,
    Normals,
    Materials,
    /// Where polygons are objects, whose triangles are in their section as ever; else there are none.
    Polygons,
}

impl Section {
    pub const COUNT: usize = 9;
    pub const ALL: [Self; Self::COUNT] = [
        Self::OctreeNodes,
        Self::LeafLists,
        Self::Triangles,
        Self::Spheres,
        Self::Cones,
        Self::Surfaces,
        Self::Normals,
        Self::Materials,
        Self::Polygons,
    ];

    /// Bytes of what one record holds. How far records are apart, the [`Layout`](super::Layout) knows.
    pub const fn content_bytes(self) -> u64 {
        (match self {
            Self::OctreeNodes => size_of::<OctreeWord>(),
            Self::LeafLists => size_of::<LeafEntry>(),
            Self::Triangles => size_of::<Triangle>(),
            Self::Spheres => size_of::<Sphere>(),
            Self::Cones => size_of::<Cone>(),
            Self::Surfaces => size_of::<Surface>(),
            Self::Normals => size_of::<Normals>(),
            Self::Materials => size_of::<Material>(),
            Self::Polygons => size_of::<Polygon>(),
        }) as u64
    }

    /// The name used in reports and recordings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OctreeNodes => "octree_nodes",
            Self::LeafLists => "leaf_lists",
            Self::Triangles => "triangles",
            Self::Spheres => "spheres",
            Self::Cones => "cones",
            Self::Surfaces => "surfaces",
            Self::Normals => "normals",
            Self::Materials => "materials",
            Self::Polygons => "polygons",
        }
    }
}
