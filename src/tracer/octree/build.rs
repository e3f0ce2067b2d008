//! The eager builder: a cell that holds too much is divided, depth first, children in octant order, so that
//! the words of a subtree and the lists of its leaves lie together.

use super::BuildParameters;
use super::overlap::{Bounds, Cell, cone_octants, sphere_octants, triangle_octants};
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
        records,
        parameters,
        bounds: bounds(records),
        octree: Octree { words: vec![0; 8], leaf_lists: Vec::new() },
        cells: records.primitive_ids().map(|id| id.0).collect(),
        octants: Vec::new(),
    };
    let all = builder.cells.len();
    let root = builder.node(Cell::ROOT, 0, 0, all)?;
    builder.octree.words[0] = root.0;
    Ok(builder.octree)
}

fn bounds(records: &Records) -> Vec<Bounds> {
    let triangles = records.triangles.iter().map(Bounds::of_triangle);
    let spheres = records.spheres.iter().map(Bounds::of_sphere);
    let cones = records.cones.iter().map(Bounds::of_cone);
    triangles.chain(spheres).chain(cones).collect()
}

struct Builder<'a> {
    records: &'a Records,
    parameters: BuildParameters,
    bounds: Vec<Bounds>,
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
        let spent = self.octree.leaf_lists.len() > REFERENCES_FREE + REFERENCES_A_PRIMITIVE * self.bounds.len();
        if count <= self.parameters.leaf_size as usize || level == self.parameters.max_depth || spent {
            return self.leaf(first, end);
        }
        self.octants.clear();
        for i in first..end {
            let octants = self.octants_of(PrimitiveId(self.cells[i]), cell);
            self.octants.push(octants);
        }
        // Where no child holds fewer than its parent, dividing further gains nothing.
        if self.octants.iter().all(|&octants| octants == 0xff) {
            return self.leaf(first, end);
        }
        self.branch(cell, level, first, end)
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

    fn branch(&mut self, cell: Cell, level: u32, first: usize, end: usize) -> Result<OctreeWord, OctreeTooLarge> {
        let block = self.octree.words.len() / 8;
        if block > OctreeWord::INDEX_MAX as usize {
            return Err(OctreeTooLarge);
        }
        self.octree.words.extend([0; 8]);
        // The children's lists go onto the stack at once, since `octants` is reused further down.
        let mut lists = [(0, 0); 8];
        for (octant, list) in lists.iter_mut().enumerate() {
            let from = self.cells.len();
            for i in first..end {
                if self.octants[i - first] >> octant & 1 == 1 {
                    self.cells.push(self.cells[i]);
                }
            }
            *list = (from, self.cells.len());
        }
        let top = self.cells.len();
        for (octant, &(from, to)) in lists.iter().enumerate() {
            let word = self.node(cell.child(octant), level + 1, from, to)?;
            self.octree.words[block * 8 + octant] = word.0;
            self.cells.truncate(top);
        }
        self.cells.truncate(lists[0].0);
        Ok(OctreeWord::branch(block as u32))
    }

    fn octants_of(&self, id: PrimitiveId, cell: Cell) -> u8 {
        let index = id.0 as usize;
        let candidates = self.bounds[index].octants(cell);
        // In one octant only: it is that one, since the primitive reaches into the cell.
        if candidates.count_ones() <= 1 {
            return candidates;
        }
        let (triangles, spheres) = (self.records.triangles.len(), self.records.spheres.len());
        if index < triangles {
            triangle_octants(&self.records.triangles[index], cell, candidates)
        } else if index < triangles + spheres {
            sphere_octants(&self.records.spheres[index - triangles], cell, candidates)
        } else {
            cone_octants(&self.records.cones[index - triangles - spheres], cell, candidates)
        }
    }
}
