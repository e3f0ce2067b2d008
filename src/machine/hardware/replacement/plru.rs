//! Tree pseudo-LRU, as the caches of many processors have it (Handy, *The Cache Memory Book*, 1993).

use super::Replacement;

/// The ways of a set are the leaves of a binary tree, each node of which has a bit that says in which half the next victim is. A
/// reference to a line sets the nodes above it to the other halves. The ways are a power of two.
///
/// Six levels of the tree are a word, so that a reference changes one word for every 64 ways, 64² ways and so on.
#[derive(Debug)]
pub struct Plru {
    /// From the leaves to the root.
    storeys: Vec<Storey>,
}

/// Up to six levels of the trees of all sets.
#[derive(Debug)]
struct Storey {
    /// 1 to 6.
    levels: u32,
    /// By subtree: bit `n` is node `n` in heap order; 1 is the root, and node `n` has the children `2n` and `2n + 1`.
    words: Vec<u64>,
}

/// Levels of a word.
const LEVELS: u32 = 6;
const LEAVES: usize = 1 << LEVELS;
/// By leaf of a word, the nodes above it.
const PATHS: [u64; LEAVES] = nodes_above(false);
/// By leaf of a word, those of its nodes that a reference to it sets to 1: the leaf is in their lower half.
const LOWER: [u64; LEAVES] = nodes_above(true);

const fn nodes_above(lower_only: bool) -> [u64; LEAVES] {
    let mut nodes = [0; LEAVES];
    let mut leaf = 0;
    while leaf < LEAVES {
        let mut node = LEAVES + leaf;
        while node > 1 {
            if !lower_only || node.is_multiple_of(2) {
                nodes[leaf] |= 1 << (node / 2);
            }
            node /= 2;
        }
        leaf += 1;
    }
    nodes
}

impl Replacement for Plru {
    /// Geometries that are resolved for this policy have a power of two of ways. Where fewer than these can be filled, a set has no
    /// victim, and needs no tree.
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        let mut subtrees = sets as usize * ways as usize;
        let mut left = if ways.is_power_of_two() { ways.trailing_zeros() } else { 0 };
        let mut storeys = Vec::new();
        while left > 0 {
            let levels = left.min(LEVELS);
            subtrees >>= levels;
            storeys.push(Storey { levels, words: vec![0; subtrees] });
            left -= levels;
        }
        Self { storeys }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        // The slots of a set follow each other, so that a slot's number is a path through its set's tree, the leaf's levels lowest.
        let mut path = slot as usize;
        for storey in &mut self.storeys {
            // In a word of fewer levels, those below its leaves have no meaning.
            let leaf = (path << (LEVELS - storey.levels)) % LEAVES;
            path >>= storey.levels;
            let word = &mut storey.words[path];
            *word = *word & !PATHS[leaf] | LOWER[leaf];
        }
    }

    fn victim(&mut self, set: u32) -> u32 {
        let mut path = set as usize;
        for storey in self.storeys.iter().rev() {
            let word = storey.words[path];
            let mut node = 1;
            for _ in 0..storey.levels {
                node = 2 * node + (word >> node & 1) as usize;
            }
            path = (path << storey.levels) + node - (1 << storey.levels);
        }
        path as u32
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        self.hit(slot);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::misses;
    use super::*;

    /// Sets as arrays of ways, with a tree of nodes that are visited one by one.
    fn trees(sets: u32, ways: usize, references: &[u32]) -> Vec<bool> {
        let mut all = vec![(Vec::<u32>::new(), vec![false; ways]); sets as usize];
        let miss = |&line: &u32| {
            let (lines, victim_is_above) = &mut all[(line % sets) as usize];
            let found = lines.iter().position(|l| *l == line);
            let way = found.unwrap_or_else(|| {
                if lines.len() < ways {
                    lines.push(line);
                    return lines.len() - 1;
                }
                let (mut first, mut count, mut node) = (0, ways, 1);
                while count > 1 {
                    count /= 2;
                    let above = victim_is_above[node];
                    first += if above { count } else { 0 };
                    node = 2 * node + usize::from(above);
                }
                lines[first] = line;
                first
            });
            let (mut first, mut count, mut node) = (0, ways, 1);
            while count > 1 {
                count /= 2;
                let above = way >= first + count;
                victim_is_above[node] = !above;
                first += if above { count } else { 0 };
                node = 2 * node + usize::from(above);
            }
            found.is_none()
        };
        references.iter().map(miss).collect()
    }

    #[test]
    fn by_hand() {
        // Four ways are filled with 1, 2, 3, 4; 1 is hit. The root points to the upper half, whose node points to 3, since 4
        // came last: 5 evicts 3, where LRU evicts 2. Then the root points to the lower half, whose node points to 2.
        let references = [1, 2, 3, 4, 1, 5, 2, 3, 1];
        let expected = [true, true, true, true, false, true, false, true, false];
        assert_eq!(misses::<Plru>(1, 4, &references), expected);
    }

    #[test]
    fn a_memory_that_is_larger_than_the_database_needs_no_tree() {
        let twice: Vec<u32> = (0..12).chain(0..12).collect();
        assert_eq!(misses::<Plru>(1, 12, &twice), [[true; 12], [false; 12]].concat());
    }

    proptest! {
        #[test]
        fn agrees_with_trees_of_nodes(
            references in prop::collection::vec(0u32..64, 0..600), sets in 1u32..6, levels in 0u32..6,
        ) {
            prop_assert_eq!(misses::<Plru>(sets, 1 << levels, &references), trees(sets, 1 << levels, &references));
        }

        /// Several words a tree.
        #[test]
        fn agrees_with_trees_of_many_ways(
            steps in prop::collection::vec((0u32..6000, 1u32..2500), 1..12), sets in 1u32..4, levels in 6u32..13,
        ) {
            let references: Vec<u32> = steps.iter().flat_map(|&(first, count)| first..first + count).collect();
            prop_assert_eq!(misses::<Plru>(sets, 1 << levels, &references), trees(sets, 1 << levels, &references));
        }
    }
}
