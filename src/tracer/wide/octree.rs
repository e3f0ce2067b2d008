//! The octree as the fast kernel wants it: branches that know the boxes of what is below their children, leaves
//! that hold their triangles side by side.

use glam::DVec3;

use crate::database::Section;
use crate::database::records::{LeafEntry, OctreeNode, OctreeWord, Triangle};
use crate::database::verify::Verified;
use crate::tracer::octree::overlap::{Bounds, Cell, PADDING};

/// Triangles in a block; a leaf with more has several.
pub const BLOCK: usize = 16;

/// A triangle that the octree lists in no more leaves than this is kept in only one, whose box then reaches beyond its
/// cell.
const WHOLE: u8 = 8;

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

    fn centre(&self) -> [f32; 3] {
        std::array::from_fn(|a| 0.5 * (self.lo[a] + self.hi[a]))
    }

    /// Half of the surface.
    fn area(&self) -> f32 {
        let [x, y, z] = std::array::from_fn(|a| self.hi[a] - self.lo[a]);
        x * y + y * z + z * x
    }
}

/// A child to be, and its box.
type Entry = (Child, Fitted);

/// Up to eight children of a branch to be.
#[derive(Clone, Copy)]
struct Entries {
    entries: [Entry; 8],
    count: usize,
}

impl Entries {
    const NONE: Self = Self { entries: [(Child::EMPTY, Fitted::EMPTY); 8], count: 0 };

    fn push(&mut self, entry: Entry) {
        self.entries[self.count] = entry;
        self.count += 1;
    }

    fn all(&self) -> &[Entry] {
        &self.entries[..self.count]
    }

    fn fitted(&self) -> Fitted {
        self.all().iter().fold(Fitted::EMPTY, |all, entry| all.union(entry.1))
    }
}

/// What a cell came to.
enum Made {
    Empty,
    /// Its ids are on top of the stack, from here on.
    Leaf(usize, Fitted),
    /// Not placed yet: the branch above may take its children for its own.
    Branch(Entries),
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
    /// In how many leaves each triangle is listed, 255 for more.
    listed: Vec<u8>,
    octree: WideOctree,
    /// Ids of the leaves that are not placed yet.
    stack: Vec<u32>,
}

