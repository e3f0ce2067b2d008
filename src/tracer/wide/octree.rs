//! The octree as the fast kernel wants it: branches that know the boxes of what is below their children, leaves
//! that hold their triangles side by side.

use crate::database::Section;
use crate::database::records::Triangle;
use crate::database::verify::Verified;
use crate::tracer::octree::overlap::{Bounds, PADDING};

/// Triangles in a block; a leaf with more has several.
pub(super) const BLOCK: usize = 16;

/// Boxes are wider by this, so that a ray which runs within a face of one is inside of it.
const MARGIN: f32 = 1.0 / (1 << 23) as f32;

/// A child of a branch: a branch, a leaf or nothing.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;
    pub(super) const EMPTY: Self = Self(u32::MAX);

    #[inline(always)]
    pub(super) fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// Of a branch its number, of a leaf the index of its first word.
    #[inline(always)]
    pub(super) fn index(self) -> usize {
        (self.0 & !Self::LEAF) as usize
    }
}

/// A branch, 224 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Branch {
    /// Lower x, y, z, then upper x, y, z, by octant. An empty child's are the wrong way round.
    pub planes: [[f32; 8]; 6],
    pub children: [Child; 8],
}

/// A leaf's triangles, up to [`BLOCK`], side by side.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
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
#[expect(clippy::large_enum_variant, reason = "one of a level at a time")]
enum Made {
    Leaf(Entry),
    /// Not placed yet: the branch above may take its children for its own.
    Branch(Entries),
}

impl WideOctree {
    /// Derives it from a database's primitives.
    pub fn derive(database: &Verified) -> Self {
        let mut derivation = Derivation::new(database);
        let all = derivation.items.len();
        if all > 0 {
            let (root, _) = match derivation.cell(0, all, 0) {
                Made::Leaf(entry) => entry,
                Made::Branch(below) => derivation.place_branch(&below),
            };
            derivation.octree.root = root;
        }
        derivation.octree
    }

    /// Adds a leaf; ids of triangles come first.
    fn append(&mut self, all: &[Triangle], ids: impl Iterator<Item = u32> + Clone) -> Child {
        let leaves = &mut self.leaves;
        leaves.truncate(leaves.len() - BLOCK);
        let first = leaves.len();
        let triangles = ids.clone().take_while(|id| (*id as usize) < all.len()).count();
        let curved = ids.clone().count() - triangles;
        leaves.extend([triangles as u32, curved as u32]);
        let mut rest = ids;
        let mut left = triangles;
        while left > 0 {
            let count = left.min(BLOCK);
            left -= count;
            let start = leaves.len();
            leaves.resize(start + ROWS * count, 0);
            let rows = &mut leaves[start..];
            for (at, id) in rest.by_ref().take(count).enumerate() {
                let triangle = &all[id as usize];
                for (row, coordinate) in triangle.coordinates.iter().flatten().enumerate() {
                    rows[row * count + at] = coordinate.to_bits();
                }
                rows[9 * count + at] = id;
                rows[10 * count + at] = triangle.polygon();
            }
        }
        leaves.extend(rest);
        leaves.extend([0; BLOCK]);
        Child(first as u32 | Child::LEAF)
    }

    /// Has the processor load what a child's visit begins with.
    #[inline(always)]
    pub(super) fn prefetch(&self, child: Child) {
        if child.is_leaf() {
            prefetch_lines::<6, _>(&self.leaves, child.index());
        } else {
            prefetch_lines::<4, _>(&self.branches, child.index());
        }
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
    pub(super) fn coordinates(&self, axis: usize, vertex: usize) -> &[f32] {
        bytemuck::cast_slice(&self.words[(3 * axis + vertex) * self.count..])
    }

    #[inline(always)]
    pub(super) fn id(&self, at: usize) -> u32 {
        self.words[9 * self.count + at]
    }

    #[inline(always)]
    pub(super) fn polygon(&self, at: usize) -> u32 {
        self.words[10 * self.count + at]
    }

    #[inline(always)]
    pub(super) fn polygons(&self) -> &[f32] {
        bytemuck::cast_slice(&self.words[10 * self.count..])
    }
}

/// A primitive on its way to a leaf.
#[derive(Clone, Copy)]
struct Item {
    /// Interleaved bits of the centre of its box, x the lowest: the cells of an octree, from the root's octant down.
    code: u64,
    id: u32,
}

/// Levels that a code tells apart.
const LEVELS: u32 = 21;

struct Derivation<'a> {
    triangles: &'a [Triangle],
    /// Of spheres, then cones.
    curved: Vec<Bounds>,
    octree: WideOctree,
    items: Vec<Item>,
}

