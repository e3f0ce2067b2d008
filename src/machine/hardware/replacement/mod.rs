//! Which line of a full set is evicted. A hit is O(1); a victim is too,
//! amortised over references, but for LRU's logarithm.

mod clock;
mod fifo;
mod lru;
mod plru;
pub(crate) mod queues;
mod random;
pub(crate) mod s3_fifo;
mod sieve;
mod srrip;

pub use clock::{Clock, Clock0};
pub use fifo::Fifo;
pub use lru::Lru;
pub use plru::Plru;
pub use random::Random;
pub use s3_fifo::S3Fifo;
pub use sieve::Sieve;
pub use srrip::Srrip;

/// A replacement policy for all sets of a memory. The slots of set `s` are `s · ways` to
/// `s · ways + ways − 1`; empty ones are filled in ascending order before there is a victim, and so are those, later, whose line
/// is invalidated.
///
/// # Contract
/// Unless [`Self::REPEATED_HITS_COUNT`] is true, a hit on the line that was hit last, with nothing in between, changes nothing:
/// [`Self::hit`] of the same slot again leaves all later victims as they are. A replay leaves such a call out, and a local memory
/// does not, so that only a policy that keeps this has the same misses in both. A policy that counts each hit, such as LFU, says so
/// by that constant, and replays call it for every hit.
pub trait Replacement {
    /// Whether a hit that is repeated at once may change a later victim. False for most policies, whose replays are faster.
    const REPEATED_HITS_COUNT: bool = false;

    /// For `sets` sets of `ways` slots, none filled; `seed` decides what is random.
    fn new(sets: u32, ways: u32, seed: u64) -> Self;

    /// The line in `slot` was referenced. Repeated at once, it changes nothing, unless [`Self::REPEATED_HITS_COUNT`].
    fn hit(&mut self, slot: u32);

    /// The slot of a full set whose line is evicted, one of that set's. [`Self::fill`] of the same slot follows.
    fn victim(&mut self, set: u32) -> u32;

    /// `line` of the image was placed in `slot`, which was empty or the victim.
    fn fill(&mut self, slot: u32, line: u32);
}

/// Evaluates an expression in which `$policy` names the type of the policy that a specification asks for: compiled once
/// for each of them.
#[macro_export]
macro_rules! with_policy {
    ($specification:expr, $policy:ident => $body:expr) => {
        $crate::with_policy!(@match $specification, $policy => $body; Lru, Fifo, Clock, Random, Clock0, Srrip, Sieve, S3Fifo, Plru)
    };
    (@match $specification:expr, $policy:ident => $body:expr; $($name:ident),+) => {
        match $specification {
            $($crate::hardware::specification::Replacement::$name => {
                type $policy = $crate::hardware::replacement::$name;
                $body
            })+
        }
    };
}