impl<'a> Derivation<'a> {
    fn new(database: &'a Verified) -> Self {
        let database = database.database();
        let spheres: &[crate::database::records::Sphere] = database.records(Section::Spheres);
        let cones: &[crate::database::records::Cone] = database.records(Section::Cones);
        let triangles: &[Triangle] = database.records(Section::Triangles);
        let leaf_lists: &[LeafEntry] = database.records(Section::LeafLists);
        let mut listed = vec![0u8; triangles.len()];
        for entry in leaf_lists {
            if let Some(listed) = listed.get_mut(entry.primitive().0 as usize) {
                *listed = listed.saturating_add(1);
            }
        }
        Self {
            words: database.records(Section::OctreeNodes),
            leaf_lists,
            triangles,
            listed,
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
                let mut fitted = Fitted::EMPTY;
                for entry in &self.leaf_lists[first as usize..] {
                    let id = entry.primitive().0;
                    if let Some(part) = self.part(id, cell) {
                        self.stack.push(id);
                        fitted = fitted.union(part);
                    }
                    if entry.is_last() {
                        break;
                    }
                }
                if self.stack.len() == from { Made::Empty } else { Made::Leaf(from, fitted) }
            }
            Some(OctreeNode::Branch(block)) => self.branch(block, cell),
            Some(OctreeNode::EmptyLeaf) | None => Made::Empty,
        }
    }

    fn branch(&mut self, block: u32, cell: Cell) -> Made {
        let from = self.stack.len();
        let made: [Made; 8] = std::array::from_fn(|octant| self.cell(block * 8 + octant as u32, cell.child(octant)));
        if let Some(fitted) = self.merged(from, &made) {
            return if self.stack.len() == from { Made::Empty } else { Made::Leaf(from, fitted) };
        }
        let (mut open, mut entries) = ([const { None }; 8], Entries::NONE);
        let mut opened = 0;
        // The last leaf's ids are on top.
        for made in made.into_iter().rev() {
            match made {
                Made::Branch(below) => {
                    open[opened] = Some(below);
                    opened += 1;
                }
                Made::Empty => {}
                Made::Leaf(..) => {
                    let leaf = self.place(made);
                    entries.push(leaf);
                }
            }
        }
        self.adopt(&mut entries, &mut open[..opened]);
        Made::Branch(entries)
    }

    /// Fills up the places that are left with the children of the largest branches, then places the others.
    fn adopt(&mut self, entries: &mut Entries, open: &mut [Option<Entries>]) {
        open.sort_by(|a, b| {
            let area = |below: &Option<Entries>| below.map_or(0.0, |below| below.fitted().area());
            area(b).total_cmp(&area(a))
        });
        let mut waiting = open.len();
        for below in open {
            let Some(below) = below.take() else { continue };
            waiting -= 1;
            if entries.count + below.count + waiting <= 8 {
                below.all().iter().for_each(|&entry| entries.push(entry));
            } else {
                let placed = self.place_branch(&below);
                entries.push(placed);
            }
        }
    }

    /// Each child goes to the octant that it lies towards, as far as that is free: what rays meet first comes first.
    fn place_branch(&mut self, below: &Entries) -> Entry {
        let whole = below.fitted();
        let centre = whole.centre();
        let mut branch = Branch { planes: [[0.0; 8]; 6], children: [Child::EMPTY; 8] };
        for row in 0..3 {
            (branch.planes[row], branch.planes[row + 3]) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
        }
        let mut towards = [[0.0; 8]; 8];
        for (entry, towards) in below.all().iter().zip(&mut towards) {
            let at = entry.1.centre();
            let [x, y, z] = std::array::from_fn(|a| at[a] - centre[a]);
            for (octant, towards) in towards.iter_mut().enumerate() {
                let sign = |axis: usize, by: f32| if octant >> axis & 1 == 1 { by } else { -by };
                *towards = sign(0, x) + sign(1, y) + sign(2, z);
            }
        }
        let (mut left, mut free) = ((1u32 << below.count) - 1, 0xffu32);
        while left != 0 {
            let mut best = (f32::NEG_INFINITY, left.trailing_zeros() as usize, free.trailing_zeros() as usize);
            for entry in (0..below.count).filter(|entry| left >> entry & 1 == 1) {
                for octant in (0..8).filter(|octant| free >> octant & 1 == 1) {
                    if towards[entry][octant] > best.0 {
                        best = (towards[entry][octant], entry, octant);
                    }
                }
            }
            let (_, entry, octant) = best;
            left &= !(1 << entry);
            free &= !(1 << octant);
            let (child, fitted) = below.entries[entry];
            branch.children[octant] = child;
            for axis in 0..3 {
                branch.planes[axis][octant] = fitted.lo[axis] - MARGIN;
                branch.planes[axis + 3][octant] = fitted.hi[axis] + MARGIN;
            }
        }
        self.octree.branches.push(branch);
        (Child(self.octree.branches.len() as u32 - 1), whole)
    }

    /// Makes one leaf of a branch's if they hold little; their ids are those of the stack from `from` on.
    fn merged(&mut self, from: usize, made: &[Made; 8]) -> Option<Fitted> {
        if self.stack.len() - from > 4 * MERGED || made.iter().any(|made| matches!(made, Made::Branch(_))) {
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

    /// The box around what a cell is to hold of a primitive, if anything.
    fn part(&self, id: u32, cell: Cell) -> Option<Fitted> {
        let (centre, half) = (cell.centre.as_vec3(), cell.half as f32);
        let (lo, hi) = match self.triangles.get(id as usize) {
            Some(triangle) => {
                let [x, y, z] = &triangle.coordinates;
                let least = |c: &[f32; 3]| c[0].min(c[1]).min(c[2]);
                let most = |c: &[f32; 3]| c[0].max(c[1]).max(c[2]);
                let (lo, hi) = ([least(x), least(y), least(z)], [most(x), most(y), most(z)]);
                if self.listed[id as usize] <= WHOLE {
                    // One cell alone holds this corner, which the triangle reaches into: it is listed there.
                    let holds = |axis: usize| {
                        let corner = triangle.coordinates[axis][0];
                        centre[axis] - half <= corner && corner < centre[axis] + half
                    };
                    return (holds(0) && holds(1) && holds(2)).then_some(Fitted { lo, hi });
                }
                (lo, hi)
            }
            None => {
                let bounds = &self.curved[id as usize - self.triangles.len()];
                let pad = |at: DVec3, by: f64| (at + by).as_vec3().to_array();
                (pad(bounds.lo, -PADDING), pad(bounds.hi, PADDING))
            }
        };
        Some(Fitted {
            lo: std::array::from_fn(|a| lo[a].max(centre[a] - half)),
            hi: std::array::from_fn(|a| hi[a].min(centre[a] + half)),
        })
    }

    /// Gives a cell its place in the octree; the ids of a leaf are taken off the stack.
    fn place(&mut self, made: Made) -> (Child, Fitted) {
        match made {
            Made::Empty => (Child::EMPTY, Fitted::EMPTY),
            Made::Branch(below) => self.place_branch(&below),
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
