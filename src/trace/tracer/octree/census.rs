//! What an octree consists of, level by level.

use crate::database::Section;
use crate::database::records::{LeafEntry, OctreeNode, OctreeWord};
use crate::database::verify::Verified;

/// Counts of the nodes of one level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Level {
    pub branches: u64,
    /// Leaves with primitives.
    pub leaves: u64,
    pub empty_leaves: u64,
    /// Primitives listed in the level's leaves.
    pub references: u64,
}

impl Level {
    pub fn nodes(&self) -> u64 {
        self.branches + self.leaves + self.empty_leaves
    }
}

/// An octree's levels, from the root's on, down to the deepest node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Census {
    pub levels: Vec<Level>,
}

impl Census {
    pub fn of(database: &Verified) -> Self {
        let words: &[OctreeWord] = database.unpadded().records(Section::OctreeNodes);
        let entries: &[LeafEntry] = database.unpadded().records(Section::LeafLists);
        let mut levels = Vec::new();
        let mut rest = vec![(words[0], 0)];
        while let Some((word, level)) = rest.pop() {
            if levels.len() <= level {
                levels.resize(level + 1, Level::default());
            }
            let counts = &mut levels[level];
            match word.decode() {
                Some(OctreeNode::Branch(block)) => {
                    counts.branches += 1;
                    let first = block as usize * 8;
                    rest.extend(words[first..first + 8].iter().map(|&child| (child, level + 1)));
                }
                Some(OctreeNode::Leaf(first)) => {
                    counts.leaves += 1;
                    let last = entries[first as usize..].iter().position(|entry| entry.is_last());
                    counts.references += last.map_or(0, |last| last as u64 + 1);
                }
                Some(OctreeNode::EmptyLeaf) | None => counts.empty_leaves += 1,
            }
        }
        Self { levels }
    }

    /// Level of the deepest node; the root's is 0.
    pub fn depth(&self) -> u32 {
        self.levels.len() as u32 - 1
    }

    pub fn total(&self) -> Level {
        self.levels.iter().fold(Level::default(), |sum, level| Level {
            branches: sum.branches + level.branches,
            leaves: sum.leaves + level.leaves,
            empty_leaves: sum.empty_leaves + level.empty_leaves,
            references: sum.references + level.references,
        })
    }
}
