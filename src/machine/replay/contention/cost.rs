//! From counts to cycles.

use crate::hardware::specification::Processor;
use trace::database::Section;

/// What a processor spends on a record that it reads: the access itself, and what it does with it. A read of an octree
/// node is a step of the walk, one of a primitive is a test, one of a surface is a shading. A polygon's tests are those of its
/// triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadCycles([u32; Section::COUNT]);

impl ReadCycles {
    pub fn new(processor: &Processor) -> Self {
        let Processor { octree_node, primitive_test, shading, local_access } = *processor;
        Self(Section::ALL.map(|section| {
            local_access
                + match section {
                    Section::OctreeNodes => octree_node,
                    Section::Triangles | Section::Spheres | Section::Cones => primitive_test,
                    Section::Surfaces => shading,
                    Section::LeafLists | Section::Normals | Section::Materials | Section::Polygons => 0,
                }
        }))
    }

    /// Cycles, at most 2,000,000.
    #[inline(always)]
    pub fn of(&self, section: Section) -> u32 {
        self.0[section as usize]
    }
}
