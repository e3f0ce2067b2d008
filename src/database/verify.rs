//! A database that came from outside, checked once so that nothing after it need check again.

use super::records::{LeafEntry, OctreeNode, OctreeWord, Surface};
use super::{Database, Section};
use crate::tracer::stats::MAX_DEPTH;

/// A record that points outside of its section, or an octree that is no tree.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the database is corrupt: {0}")]
pub struct Corrupt(pub String);

/// A database whose every index is in range and whose octree is a tree no deeper than its header says.
#[derive(Clone, Debug)]
pub struct Verified(Database);

impl Verified {
    /// Linear in the size of the image.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn new(database: Database) -> Result<Self, Corrupt> {
        let header = &database.header;
        if database.words.len() as u64 * 4 != header.layout.image_bytes() {
            return Err(Corrupt(format!(
                "{} bytes, expected {}",
                database.words.len() as u64 * 4,
                header.layout.image_bytes()
            )));
        }
        if header.max_depth > MAX_DEPTH {
            return Err(Corrupt(format!("octree depth {}, expected at most {MAX_DEPTH}", header.max_depth)));
        }
        let count = |section| header.layout.span(section).records;
        let primitives = count(Section::Triangles) + count(Section::Spheres) + count(Section::Cones);
        if count(Section::Surfaces) != primitives {
            return Err(Corrupt(format!("{} surfaces, expected {primitives}", count(Section::Surfaces))));
        }
        check_octree(&database)?;
        check_leaf_lists(database.records(Section::LeafLists), primitives)?;
        check_surfaces(database.records(Section::Surfaces), count(Section::Materials), count(Section::Normals))?;
        Ok(Self(database))
    }

    pub fn database(&self) -> &Database {
        &self.0
    }
}

/// Walks the tree from the root: every block has one parent, every leaf's list begins in range.
fn check_octree(database: &Database) -> Result<(), Corrupt> {
    let words: &[OctreeWord] = database.records(Section::OctreeNodes);
    let entries = database.header.layout.span(Section::LeafLists).records;
    let blocks = words.len() / 8;
    if words.is_empty() {
        return Err(Corrupt("no octree root".to_owned()));
    }
    let mut seen = vec![false; blocks];
    let mut rest = vec![(words[0], 0)];
    while let Some((word, level)) = rest.pop() {
        match word.decode() {
            Some(OctreeNode::EmptyLeaf) => {}
            Some(OctreeNode::Leaf(first)) if u64::from(first) < entries => {}
            Some(OctreeNode::Branch(block))
                if level < database.header.max_depth && (1..blocks).contains(&(block as usize)) =>
            {
                if std::mem::replace(&mut seen[block as usize], true) {
                    return Err(Corrupt(format!("octree block {block} has two parents")));
                }
                let first = block as usize * 8;
                rest.extend(words[first..first + 8].iter().map(|&child| (child, level + 1)));
            }
            _ => return Err(Corrupt(format!("octree node {:#010x} on level {level}", word.0))),
        }
    }
    Ok(())
}

/// Every list ends, since the last entry of all is the last of its leaf.
fn check_leaf_lists(entries: &[LeafEntry], primitives: u64) -> Result<(), Corrupt> {
    if entries.last().is_some_and(|e| !e.is_last()) {
        return Err(Corrupt("the last leaf list does not end".to_owned()));
    }
    match entries.iter().find(|e| u64::from(e.primitive().0) >= primitives) {
        Some(entry) => {
            Err(Corrupt(format!("primitive {} in a leaf, expected below {primitives}", entry.primitive().0)))
        }
        None => Ok(()),
    }
}

fn check_surfaces(surfaces: &[Surface], materials: u64, normals: u64) -> Result<(), Corrupt> {
    let good = |s: &&Surface| {
        u64::from(s.material) < materials && (s.normals == Surface::FLAT || u64::from(s.normals) < normals)
    };
    match surfaces.iter().find(|s| !good(s)) {
        Some(s) => Err(Corrupt(format!("surface with material {} and normals {}", s.material, s.normals))),
        None => Ok(()),
    }
}
