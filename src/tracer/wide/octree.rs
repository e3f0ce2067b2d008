//! The octree as the fast kernel wants it: branches that know the boxes of what is below their children, leaves
//! that hold their triangles side by side.

use glam::DVec3;

use crate::database::Section;
use crate::database::records::{LeafEntry, OctreeNode, OctreeWord, Triangle};
use crate::database::verify::Verified;
use crate::tracer::octree::overlap::{Bounds, Cell, PADDING};

/// Triangles in a block; a leaf with more has several.
pub const BLOCK: usize = 16;

/// Leaves of one branch that hold no more different primitives than this together become one.
const MERGED: usize = 12;

/// Boxes are wider by this, so that a ray which runs within a face of one is inside of it.
const MARGIN: f32 = 1.0 / (1 << 23) as f32;

/// A child of a branch: a branch, a leaf or nothing.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    pub const EMPTY: Self = Self(u32::MAX);

    #[inline(always)]
    pub fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Of a branch its number, of a leaf the index of its first word.
    #[inline(always)]
    pub fn index(self) -> usize {
        (self.0 & !Self::LEAF) as usize
    }
}

/// A branch, 224 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Branch {
    /// Lower x, y, z, then upper x, y, z, by octant. An empty child's are the wrong way round.
    pub planes: [[f32; 8]; 6],
    pub children: [Child; 8],
}

/// A leaf's triangles, up to [`BLOCK`], side by side.
#[derive(Clone, Copy)]
pub struct Block<'a> {
    /// Nine coordinates by axis and vertex, then ids, then polygons: `count` words each, and some beyond.
    pub words: &'a [u32],
    pub count: usize,
}

/// The octree with fitted boxes and leaf blocks.
#[derive(Clone, Debug)]
pub struct WideOctree {
    branches: Vec<Branch>,
    /// A leaf is its number of triangles and of spheres and cones, its blocks, and the ids of the latter.
    leaves: Vec<u32>,
    pub(super) root: Child,
}

/// Words of a triangle in a block.
const ROWS: usize = 11;

#[derive(Clone, Copy, Debug)]
struct Fitted {
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Fitted {
    const EMPTY: Self = Self { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    fn union(self, other: Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].min(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].max(other.hi[a])),
        }
    }
}

/// What a cell came to.
enum Made {
    Empty,
    /// Its ids are on top of the stack, from here on.
    Leaf(usize, Fitted),
    Branch(Child, Fitted),
}

impl WideOctree {
    /// Derives it from a database's octree: the same cells, but that small leaves of one branch are merged.
    pub fn derive(database: &Verified) -> Self {
        let mut derivation = Derivation::new(database);
        let made = derivation.cell(0, Cell::ROOT);
        let (root, _) = derivation.place(made);
        derivation.octree.root = root;
        derivation.octree
    }

    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.branches[..]) + size_of_val(&self.leaves[..])) as u64
    }

    #[inline(always)]
    pub(super) fn branch(&self, child: Child) -> &Branch {
        &self.branches[child.index()]
    }

    /// A leaf's blocks, and the ids of its spheres and cones.
    #[inline(always)]
    pub(super) fn leaf(&self, child: Child) -> (Blocks<'_>, &[u32]) {
        let words = &self.leaves[child.index()..];
        let (triangles, curved) = (words[0] as usize, words[1] as usize);
        let blocks = Blocks { words: &words[2..], left: triangles };
        let curved = if curved == 0 { &[] } else { &words[2 + ROWS * triangles..][..curved] };
        (blocks, curved)
    }
}

/// The blocks of a leaf.
pub(super) struct Blocks<'a> {
    words: &'a [u32],
    left: usize,
}

impl<'a> Iterator for Blocks<'a> {
    type Item = Block<'a>;

    #[inline(always)]
    fn next(&mut self) -> Option<Block<'a>> {
        if self.left == 0 {
            return None;
        }
        let count = self.left.min(BLOCK);
        let words = self.words;
        self.left -= count;
        self.words = &words[ROWS * count..];
        Some(Block { words, count })
    }
}