impl<'a> Derivation<'a> {
    fn new(database: &'a Verified) -> Self {
        let database = database.database();
        let triangles: &[Triangle] = database.records(Section::Triangles);
        let spheres: &[crate::database::records::Sphere] = database.records(Section::Spheres);
        let cones: &[crate::database::records::Cone] = database.records(Section::Cones);
        let mut derivation = Self {
            triangles,
            curved: spheres.iter().map(Bounds::of_sphere).chain(cones.iter().map(Bounds::of_cone)).collect(),
            // So many words may be read beyond the last row.
            octree: WideOctree { branches: Vec::new(), leaves: vec![0; BLOCK], root: Child::EMPTY },
            items: Vec::new(),
        };
        let ids = 0..(triangles.len() + derivation.curved.len()) as u32;
        derivation.items = ids.map(|id| Item { code: code(derivation.fitted(id).centre()), id }).collect();
        derivation.items.sort_unstable_by_key(|item| (item.code, item.id));
        derivation
    }

    /// The box of a primitive.
    fn fitted(&self, id: u32) -> Fitted {
        match self.triangles.get(id as usize) {
            Some(triangle) => {
                let [x, y, z] = &triangle.coordinates;
                let least = |c: &[f32; 3]| c[0].min(c[1]).min(c[2]);
                let most = |c: &[f32; 3]| c[0].max(c[1]).max(c[2]);
                Fitted { lo: [least(x), least(y), least(z)], hi: [most(x), most(y), most(z)] }
            }
            None => {
                let bounds = &self.curved[id as usize - self.triangles.len()];
                Fitted {
                    lo: std::array::from_fn(|a| (bounds.lo[a] - PADDING) as f32),
                    hi: std::array::from_fn(|a| (bounds.hi[a] + PADDING) as f32),
                }
            }
        }
    }

    /// Makes what holds `items[from..to]`, which are of one cell of this level.
    fn cell(&mut self, from: usize, to: usize, level: u32) -> Made {
        let count = to - from;
        if count <= BLOCK || level == LEVELS {
            return Made::Leaf(self.leaf(from, to));
        }
        // What fits into the blocks of one branch is dealt out in order: full blocks are worth more than cells.
        if count <= 8 * BLOCK {
            let blocks = count.div_ceil(BLOCK);
            let mut entries = Entries::NONE;
            for block in 0..blocks {
                let entry = self.leaf(from + count * block / blocks, from + count * (block + 1) / blocks);
                entries.push(entry);
            }
            return Made::Branch(entries);
        }
        let shift = 3 * (LEVELS - 1 - level);
        let octant = |item: &Item| (item.code >> shift & 7) as usize;
        if octant(&self.items[from]) == octant(&self.items[to - 1]) {
            return self.cell(from, to, level + 1);
        }
        let (mut open, mut entries) = ([const { None }; 8], Entries::NONE);
        let (mut opened, mut start) = (0, from);
        while start < to {
            let here = octant(&self.items[start]);
            let end = start + self.items[start..to].partition_point(|item| octant(item) == here);
            match self.cell(start, end, level + 1) {
                Made::Leaf(entry) => entries.push(entry),
                Made::Branch(below) => {
                    open[opened] = Some(below);
                    opened += 1;
                }
            }
            start = end;
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

    fn leaf(&mut self, from: usize, to: usize) -> Entry {
        let items = &mut self.items[from..to];
        // Triangles first.
        items.sort_unstable_by_key(|item| item.id);
        let fitted = self.items[from..to].iter().fold(Fitted::EMPTY, |all, item| all.union(self.fitted(item.id)));
        let ids = self.items[from..to].iter().map(|item| item.id);
        (self.octree.append(self.triangles, ids), fitted)
    }
}

/// Interleaves 21 bits of each coordinate.
fn code(centre: [f32; 3]) -> u64 {
    let spread = |x: f32| {
        let cells = (1u32 << LEVELS) as f32;
        // Saturates; what is not a number is 0.
        let mut bits = (((x + 1.0) * (0.5 * cells)) as u64).min((1 << LEVELS) - 1);
        bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x1249_2492_4924_9249
    };
    spread(centre[0]) | spread(centre[1]) << 1 | spread(centre[2]) << 2
}

/// Asks for so many cache lines from an element on.
#[inline(always)]
fn prefetch_lines<const LINES: usize, T>(all: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    for line in 0..LINES {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let place = all.as_ptr().wrapping_add(index).cast::<i8>().wrapping_add(64 * line);
        // SAFETY: a hint, which never faults; the instruction is SSE's, which every such processor has.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(place) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (all, index);
}
