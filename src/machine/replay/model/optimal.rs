//! The least that a memory can miss: Belady's optimum (*A study of replacement algorithms for a virtual-storage
//! computer*, 1966).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::hardware::local_memory::{Geometry, GeometryError};
use crate::replay::model::next_use::{NextUses, Uses};
use crate::replay::model::replayer::Counters;
use crate::replay::stream::placement::Placement;
use crate::replay::{Lines, Trace, TraceError};

/// What memories count that know the future: the line that gives way is the one of its set that is used last, or never
/// again. Every line that is missing is placed, as all memories of nodes do. One process, as for
/// [`curve`](crate::replay::model::curve::curve()); the results are in the order of `geometries`.
///
/// No memory of the same sets and ways misses fewer lines. Fetches are no fewer than with other victims only where
/// each record lies in one line: a fetch of two lines costs no more than one of them.
///
/// # Errors
/// Those of [`NextUses`]; a memory of more slots than can be simulated.
///
/// # Panics
/// A geometry is that of other lines.
pub fn optimal(
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    lines: &impl Lines,
    geometries: &[Geometry],
) -> Result<Vec<Counters>, TraceError> {
    let memories: Result<Vec<Memory>, _> = geometries.iter().map(|&geometry| Memory::new(geometry, lines)).collect();
    let mut memories = memories?;
    NextUses::new(trace, tiles, lines)?.for_each_part(|uses| {
        for memory in &mut memories {
            memory.part(&uses, lines);
        }
    })?;
    Ok(memories.into_iter().map(|memory| memory.totals).collect())
}

struct Memory {
    placement: Placement,
    sets: Vec<Set>,
    ways: usize,
    /// By line.
    resident: Vec<bool>,
    totals: Counters,
}

#[derive(Clone, Default)]
struct Set {
    filled: usize,
    /// By next use, the last first; lines that are never used again before all others.
    ///
    /// A line that is used again is entered again. Its old entry's use is past then, and so that entry comes after
    /// those of all lines that are resident: what comes first is always one of these.
    victims: BinaryHeap<Reverse<(u64, u32)>>,
}

impl Memory {
    fn new(geometry: Geometry, lines: &impl Lines) -> Result<Self, GeometryError> {
        assert_eq!(geometry.database_lines, lines.count(), "a memory's geometry is resolved for its lines");
        let placement = lines.placement(&geometry)?;
        let slots = placement.slots();
        Ok(Self {
            placement,
            sets: vec![Set::default(); slots.sets as usize],
            ways: slots.ways as usize,
            resident: vec![false; lines.count() as usize],
            totals: Counters::default(),
        })
    }