pub use with_policy;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::hardware::local_memory::{Directory, Reference, Slots};

    /// Belady's string, on which FIFO misses more with four frames than with three.
    const BELADY: [u32; 12] = [1, 2, 3, 4, 1, 2, 5, 1, 2, 3, 4, 5];
    /// From Stallings, *Operating Systems*, the comparison of page replacement algorithms: on three frames
    /// LRU has 4 faults after the first three, clock 5, FIFO 6.
    const STALLINGS: [u32; 12] = [2, 3, 2, 1, 5, 2, 4, 5, 3, 2, 5, 2];

    /// Of lines below this.
    pub(super) const LINES: u32 = 16384;

    /// Per reference whether it missed.
    pub(super) fn misses<R: Replacement>(sets: u32, ways: u32, references: &[u32]) -> Vec<bool> {
        let mut directory = Directory::<R>::new(Slots { sets, ways }, LINES, 1);
        references.iter().map(|&line| matches!(directory.reference(line), Reference::Miss { .. })).collect()
    }

    fn count<R: Replacement>(ways: u32, references: &[u32]) -> usize {
        misses::<R>(1, ways, references).into_iter().filter(|&miss| miss).count()
    }

    /// Misses of sets that are lists of resident lines: the first is the victim, and `renew` says whether a
    /// hit moves its line to the end.
    pub(super) fn model(sets: u32, ways: u32, references: &[u32], renew: bool) -> Vec<bool> {
        let mut resident = vec![Vec::new(); sets as usize];
        let miss = |&line: &u32| {
            let set = &mut resident[(line % sets) as usize];
            let place = set.iter().position(|&l| l == line);
            match place {
                Some(place) if renew => {
                    set.remove(place);
                    set.push(line);
                }
                Some(_) => {}
                None => {
                    if set.len() == ways as usize {
                        set.remove(0);
                    }
                    set.push(line);
                }
            }
            place.is_none()
        };
        references.iter().map(miss).collect()
    }

    #[test]
    fn beladys_string() {
        assert_eq!([count::<Fifo>(3, &BELADY), count::<Fifo>(4, &BELADY)], [9, 10]);
        assert_eq!([count::<Lru>(3, &BELADY), count::<Lru>(4, &BELADY)], [10, 8]);
        // By hand: with all reference bits set, the hand goes round once and clock is FIFO here.
        assert_eq!([count::<Clock>(3, &BELADY), count::<Clock>(4, &BELADY)], [9, 10]);
        // By hand: with three frames 1 and 2 are hit after 5, so that 3 replaces 5 and not 1; with four they are hit before
        // it, and stay to the end.
        assert_eq!([count::<Clock0>(3, &BELADY), count::<Clock0>(4, &BELADY)], [10, 8]);
    }

    #[test]
    fn stallings_string() {
        assert_eq!(count::<Lru>(3, &STALLINGS), 3 + 4);
        assert_eq!(count::<Clock>(3, &STALLINGS), 3 + 5);
        assert_eq!(count::<Fifo>(3, &STALLINGS), 3 + 6);
    }

    #[test]
    fn what_fits_misses_once() {
        let twice: Vec<u32> = (0..16).chain(0..16).collect();
        let all = [
            count::<Lru>,
            count::<Fifo>,
            count::<Clock>,
            count::<Clock0>,
            count::<Random>,
            count::<Srrip>,
            count::<Sieve>,
            count::<S3Fifo>,
            count::<Plru>,
        ];
        for misses in all {
            assert_eq!(misses(16, &twice), 16);
        }
    }

    /// Per reference whether it missed, when a hit is repeated at once: `repeats` times, twice as often, or not, in turn.
    fn misses_of_repeated<R: Replacement>(ways: u32, references: &[u32], repeats: usize) -> Vec<bool> {
        let mut directory = Directory::<R>::new(Slots { sets: 2, ways }, LINES, 1);
        let missed = |(i, &line): (usize, &u32)| match directory.reference(line) {
            Reference::Miss { .. } => true,
            Reference::Hit { slot } => {
                (0..repeats * (i % 3)).for_each(|_| directory.hit(slot));
                false
            }
        };
        references.iter().enumerate().map(missed).collect()
    }

    /// Counts hits, and declares it.
    struct Counting {
        ways: u32,
        hits: Vec<u32>,
    }

    impl Replacement for Counting {
        const REPEATED_HITS_COUNT: bool = true;

        fn new(sets: u32, ways: u32, _seed: u64) -> Self {
            Self { ways, hits: vec![0; (sets * ways) as usize] }
        }

        fn hit(&mut self, slot: u32) {
            self.hits[slot as usize] += 1;
        }

        fn victim(&mut self, set: u32) -> u32 {
            let slots = set * self.ways..(set + 1) * self.ways;
            slots.min_by_key(|&slot| self.hits[slot as usize]).expect("at least one way")
        }

        fn fill(&mut self, slot: u32, _line: u32) {
            self.hits[slot as usize] = 0;
        }
    }

    /// Whether any number of repeated hits gives other misses than none.
    fn counts<R: Replacement>(ways: u32, references: &[u32]) -> bool {
        let once = misses_of_repeated::<R>(ways, references, 0);
        (1..4).any(|repeats| misses_of_repeated::<R>(ways, references, repeats) != once)
    }

    #[test]
    fn s3_fifo_counts_repeated_hits() {
        // Two ways of set 0: 0 is in the small queue, 2 in the main one. Hit once, 0 is evicted for 4; hit more often, it moves to
        // the main queue, and 2 is evicted.
        assert!(counts::<S3Fifo>(2, &[0, 0, 2, 4, 0]));
    }

    #[test]
    fn a_policy_that_counts_hits_has_to_declare_it() {
        assert!(counts::<Counting>(2, &[0, 2, 0, 2, 4, 0]));
    }

    proptest! {
        #[test]
        fn a_hit_that_is_repeated_changes_nothing(
            references in prop::collection::vec(0u32..24, 0..300), ways in 1u32..9, repeats in 1usize..4,
        ) {
            let all = [misses_of_repeated::<Lru>, misses_of_repeated::<Fifo>, misses_of_repeated::<Clock>,
                       misses_of_repeated::<Random>, misses_of_repeated::<Clock0>, misses_of_repeated::<Srrip>,
                       misses_of_repeated::<Sieve>];
            for policy in all {
                prop_assert_eq!(policy(ways, &references, repeats), policy(ways, &references, 0));
            }
            let (plru, ways) = (misses_of_repeated::<Plru>, ways.next_power_of_two());
            prop_assert_eq!(plru(ways, &references, repeats), plru(ways, &references, 0));
        }

        #[test]
        fn a_larger_lru_memory_never_misses_more(
            references in prop::collection::vec(0u32..64, 0..400), ways in 1u32..16, more in 1u32..16,
        ) {
            let (small, large) = (misses::<Lru>(1, ways, &references), misses::<Lru>(1, ways + more, &references));
            // Inclusion: what hits in the smaller memory hits in the larger one.
            prop_assert!(small.iter().zip(&large).all(|(small, large)| small >= large));
        }
    }
}
