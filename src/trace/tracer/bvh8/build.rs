//! How the hierarchy is built from the primitives of a database.
//!
//! Primitives are sorted by the Morton code of their box's centre (G. M. Morton, 1966), so that each cell of an octree is a range of
//! them, as in C. Lauterbach et al., *Fast BVH Construction on GPUs*, 2009. A branch takes the children of its largest branch for its
//! own until it has eight, and orders them by octant (H. Ylitie, T. Karras, S. Laine, *Efficient Incoherent Ray Traversal on GPUs
//! Through Compressed Wide BVHs*, 2017). What fits into the blocks of one branch is dealt out to full blocks.

use super::fitted::{Boxes, Fitted};
use super::tree::{BLOCK, Branch, Bvh8, Child};
use crate::database::verify::Verified;

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

/// A primitive on its way to a leaf.
#[derive(Clone, Copy)]
struct Item {
    /// Interleaved bits of the centre of its box, x the lowest: the cells of an octree, from the root's octant down.
    code: u64,
    id: u32,
}

/// Levels that a code tells apart.
pub(super) const LEVELS: u32 = 21;

struct Builder<'a> {
    boxes: Boxes<'a>,
    bvh: Bvh8,
    items: Vec<Item>,
}

impl Bvh8 {
    /// Builds it from a database's primitives.
    pub fn build(database: &Verified) -> Self {
        let boxes = Boxes::new(database);
        let ids = 0..boxes.count() as u32;
        let mut items: Vec<Item> = ids.map(|id| Item { code: code(boxes.of(id).centre()), id }).collect();
        items.sort_unstable_by_key(|item| (item.code, item.id));
        let all = items.len();
        let bvh = Bvh8::with_room(boxes.triangles.len(), all);
        let mut builder = Builder { boxes, bvh, items };
        if all > 0 {
            builder.bvh.root = match builder.cell(0, all, 0) {
                Made::Leaf((leaf, _)) => leaf,
                Made::Branch(below) => builder.place_branch(&below).0,
            };
        }
        builder.bvh.shrink();
        builder.bvh
    }
}

impl Builder<'_> {
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
        let mut branch = Branch::EMPTY;
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
            branch.put(octant, child, fitted);
        }
        (self.bvh.add_branch(branch), whole)
    }

    fn leaf(&mut self, from: usize, to: usize) -> Entry {
        if self.boxes.are_of_kinds() {
            // Triangles first.
            self.items[from..to].sort_unstable_by_key(|item| item.id);
        }
        let fitted = self.items[from..to].iter().fold(Fitted::EMPTY, |all, item| all.union(self.boxes.of(item.id)));
        let ids = self.items[from..to].iter().map(|item| item.id);
        (self.bvh.add_leaf(self.boxes.triangles, ids), fitted)
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
