//! S3-FIFO: three static queues (Yang et al., *FIFO Queues are All You Need for Cache Eviction*, SOSP 2023).

mod ghost;

use self::ghost::Ghost;
use super::Replacement;
use super::queues::Queues;

/// A new line goes into a small queue of a tenth of the ways, and from its end into the main queue if it was hit at least
/// twice, else it is evicted, and its number is remembered by a ghost queue. A line that the ghost remembers goes
/// into the main queue at once. The main queue is a clock whose counters reach 3.
///
/// Every hit counts, repeated ones too.
///
/// The same victims as those of libCacheSim's S3FIFO.c with its default parameters, in version 0.3.5 of its Python package: until a
/// set evicts for the first time, its lines go into the main queue when the small one is full. With fewer than 20 ways
/// libCacheSim places nothing at all (it admits only what is smaller than the small queue, and below 10 ways it ends with an error),
/// which no memory can do. The small queue has at least one line here, and the rest is the same.
#[derive(Debug)]
pub struct S3Fifo {
    ways: u32,
    small_lines: u32,
    main_lines: u32,
    /// By slot, hits since its line came into its queue, up to [`FREQUENCY_MAX`].
    frequency: Vec<u8>,
    /// By slot.
    lines: Vec<u32>,
    /// By set, its small queue and its main one.
    queues: Queues,
    sets: Vec<Set>,
    ghost: Ghost,
    /// The line that was evicted from a small queue for the one that is to be filled. The ghost remembers it only then: if the
    /// new line is in the ghost, it makes room for this one.
    demoted: Option<u32>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Set {
    small: u32,
    main: u32,
    has_evicted: bool,
}

/// Of a set's ways.
pub(crate) const SMALL_SHARE: f64 = 0.1;
/// Of a set's ways, as many lines are remembered.
pub(crate) const GHOST_SHARE: f64 = 0.9;
pub(crate) const HITS_TO_MAIN: u8 = 2;
pub(crate) const FREQUENCY_MAX: u8 = 3;

impl Replacement for S3Fifo {
    const REPEATED_HITS_COUNT: bool = true;

    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        let share = |share: f64| (f64::from(ways) * share) as u32;
        let slots = (sets * ways) as usize;
        let small_lines = share(SMALL_SHARE).max(1);
        Self {
            ways,
            small_lines,
            main_lines: ways - small_lines,
            frequency: vec![0; slots],
            lines: vec![0; slots],
            queues: Queues::new(2 * sets, sets * ways),
            sets: vec![Set::default(); sets as usize],
            ghost: Ghost::new(sets, share(GHOST_SHARE)),
            demoted: None,
        }
    }

    #[inline(always)]
    fn hit(&mut self, slot: u32) {
        let frequency = &mut self.frequency[slot as usize];
        *frequency = (*frequency + 1).min(FREQUENCY_MAX);
    }

    fn victim(&mut self, set: u32) -> u32 {
        self.sets[set as usize].has_evicted = true;
        loop {
            let Set { small, main, .. } = self.sets[set as usize];
            let victim = if main > self.main_lines || small == 0 {
                self.evict_from_main(set)
            } else {
                self.evict_from_small(set)
            };
            if let Some(slot) = victim {
                return slot;
            }
        }
    }

    fn fill(&mut self, slot: u32, line: u32) {
        let set = slot / self.ways;
        let is_remembered = self.ghost.forget(set, line);
        if let Some(demoted) = self.demoted.take() {
            self.ghost.remember(set, demoted);
        }
        self.lines[slot as usize] = line;
        self.frequency[slot as usize] = 0;
        let Set { small, has_evicted, .. } = self.sets[set as usize];
        if is_remembered || (!has_evicted && small >= self.small_lines) {
            self.push_main(set, slot);
        } else {
            self.queues.push(small_of(set), slot);
            self.sets[set as usize].small += 1;
        }
    }
}

impl S3Fifo {
    fn push_main(&mut self, set: u32, slot: u32) {
        self.queues.push(main_of(set), slot);
        self.sets[set as usize].main += 1;
    }

    /// The first line that was not hit often; those before it go into the main queue. `None`: all did.
    fn evict_from_small(&mut self, set: u32) -> Option<u32> {
        while let Some(slot) = self.queues.pop(small_of(set)) {
            self.sets[set as usize].small -= 1;
            if self.frequency[slot as usize] < HITS_TO_MAIN {
                self.demoted = Some(self.lines[slot as usize]);
                return Some(slot);
            }
            self.frequency[slot as usize] = 0;
            self.push_main(set, slot);
        }
        None
    }

