//! A sequence that is cut in two and put together again: a treap (Aragon and Seidel 1989).

const NONE: u32 = u32::MAX;

const LEFT: usize = 0;
const RIGHT: usize = 1;

/// A part of a sequence: the root of its tree.
#[derive(Clone, Copy)]
pub(super) struct Part(u32);

/// A sequence of numbers below n, each there once at the most.
pub(super) struct Sequence {
    /// Of every number, and at last two whose right child is the root of a part that is being made.
    children: Vec<[u32; 2]>,
    root: u32,
}

impl Sequence {
    pub(super) fn new(n: usize) -> Self {
        Self { children: vec![[NONE; 2]; n + 2], root: NONE }
    }

    pub(super) fn all(&self) -> Part {
        Part(self.root)
    }

    /// Cuts a part into those before the first of which `is_before` is false, and the rest. `steps` counts
    /// those that it is asked about.
    pub(super) fn split(&mut self, part: Part, steps: &mut u64, is_before: impl Fn(u32) -> bool) -> (Part, Part) {
        let heads = [self.children.len() - 2, self.children.len() - 1];
        // Where the next of each side goes.
        let (mut before, mut after) = ((heads[0], RIGHT), (heads[1], RIGHT));
        let mut rest = part.0;
        while rest != NONE {
            *steps += 1;
            if is_before(rest) {
                self.children[before.0][before.1] = rest;
                before = (rest as usize, RIGHT);
                rest = self.children[rest as usize][RIGHT];
            } else {
                self.children[after.0][after.1] = rest;
                after = (rest as usize, LEFT);
                rest = self.children[rest as usize][LEFT];
            }
        }
        self.children[before.0][before.1] = NONE;
        self.children[after.0][after.1] = NONE;
        (Part(self.children[heads[0]][RIGHT]), Part(self.children[heads[1]][RIGHT]))
    }

    /// Makes one sequence of two parts and what comes between them.
    pub(super) fn join(&mut self, before: Part, between: &[u32], after: Part) {
        let mut part = before;
        for &number in between {
            self.children[number as usize] = [NONE; 2];
            part = self.merge(part, Part(number));
        }
        self.root = self.merge(part, after).0;
    }

    pub(super) fn first(&self, part: Part) -> Option<u32> {
        self.outermost(part, LEFT)
    }

    pub(super) fn last(&self, part: Part) -> Option<u32> {
        self.outermost(part, RIGHT)
    }

    /// Every number of a part in order.
    pub(super) fn walk(&self, part: Part, mut each: impl FnMut(u32)) {
        let (mut at, mut ancestors) = (part.0, Vec::new());
        while at != NONE || !ancestors.is_empty() {
            while at != NONE {
                ancestors.push(at);
                at = self.children[at as usize][LEFT];
            }
            let Some(number) = ancestors.pop() else { return };
            each(number);
            at = self.children[number as usize][RIGHT];
        }
    }

    fn outermost(&self, part: Part, side: usize) -> Option<u32> {
        let child = |at: &u32| Some(self.children[*at as usize][side]).filter(|&child| child != NONE);
        std::iter::successors(Some(part.0).filter(|&root| root != NONE), child).last()
    }

    fn merge(&mut self, before: Part, after: Part) -> Part {
        let (mut before, mut after) = (before.0, after.0);
        let head = self.children.len() - 1;
        let mut to = (head, RIGHT);
        while before != NONE && after != NONE {
            let (higher, side) = if rank(before) > rank(after) { (before, RIGHT) } else { (after, LEFT) };
            self.children[to.0][to.1] = higher;
            to = (higher as usize, side);
            let rest = if side == RIGHT { &mut before } else { &mut after };
            *rest = self.children[higher as usize][side];
        }
        self.children[to.0][to.1] = if before == NONE { after } else { before };
        Part(self.children[head][RIGHT])
    }
}

/// The higher, the closer to the root; no two are equal. As good as random, which keeps trees shallow.
fn rank(number: u32) -> u64 {
    // The finalizer of SplitMix64, which is a bijection.
    let mut x = (u64::from(number) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn numbers(sequence: &Sequence, part: Part) -> Vec<u32> {
        let mut numbers = Vec::new();
        sequence.walk(part, |number| numbers.push(number));
        numbers
    }

    proptest! {
        #[test]
        fn what_is_cut_and_put_together_is_in_order(cuts in prop::collection::vec((0u32..100, 0u32..100), 1..50)) {
            let mut sequence = Sequence::new(100);
            let mut expected: Vec<u32> = Vec::new();
            for (at, number) in cuts {
                // All below `at` are left of it; those up to `number` are taken out, and then one is put in.
                let (before, rest) = sequence.split(sequence.all(), &mut 0, |n| n < at);
                let (_, after) = sequence.split(rest, &mut 0, |n| n <= number);
                let between: Vec<u32> = (at <= number).then_some(number).into_iter().collect();
                prop_assert_eq!(sequence.last(before), expected.iter().rfind(|&&n| n < at).copied());
                sequence.join(before, &between, after);
                expected.retain(|&n| n < at || n > number);
                expected.extend(&between);
                expected.sort_unstable();
                prop_assert_eq!(numbers(&sequence, sequence.all()), &expected[..]);
                prop_assert_eq!(sequence.first(sequence.all()), expected.first().copied());
            }
        }
    }
}
