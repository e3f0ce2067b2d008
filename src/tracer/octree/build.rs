//! The eager builder: a cell that holds too much is divided, depth first, children in octant order, so that
//! the words of a subtree and the lists of its leaves lie together.

use super::BuildParameters;
use super::octants::Octants;
use super::overlap::Cell;
use crate::database::compile::Records;
use crate::database::records::{LeafEntry, OctreeWord, PrimitiveId};

/// Cells are no longer divided once the leaves hold so many references: large coincident polygons would
/// otherwise be listed in 4 times as many leaves with every level.
const REFERENCES_A_PRIMITIVE: usize = 64;
const REFERENCES_FREE: usize = 1 << 20;

/// The octree's two sections.
#[derive(Clone, Debug, Default)]
pub struct Octree {
    /// [`OctreeWord`]s.
    pub words: Vec<u32>,
    /// [`LeafEntry`]s.
    pub leaf_lists: Vec<u32>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the octree would have more than {} leaf entries", OctreeWord::INDEX_MAX)]
pub struct OctreeTooLarge;

/// Builds the octree over all primitives. The result is a function of the records and parameters alone.
///
/// # Errors
/// The octree's sections outgrow what their words can index.
pub fn build(records: &Records, parameters: BuildParameters) -> Result<Octree, OctreeTooLarge> {
    let mut builder = Builder {
        primitives: Octants::new(records),
        count: records.primitive_count(),
        parameters,
        octree: Octree { words: vec![0; 8], leaf_lists: Vec::new() },
        cells: records.primitive_ids().map(|id| id.0).collect(),
        octants: Vec::new(),
    };
    let all = builder.cells.len();
    let root = builder.node(Cell::ROOT, 0, 0, all)?;
    builder.octree.words[0] = root.0;
    Ok(builder.octree)
}

struct Builder<'a> {
    primitives: Octants<'a>,
    /// Of all primitives.
    count: usize,
    parameters: BuildParameters,
    octree: Octree,
    /// The primitives of the cells on the way down, a stack: the current cell's are on top.
    cells: Vec<u32>,
    /// Which octants each primitive of the current cell reaches; scratch.
    octants: Vec<u8>,
}

impl Builder<'_> {
    /// Makes the node of a cell whose primitives are `cells[first..end]`.
    fn node(&mut self, cell: Cell, level: u32, first: usize, end: usize) -> Result<OctreeWord, OctreeTooLarge> {
        let count = end - first;
        if count == 0 {
            return Ok(OctreeWord::EMPTY);
        }
        let spent = self.octree.leaf_lists.len() > REFERENCES_FREE + REFERENCES_A_PRIMITIVE * self.count;
        if count <= self.parameters.leaf_size as usize || level == self.parameters.max_depth || spent {
            return self.leaf(first, end);
        }
        self.primitives.of(&self.cells[first..end], cell, &mut self.octants);
        let mut counts = [0; 8];
        for octants in &self.octants {
            for (octant, count) in counts.iter_mut().enumerate() {
                *count += usize::from(octants >> octant & 1);
            }
        }
        // Where no child holds fewer than its parent, dividing further gains nothing.
        if counts == [count; 8] {
            return self.leaf(first, end);
        }
        self.branch(cell, level, first, counts)
    }

    fn leaf(&mut self, first: usize, end: usize) -> Result<OctreeWord, OctreeTooLarge> {
        let at = self.octree.leaf_lists.len();
        if at + (end - first) > OctreeWord::INDEX_MAX as usize {
            return Err(OctreeTooLarge);
        }
        let entry = |i: usize| LeafEntry::new(PrimitiveId(self.cells[i]), i + 1 == end).0;
        self.octree.leaf_lists.extend((first..end).map(entry));
        Ok(OctreeWord::leaf(at as u32))
    }

    /// `counts`: how many of the primitives, `cells[first..]`, each octant holds.
    fn branch(
        &mut self,
        cell: Cell,
        level: u32,
        first: usize,
        counts: [usize; 8],
    ) -> Result<OctreeWord, OctreeTooLarge> {
        let block = self.octree.words.len() / 8;
        if block > OctreeWord::INDEX_MAX as usize {
            return Err(OctreeTooLarge);
        }
        self.octree.words.extend([0; 8]);
        // The children's lists go onto the stack at once, since `octants` is reused further down.
        let bottom = self.cells.len();
        let mut ends = [bottom; 8];
        for octant in 1..8 {
            ends[octant] = ends[octant - 1] + counts[octant - 1];
        }
        self.cells.resize(ends[7] + counts[7], 0);
        for (i, &octants) in self.octants.iter().enumerate() {
            let (id, mut rest) = (self.cells[first + i], octants);
            while rest != 0 {
                let end = &mut ends[rest.trailing_zeros() as usize];
                self.cells[*end] = id;
                *end += 1;
                rest &= rest - 1;
            }
        }
        for octant in 0..8 {
            let word = self.node(cell.child(octant), level + 1, ends[octant] - counts[octant], ends[octant])?;
            self.octree.words[block * 8 + octant] = word.0;
        }
        self.cells.truncate(bottom);
        Ok(OctreeWord::branch(block as u32))
    }
}