    fn evict_from_main(&mut self, set: u32) -> Option<u32> {
        while let Some(slot) = self.queues.pop(main_of(set)) {
            let frequency = &mut self.frequency[slot as usize];
            if *frequency == 0 {
                self.sets[set as usize].main -= 1;
                return Some(slot);
            }
            *frequency -= 1;
            self.queues.push(main_of(set), slot);
        }
        None
    }
}

fn small_of(set: u32) -> u32 {
    2 * set
}

fn main_of(set: u32) -> u32 {
    2 * set + 1
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::misses;
    use super::*;

    /// A set as three lists, the oldest first.
    #[derive(Clone, Default)]
    struct Lists {
        small: Vec<(u32, u32)>,
        main: Vec<(u32, u32)>,
        ghost: Vec<u32>,
        has_evicted: bool,
    }

    impl Lists {
        fn misses(&mut self, line: u32, ways: usize) -> bool {
            let (small_lines, ghost_lines) = ((ways / 10).max(1), ways * 9 / 10);
            if let Some((_, hits)) = self.small.iter_mut().chain(&mut self.main).find(|(l, _)| *l == line) {
                *hits += 1;
                return false;
            }
            let is_remembered = self.ghost.contains(&line);
            self.ghost.retain(|l| *l != line);
            while self.small.len() + self.main.len() == ways {
                self.has_evicted = true;
                if self.main.len() > ways - small_lines || self.small.is_empty() {
                    let (first, hits) = self.main.remove(0);
                    if hits > 0 {
                        self.main.push((first, hits.min(3) - 1));
                    }
                    continue;
                }
                // The main queue may get too long meanwhile.
                let kept = self.small.iter().take_while(|(_, hits)| *hits >= 2).count();
                self.main.extend(self.small.drain(..kept).map(|(line, _)| (line, 0)));
                if !self.small.is_empty() {
                    self.ghost.push(self.small.remove(0).0);
                    let forgotten = self.ghost.len().saturating_sub(ghost_lines);
                    self.ghost.drain(..forgotten);
                }
            }
            let full = !self.has_evicted && self.small.len() >= small_lines;
            let queue = if is_remembered || full { &mut self.main } else { &mut self.small };
            queue.push((line, 0));
            true
        }
    }

    fn lists(sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let mut lists = vec![Lists::default(); sets as usize];
        references.iter().map(|&line| lists[(line % sets) as usize].misses(line, ways as usize)).collect()
    }

    #[test]
    fn by_hand() {
        // Ten ways: one line in the small queue, nine in the main one. 1 is in the small queue, 2 to 10 fill the main one. 1 is
        // hit once, so that 11 evicts it; the ghost has 1. 12 evicts 11, 1 evicts 12 and goes into the main queue, which has one
        // line too many: 13 evicts 2, its oldest one. 13 is hit twice: it moves to the main queue for 14, which evicts 3.
        let fill: Vec<u32> = (1..=10).collect();
        let references = [&fill[..], &[1, 11, 12, 1, 13, 13, 13, 14, 4, 13, 1, 3]].concat();
        let missing: Vec<u32> = references
            .iter()
            .zip(misses::<S3Fifo>(1, 10, &references))
            .filter(|(_, miss)| *miss)
            .map(|(line, _)| *line)
            .collect();
        assert_eq!(missing, [&fill[..], &[11, 12, 1, 13, 14, 3]].concat());
    }

    #[test]
    fn shares_are_rounded_down() {
        let lines = |ways| {
            let policy = S3Fifo::new(1, ways, 0);
            (policy.small_lines, policy.main_lines)
        };
        assert_eq!([1, 9, 10, 19, 20, 29, 30].map(lines), [(1, 0), (1, 8), (1, 9), (1, 18), (2, 18), (2, 27), (3, 27)]);
    }

    proptest! {
        #[test]
        fn agrees_with_lists(
            references in prop::collection::vec((0u32..64, 1usize..4), 0..600), sets in 1u32..6, ways in 1u32..33,
        ) {
            let references: Vec<u32> = references.into_iter().flat_map(|(line, times)| vec![line; times]).collect();
            prop_assert_eq!(misses::<S3Fifo>(sets, ways, &references), lists(sets, ways, &references));
        }
    }
}