    fn part(&mut self, part: &Uses<'_>, lines: &impl Lines) {
        let (mut record_misses, mut line_misses, mut missed) = (0, 0, None);
        for (left, used) in (1..=part.left).rev().zip(part.uses) {
            let set = &mut self.sets[self.placement.set(used.line, |sets| lines.set(used.line, sets)) as usize];
            if !std::mem::replace(&mut self.resident[used.line as usize], true) {
                line_misses += 1;
                if missed != Some(used.record) {
                    missed = Some(used.record);
                    record_misses += 1;
                }
                if set.filled < self.ways {
                    set.filled += 1;
                } else if let Some(Reverse((_, victim))) = set.victims.pop() {
                    self.resident[victim as usize] = false;
                }
            }
            set.victims.push(Reverse((used.next, used.line)));
            if set.victims.len() > 2 * self.ways + 16 {
                set.victims.retain(|Reverse((next, _))| *next < left);
            }
        }
        if part.accepted {
            self.totals.add(&Counters {
                record_accesses: part.record_accesses,
                record_misses,
                line_accesses: part.line_accesses,
                line_misses,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::hardware::replacement::{Clock, Clock0, Fifo, Lru, Random, Replacement, S3Fifo, Sieve, Srrip};
    use crate::replay::model::replayer::{Replayer, Sum};
    use crate::replay::stream::reads::tests::{Overlapping, Single, captured};

    fn geometry(lines: &impl Lines, sets: u64, ways: u64) -> Geometry {
        Geometry { line_bytes: 16, database_lines: lines.count(), sets, ways }
    }

    fn line_misses(string: &[u32], ways: std::ops::RangeInclusive<u64>) -> Vec<u64> {
        let lines = Single(64);
        let geometries: Vec<_> = ways.map(|ways| geometry(&lines, 1, ways)).collect();
        let totals = optimal(&captured(&[string], 4), &[0], &lines, &geometries).expect("sound");
        totals.iter().map(|totals| totals.line_misses).collect()
    }

    #[test]
    fn strings_from_books() {
        // Belady's own: 7 faults with three frames, 6 with four.
        assert_eq!(line_misses(&[1, 2, 3, 4, 1, 2, 5, 1, 2, 3, 4, 5], 3..=4), [7, 6]);
        // Stallings: 3 after the first three, of which only 2 is new. Silberschatz: 9.
        assert_eq!(line_misses(&[2, 3, 2, 1, 5, 2, 4, 5, 3, 2, 5, 2], 3..=3), [3 + 3]);
        assert_eq!(line_misses(&[7, 0, 1, 2, 0, 3, 0, 4, 2, 3, 0, 3, 2, 1, 2, 0, 1, 7, 0, 1], 3..=3), [9]);
        // One line alone: every change of line is a miss.
        assert_eq!(line_misses(&[4, 4, 5, 4, 4, 5], 1..=2), [4, 2]);
    }

    #[test]
    fn a_tile_that_was_lost_fills_the_memory_and_counts_for_nothing() {
        let mut trace = captured(&[&[1, 2], &[3], &[2, 3]], 2);
        trace.tiles[1].accepted = false;
        let lines = Single(9);
        let totals = optimal(&trace, &[0, 1, 2], &lines, &[geometry(&lines, 1, 2)]).expect("sound");
        assert_eq!((totals[0].record_accesses, totals[0].line_misses), (4, 2));
    }

    /// The fewest line misses of any choice of victims, by trying all of them.
    fn exhaustive(uses: &[u32], ways: usize, resident: &[u32]) -> u64 {
        let Some((&line, rest)) = uses.split_first() else { return 0 };
        if resident.contains(&line) {
            return exhaustive(rest, ways, resident);
        }
        let with = |kept: Vec<u32>| exhaustive(rest, ways, &[&kept[..], &[line]].concat());
        let least = if resident.len() < ways {
            with(resident.to_vec())
        } else {
            let without = |victim: &u32| resident.iter().copied().filter(|l| l != victim).collect();
            resident.iter().map(|victim| with(without(victim))).min().unwrap_or(0)
        };
        1 + least
    }

    /// By looking ahead at each miss.
    fn by_looking_ahead(records: &[u32], lines: &impl Lines, sets: u64, ways: usize) -> Counters {
        let string: Vec<(usize, u32)> = (0..)
            .zip(records)
            .flat_map(|(i, &record)| {
                let (first, count) = lines.of(record);
                (first..first + count).map(move |line| (i, line))
            })
            .collect();
        let mut resident = vec![Vec::new(); sets as usize];
        let mut missed = std::collections::BTreeSet::new();
        let mut totals = Counters {
            record_accesses: records.len() as u64,
            line_accesses: string.len() as u64,
            ..Counters::default()
        };
        for (at, &(record, line)) in string.iter().enumerate() {
            let set: &mut Vec<u32> = &mut resident[lines.set(line, sets) as usize];
            if set.contains(&line) {
                continue;
            }
            totals.line_misses += 1;
            missed.insert(record);
            if set.len() == ways {
                let next = |victim: u32| string[at..].iter().position(|&(_, l)| l == victim).unwrap_or(usize::MAX);
                let victim = (0..ways).max_by_key(|&way| next(set[way])).expect("ways");
                set.swap_remove(victim);
            }
            set.push(line);
        }
        totals.record_misses = missed.len() as u64;
        totals
    }

    fn replayed<R: Replacement>(records: &[u32], lines: &impl Lines, geometry: Geometry) -> Counters {
        let trace = captured(&[records], 9);
        let (mut memory, mut sum) = (Replayer::<R, _>::new(lines, geometry, 1).expect("few slots"), Sum::new(&trace));
        memory.tile(&trace, 0, &mut sum).expect("sound");
        sum.finish()
    }

    proptest! {
        #[test]
        fn no_choice_of_victims_is_better(string in prop::collection::vec(0u32..5, 0..12)) {
            let expected: Vec<_> = (1..=4).map(|ways| exhaustive(&string, ways, &[])).collect();
            prop_assert_eq!(line_misses(&string, 1..=4), expected);
        }

        #[test]
        fn agrees_with_looking_ahead_and_is_the_bound(
            records in prop::collection::vec(0u32..60, 0..300), part in 1usize..60,
        ) {
            let lines = Overlapping { lines: 32 };
            let shapes = [(1, 1), (1, 2), (1, 5), (1, 16), (1, 32), (2, 3), (4, 1), (5, 3), (8, 2)];
            let geometries = shapes.map(|(sets, ways)| geometry(&lines, sets, ways));
            let (one, two) = records.split_at(records.len() / 3);
            let totals = optimal(&captured(&[one, two], part), &[0, 1], &lines, &geometries).expect("sound");
            for (geometry, totals) in geometries.into_iter().zip(totals) {
                let expected = by_looking_ahead(&records, &lines, geometry.sets, geometry.ways as usize);
                prop_assert_eq!(totals, expected, "{:?}", geometry);
                let all = [
                    replayed::<Lru>,
                    replayed::<Fifo>,
                    replayed::<Clock>,
                    replayed::<Clock0>,
                    replayed::<Random>,
                    replayed::<Srrip>,
                    replayed::<Sieve>,
                    replayed::<S3Fifo>,
                ];
                for replayed in all {
                    prop_assert!(totals.line_misses <= replayed(&records, &lines, geometry).line_misses);
                }
            }
        }
    }
}