impl Block<'_> {
    /// A row of coordinates; what is beyond `count` means nothing.
    #[inline(always)]
    pub fn coordinates(&self, axis: usize, vertex: usize) -> &[f32] {
        bytemuck::cast_slice(&self.words[(3 * axis + vertex) * self.count..])
    }

    #[inline(always)]
    pub fn id(&self, at: usize) -> u32 {
        self.words[9 * self.count + at]
    }

    #[inline(always)]
    pub fn polygon(&self, at: usize) -> u32 {
        self.words[10 * self.count + at]
    }

    #[inline(always)]
    pub fn polygons(&self) -> &[f32] {
        bytemuck::cast_slice(&self.words[10 * self.count..])
    }
}

struct Derivation<'a> {
    words: &'a [OctreeWord],
    leaf_lists: &'a [LeafEntry],
    triangles: &'a [Triangle],
    /// Of spheres, then cones.
    curved: Vec<Bounds>,
    octree: WideOctree,
    /// Ids of the leaves that are not placed yet.
    stack: Vec<u32>,
}

impl<'a> Derivation<'a> {
    fn new(database: &'a Verified) -> Self {
        let database = database.database();
        let spheres: &[crate::database::records::Sphere] = database.records(Section::Spheres);
        let cones: &[crate::database::records::Cone] = database.records(Section::Cones);
        Self {
            words: database.records(Section::OctreeNodes),
            leaf_lists: database.records(Section::LeafLists),
            triangles: database.records(Section::Triangles),
            curved: spheres.iter().map(Bounds::of_sphere).chain(cones.iter().map(Bounds::of_cone)).collect(),
            // So many words may be read beyond the last row.
            octree: WideOctree { branches: Vec::new(), leaves: vec![0; BLOCK], root: Child::EMPTY },
            stack: Vec::new(),
        }
    }

    fn cell(&mut self, word: u32, cell: Cell) -> Made {
        match self.words[word as usize].decode() {
            Some(OctreeNode::Leaf(first)) => {
                let from = self.stack.len();
                for entry in &self.leaf_lists[first as usize..] {
                    self.stack.push(entry.primitive().0);
                    if entry.is_last() {
                        break;
                    }
                }
                let fitted = self.fit(from, cell);
                Made::Leaf(from, fitted)
            }
            Some(OctreeNode::Branch(block)) => self.branch(block, cell),
            Some(OctreeNode::EmptyLeaf) | None => Made::Empty,
        }
    }

    fn branch(&mut self, block: u32, cell: Cell) -> Made {
        let from = self.stack.len();
        let number = self.octree.branches.len();
        // Its place is before those of its children, as they are visited.
        self.octree.branches.push(Branch { planes: [[0.0; 8]; 6], children: [Child::EMPTY; 8] });
        let made: [Made; 8] = std::array::from_fn(|octant| self.cell(block * 8 + octant as u32, cell.child(octant)));
        if number + 1 == self.octree.branches.len()
            && let Some(fitted) = self.merged(from, &made)
        {
            self.octree.branches.pop();
            return if self.stack.len() == from { Made::Empty } else { Made::Leaf(from, fitted) };
        }
        let mut branch = Branch { planes: [[0.0; 8]; 6], children: [Child::EMPTY; 8] };
        let mut whole = Fitted::EMPTY;
        // The last leaf's ids are on top.
        for (octant, made) in made.into_iter().enumerate().rev() {
            let (child, fitted) = self.place(made);
            branch.children[octant] = child;
            for axis in 0..3 {
                branch.planes[axis][octant] = fitted.lo[axis] - MARGIN;
                branch.planes[axis + 3][octant] = fitted.hi[axis] + MARGIN;
            }
            whole = whole.union(fitted);
        }
        self.octree.branches[number] = branch;
        Made::Branch(Child(number as u32), whole)
    }

