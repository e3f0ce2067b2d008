//! On which level each octree node is: what a reference to it does not say.

use trace::database::Section;
use trace::database::records::{OctreeNode, OctreeWord};
use trace::database::verify::Verified;

/// The file that keeps them: a byte a block.
pub const LEVELS_NAME: &str = "octree-levels.u8";

/// By block of eight octree words, the level of the nodes in it; the root's is 0.
pub fn octree_levels(database: &Verified) -> Vec<u8> {
    let words: &[OctreeWord] = database.unpadded().records(Section::OctreeNodes);
    let mut levels = vec![0; words.len() / 8];
    // A verified octree has no more than 20 levels.
    let mut rest = vec![(words[0], 0u8)];
    while let Some((word, level)) = rest.pop() {
        if let Some(OctreeNode::Branch(block)) = word.decode() {
            levels[block as usize] = level + 1;
            rest.extend(words[block as usize * 8..][..8].iter().map(|&child| (child, level + 1)));
        }
    }
    levels
}
