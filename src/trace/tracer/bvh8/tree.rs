//! The bounding volume hierarchy itself: branches that know the boxes of what is below their eight children, leaves that have
//! their triangles side by side.

use super::fitted::{Boxes, Fitted};
use crate::database::records::Triangle;
use crate::database::verify::Verified;

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

impl Branch {
    /// Without children.
    pub(super) const EMPTY: Self = {
        let (lower, upper) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
        Self { planes: [lower, lower, lower, upper, upper, upper], children: [Child::EMPTY; 8] }
    };

    pub(super) fn put(&mut self, octant: usize, child: Child, fitted: Fitted) {
        self.children[octant] = child;
        for axis in 0..3 {
            self.planes[axis][octant] = fitted.lo[axis] - MARGIN;
            self.planes[axis + 3][octant] = fitted.hi[axis] + MARGIN;
        }
    }

    fn widen(&mut self, octant: usize, fitted: Fitted) {
        for axis in 0..3 {
            let (lower, upper) = (fitted.lo[axis] - MARGIN, fitted.hi[axis] + MARGIN);
            self.planes[axis][octant] = self.planes[axis][octant].min(lower);
            self.planes[axis + 3][octant] = self.planes[axis + 3][octant].max(upper);
        }
    }
}

/// A leaf's triangles, up to [`BLOCK`], side by side.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
    /// Nine coordinates by axis and vertex, then ids, then polygons: `count` words each, and some beyond.
    pub words: &'a [u32],
    pub count: usize,
}

/// A bounding volume hierarchy of eight children per branch, with the triangles of its leaves in blocks.
#[derive(Clone, Debug)]
pub struct Bvh8 {
    branches: Vec<Branch>,
    /// A leaf is its number of triangles and of spheres and cones, its blocks, and the ids of the latter.
    leaves: Vec<u32>,
    pub(super) root: Child,
}

/// Words of a triangle in a block.
const ROWS: usize = 11;

impl Bvh8 {
    /// Empty, with room for the leaves of so many triangles, and primitives in all.
    pub(super) fn with_room(triangles: usize, primitives: usize) -> Self {
        let mut leaves = Vec::with_capacity(ROWS * triangles + primitives + BLOCK);
        // So many words may be read beyond the last row.
        leaves.resize(BLOCK, 0);
        Self { branches: Vec::new(), leaves, root: Child::EMPTY }
    }

    /// Gives back the room that was not needed.
    pub(super) fn shrink(&mut self) {
        self.branches.shrink_to_fit();
        self.leaves.shrink_to_fit();
    }

    /// Adds a branch; its children have their places already.
    pub(super) fn add_branch(&mut self, branch: Branch) -> Child {
        self.branches.push(branch);
        Child(self.branches.len() as u32 - 1)
    }

    /// Gives the leaf at the end of a path of octants from the root on other primitives, triangles first: none to empty it.
    /// Boxes on the way grow as they must; the words of the former leaf stay unused.
    ///
    /// # Panics
    /// There is no leaf or empty place at the end of the path.
    pub fn replace(&mut self, database: &Verified, path: &[usize], ids: &[u32]) {
        let primitives = Boxes::new(database);
        let fitted = ids.iter().fold(Fitted::EMPTY, |all, &id| all.union(primitives.of(id)));
        let (&last, above) = path.split_last().expect("the root is no leaf of a branch");
        let mut child = self.root;
        for &octant in above {
            let branch = &mut self.branches[child.index()];
            branch.widen(octant, fitted);
            child = branch.children[octant];
        }
        let leaf = if ids.is_empty() { Child::EMPTY } else { self.add_leaf(primitives.triangles, ids.iter().copied()) };
        let branch = &mut self.branches[child.index()];
        assert!(branch.children[last].is_leaf(), "not a leaf");
        branch.put(last, leaf, fitted);
    }

    /// Adds a leaf; ids of triangles come first.
    pub(super) fn add_leaf(&mut self, all: &[Triangle], ids: impl Iterator<Item = u32> + Clone) -> Child {
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

    /// The paths to all leaves, for [`Self::replace`], and their triangles.
    #[cfg(test)]
    pub(super) fn leaf_paths(&self) -> Vec<(Vec<usize>, Vec<u32>)> {
        let (mut found, mut rest) = (Vec::new(), vec![(Vec::new(), self.root)]);
        while let Some((path, child)) = rest.pop() {
            if child == Child::EMPTY {
            } else if child.is_leaf() {
                let (blocks, curved) = self.leaf(child);
                let mut ids: Vec<u32> = blocks.flat_map(|b| (0..b.count).map(move |at| b.id(at))).collect();
                ids.extend(curved);
                found.push((path, ids));
            } else {
                let below = self.branch(child).children.into_iter().enumerate();
                rest.extend(below.map(|(octant, child)| ([&path[..], &[octant]].concat(), child)));
            }
        }
        found
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
