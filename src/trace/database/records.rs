//! Every record of the image: the one place where their sizes and bits are documented.
//!
//! All fields are 32-bit little-endian words; a record has no padding inside. A section may have some after each record:
//! [`super::layout`] knows.

use std::ops::Range;

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

/// A primitive in a leaf, 4 bytes. Bit 31: the last of its leaf. Bits 30–0: the primitive's id; in a database of polygons, its
/// number as an object: polygons first, then spheres, then cones.
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
    /// Without area.
    pub const ZERO: Self = Self { coordinates: [[0.0; 3]; 3], tag: 0 };

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

/// A polygon as one object, 8 bytes: which triangles it consists of. Every triangle is of one polygon, and polygons have
/// their triangles in order.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Polygon {
    /// Index of the first.
    pub first_triangle: u32,
    /// How many there are, at least one; they follow one another.
    pub triangle_count: u32,
}

impl Polygon {
    /// The indices of its triangles; those beyond the last number are none.
    #[inline(always)]
    pub fn triangles(self) -> Range<u32> {
        self.first_triangle..self.first_triangle.saturating_add(self.triangle_count)
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

/// What a primitive's surface looks like, 8 bytes, indexed by primitive id; in a database of polygons, too.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Surface {
    pub material: u32,
    /// What is known of a triangle's corners. Bits 31–30: 0, their unit normals; 1, their colours; 2, their colours, and in
    /// the next record their normals. Bits 29–0: the index in the section of normals. All bits set: nothing.
    corners: u32,
}

impl Surface {
    /// Indices are below this.
    pub const CORNERS_MAX: u32 = 1 << 30;
    const COLOURED: u32 = 1 << 30;
    const COLOURED_SMOOTH: u32 = 2 << 30;
    const PLAIN: u32 = u32::MAX;

    /// Of one colour, and flat.
    pub fn plain(material: u32) -> Self {
        Self { material, corners: Self::PLAIN }
    }

    /// A triangle with the normals at this index.
    pub fn smooth(material: u32, normals: u32) -> Self {
        debug_assert!(normals < Self::CORNERS_MAX);
        Self { material, corners: normals }
    }

    /// A triangle with the colours at this index and, if it is smooth, the normals at the next.
    pub fn coloured(material: u32, colours: u32, is_smooth: bool) -> Self {
        debug_assert!(colours < Self::CORNERS_MAX);
        Self { material, corners: colours | if is_smooth { Self::COLOURED_SMOOTH } else { Self::COLOURED } }
    }

    /// Index of the corners' normals; `None` for a flat surface.
    #[inline(always)]
    pub fn normals(self) -> Option<u32> {
        match self.corners >> 30 {
            0 => Some(self.corners),
            2 => Some((self.corners & (Self::CORNERS_MAX - 1)) + 1),
            _ => None,
        }
    }

    /// Index of the corners' colours; `None` for a surface of its material's colour alone.
    #[inline(always)]
    pub fn colours(self) -> Option<u32> {
        matches!(self.corners >> 30, 1 | 2).then_some(self.corners & (Self::CORNERS_MAX - 1))
    }

    /// Whether the bits say one of the above.
    pub fn is_known(self) -> bool {
        self.corners >> 30 < 3 || self.corners == Self::PLAIN
    }
}

/// A vector at each corner of a triangle, 36 bytes: its unit normal, or its colour in linear RGB.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Normals(pub [[f32; 3]; 3]);

impl Normals {
    /// Exactly, by vertex.
    pub fn widened(&self) -> [[f64; 3]; 3] {
        self.0.map(|normal| normal.map(f64::from))
    }
}

/// A material, 48 bytes; the terms are those of [`crate::scene::Material`]. If it emits, or lets a light's rays pass, the sign
/// of `ior` is negative and its [`LightTerms`] are in the next record.
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    pub diffuse: [f32; 3],
    pub highlight: [f32; 3],
    pub reflection: [f32; 3],
    pub shine: f32,
    pub transmittance: f32,
    ior: f32,
}

/// What a material adds to light by itself, and what it leaves of a light's rays: a record like a [`Material`]'s, so that
/// scenes without have none.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct LightTerms {
    /// Linear RGB.
    pub emission: [f32; 3],
    /// Share of a light's rays that pass, 0 to 1.
    pub shadow_transmittance: f32,
}

impl LightTerms {
    pub const NONE: Self = Self { emission: [0.0; 3], shadow_transmittance: 0.0 };
}

impl From<Material> for LightTerms {
    fn from(record: Material) -> Self {
        Self { emission: record.diffuse, shadow_transmittance: record.transmittance }
    }
}

impl From<LightTerms> for Material {
    fn from(terms: LightTerms) -> Self {
        let nothing = Self::zeroed();
        Self { diffuse: terms.emission, transmittance: terms.shadow_transmittance, ..nothing }
    }
}

impl Material {
    /// `has_light_terms`: they are in the next record.
    pub fn new(of: &crate::scene::Material, has_light_terms: bool) -> Self {
        let f32s = |v: DVec3| v.as_vec3().to_array();
        let ior = of.ior as f32;
        Self {
            diffuse: f32s(of.diffuse),
            highlight: f32s(of.highlight),
            reflection: f32s(of.reflection),
            shine: of.shine as f32,
            transmittance: of.transmittance as f32,
            ior: if has_light_terms { -ior } else { ior },
        }
    }

    /// Index of refraction inside.
    #[inline(always)]
    pub fn ior(&self) -> f32 {
        self.ior.abs()
    }

    /// Whether the next record has its [`LightTerms`].
    #[inline(always)]
    pub fn has_light_terms(&self) -> bool {
        self.ior.is_sign_negative()
    }

    /// Whether it reflects or transmits.
    #[inline(always)]
    pub fn is_branching(&self) -> bool {
        self.transmittance > 0.0 || self.reflection.iter().any(|&share| share > 0.0)
    }
}
