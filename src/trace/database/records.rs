//! Every record of the image: the one place where their sizes and bits are documented.
//!
//! All fields are 32-bit little-endian words; a record has no padding.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Deepest level an octree may have; the root's is 0.
pub const MAX_DEPTH: u32 = 20;
/// Levels that are counted apart.
pub const LEVELS: usize = MAX_DEPTH as usize + 1;

/// An octree node, 4 bytes: no coordinates, HERO derives the planes (paper, section 2.1).
///
/// Bits 31–30: 0 leaf, 1 branch; 2 and 3 are reserved for leaves not built yet. Bits 29–0: of a leaf, the
/// index of its first entry in the leaf lists plus one, or zero when it is empty; of a branch, the index
/// of the block of its eight children. Block `b` is the words `8b` to `8b + 7` of the section; the child in
/// octant `o` (bit 0 for x, 1 for y, 2 for z; set in the upper half) is word `8b + o`. The root is word 0;
/// words 1 to 7 of block 0 are not used.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub struct OctreeWord(pub u32);

/// What an [`OctreeWord`] says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum OctreeNode {
    EmptyLeaf,
    /// Index of the first entry in the leaf lists.
    Leaf(u32),
    /// Index of the block of the eight children.
    Branch(u32),
}

impl OctreeWord {
    pub const EMPTY: Self = Self(0);
    /// Largest index that fits.
    pub const INDEX_MAX: u32 = (1 << 30) - 2;
    const BRANCH: u32 = 1 << 30;

    pub fn leaf(first_entry: u32) -> Self {
        debug_assert!(first_entry <= Self::INDEX_MAX);
        Self(first_entry + 1)
    }

    pub fn branch(block: u32) -> Self {
        debug_assert!(block <= Self::INDEX_MAX);
        Self(Self::BRANCH | block)
    }

    /// `None` for the reserved kinds.
    #[inline(always)]
    pub fn decode(self) -> Option<OctreeNode> {
        match self.0 {
            0 => Some(OctreeNode::EmptyLeaf),
            w if w < Self::BRANCH => Some(OctreeNode::Leaf(w - 1)),
            w if w < 2 * Self::BRANCH => Some(OctreeNode::Branch(w & (Self::BRANCH - 1))),
            _ => None,
        }
    }
}

/// A primitive in a leaf, 4 bytes. Bit 31: the last of its leaf. Bits 30–0: the primitive's id.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub struct LeafEntry(pub u32);

impl LeafEntry {
    const LAST: u32 = 1 << 31;

    pub fn new(primitive: PrimitiveId, last: bool) -> Self {
        debug_assert!(primitive.0 < Self::LAST);
        Self(primitive.0 | if last { Self::LAST } else { 0 })
    }

    #[inline(always)]
    pub fn primitive(self) -> PrimitiveId {
        PrimitiveId(self.0 & !Self::LAST)
    }

    #[inline(always)]
    pub fn is_last(self) -> bool {
        self.0 & Self::LAST != 0
    }
}

/// Triangles in file order first, then spheres, then cones: the id alone tells the kind, so that a scene
/// without spheres never asks for one. Below 2³¹.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct PrimitiveId(pub u32);

/// A triangle, 40 bytes, normalised coordinates.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Triangle {
    /// By axis, then by vertex: a ray takes whole axes in the order that suits its direction.
    pub coordinates: [[f32; 3]; 3],
    /// Bits 31–3: the polygon this triangle is a part of. Bit i (0 to 2): the edge from vertex i to the next
    /// one is inside the polygon, not an edge of it.
    pub tag: u32,
}

impl Triangle {
    pub fn new(vertices: [[f32; 3]; 3], polygon: u32, interior_edges: u8) -> Self {
        let axis = |a: usize| [vertices[0][a], vertices[1][a], vertices[2][a]];
        Self { coordinates: [axis(0), axis(1), axis(2)], tag: polygon << 3 | u32::from(interior_edges) }
    }

    /// The vertices, exactly.
    pub fn vertices(&self) -> [DVec3; 3] {
        let [x, y, z] = &self.coordinates;
        let vertex = |v: usize| DVec3::new(f64::from(x[v]), f64::from(y[v]), f64::from(z[v]));
        [vertex(0), vertex(1), vertex(2)]
    }

    /// Polygon ids are below this.
    pub const POLYGONS_MAX: u32 = 1 << 29;

    #[inline(always)]
    pub fn polygon(&self) -> u32 {
        self.tag >> 3
    }
}

/// A sphere, 16 bytes, normalised coordinates. A negative radius: only the inside is visible.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Sphere {
    pub centre: [f32; 3],
    pub radius: f32,
}

/// An open cone or cylinder, 32 bytes, normalised coordinates. Negative radii: only the inside is visible.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Cone {
    pub base: [f32; 3],
    pub base_radius: f32,
    pub apex: [f32; 3],
    pub apex_radius: f32,
}

/// What a primitive's surface looks like, 8 bytes, indexed by primitive id.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Surface {
    pub material: u32,
    /// Index of a smooth triangle's vertex normals, or [`Surface::FLAT`].
    pub normals: u32,
}

impl Surface {
    pub const FLAT: u32 = u32::MAX;
}

/// The unit vertex normals of a smooth triangle, 36 bytes.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Normals(pub [[f32; 3]; 3]);

impl Normals {
    /// Exactly, by vertex.
    pub fn widened(&self) -> [[f64; 3]; 3] {
        self.0.map(|normal| normal.map(f64::from))
    }
}

/// A material, 48 bytes; the terms are those of [`crate::scene::Material`].
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    pub diffuse: [f32; 3],
    pub highlight: [f32; 3],
    pub reflection: [f32; 3],
    pub shine: f32,
    pub transmittance: f32,
    pub ior: f32,
}

impl Material {
    /// Whether it reflects or transmits.
    #[inline(always)]
    pub fn is_branching(&self) -> bool {
        self.transmittance > 0.0 || self.reflection.iter().any(|&share| share > 0.0)
    }
}