    /// Makes one leaf of a branch's if they hold little; their ids are those of the stack from `from` on.
    fn merged(&mut self, from: usize, made: &[Made; 8]) -> Option<Fitted> {
        if self.stack.len() - from > 4 * MERGED {
            return None;
        }
        let mut ids: Vec<u32> = self.stack[from..].to_vec();
        ids.sort_unstable();
        ids.dedup();
        if ids.len() > MERGED {
            return None;
        }
        self.stack.truncate(from);
        self.stack.extend(ids);
        let fitted = made.iter().map(|made| if let Made::Leaf(_, fitted) = made { *fitted } else { Fitted::EMPTY });
        Some(fitted.fold(Fitted::EMPTY, Fitted::union))
    }

    /// The box around what the primitives from `from` on have in the cell.
    fn fit(&self, from: usize, cell: Cell) -> Fitted {
        let mut all = Fitted::EMPTY;
        for &id in &self.stack[from..] {
            let one = match self.triangles.get(id as usize) {
                Some(triangle) => {
                    let [x, y, z] = &triangle.coordinates;
                    let least = |c: &[f32; 3]| c[0].min(c[1]).min(c[2]);
                    let most = |c: &[f32; 3]| c[0].max(c[1]).max(c[2]);
                    Fitted { lo: [least(x), least(y), least(z)], hi: [most(x), most(y), most(z)] }
                }
                None => {
                    let bounds = &self.curved[id as usize - self.triangles.len()];
                    let pad = |at: DVec3, by: f64| (at + by).as_vec3().to_array();
                    Fitted { lo: pad(bounds.lo, -PADDING), hi: pad(bounds.hi, PADDING) }
                }
            };
            all = all.union(one);
        }
        let (centre, half) = (cell.centre.as_vec3(), cell.half as f32);
        Fitted {
            lo: std::array::from_fn(|a| all.lo[a].max(centre[a] - half)),
            hi: std::array::from_fn(|a| all.hi[a].min(centre[a] + half)),
        }
    }

    /// Gives a cell its place in the octree; the ids of a leaf are taken off the stack.
    fn place(&mut self, made: Made) -> (Child, Fitted) {
        match made {
            Made::Empty => (Child::EMPTY, Fitted::EMPTY),
            Made::Branch(child, fitted) => (child, fitted),
            Made::Leaf(from, fitted) => {
                let child = self.leaf(from);
                self.stack.truncate(from);
                (child, fitted)
            }
        }
    }

    fn leaf(&mut self, from: usize) -> Child {
        let ids = &self.stack[from..];
        let leaves = &mut self.octree.leaves;
        leaves.truncate(leaves.len() - BLOCK);
        let first = leaves.len();
        let is_triangle = |id: &&u32| (**id as usize) < self.triangles.len();
        let triangles = ids.iter().filter(is_triangle).count();
        leaves.extend([triangles as u32, (ids.len() - triangles) as u32]);
        let mut block = [0; BLOCK];
        let mut rest = ids.iter().filter(is_triangle).copied();
        let mut left = triangles;
        while left > 0 {
            let count = left.min(BLOCK);
            left -= count;
            block[..count].iter_mut().zip(&mut rest).for_each(|(to, id)| *to = id);
            let start = leaves.len();
            leaves.resize(start + ROWS * count, 0);
            let rows = &mut leaves[start..];
            for (at, &id) in block[..count].iter().enumerate() {
                let triangle = &self.triangles[id as usize];
                for (row, coordinate) in triangle.coordinates.iter().flatten().enumerate() {
                    rows[row * count + at] = coordinate.to_bits();
                }
                rows[9 * count + at] = id;
                rows[10 * count + at] = triangle.polygon();
            }
        }
        leaves.extend(ids.iter().filter(|id| !is_triangle(id)));
        leaves.extend([0; BLOCK]);
        Child(first as u32 | Child::LEAF)
    }
}
