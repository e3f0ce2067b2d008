//! Why a memory misses: Hill's three Cs (*Aspects of Cache Memory and Instruction Buffer Performance*, 1987).

use crate::replay::model::curve::LruCurve;
use crate::replay::model::replayer::Counters;

/// The misses of a memory, divided; their sum is the memory's own.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct MissClasses {
    /// First references: any memory misses these.
    pub compulsory: u64,
    /// What a fully associative LRU memory of as many lines misses besides: it is too small.
    pub capacity: u64,
    /// What this one misses beyond that, as its sets are smaller or its replacement is another. Negative where it
    /// misses less: so does Belady's optimum, and sets may, when they keep what LRU drives out.
    pub conflict: i64,
}

/// Of fetches, and of what they move.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Classified {
    pub records: MissClasses,
    pub lines: MissClasses,
}

/// Divides the misses of a memory of so many lines, or of several; `curve` is that of the same references, summed
/// over the same memories.
pub fn classify(actual: &Counters, curve: &LruCurve, lines: u64) -> Classified {
    let (least, lru) = (curve.compulsory(), curve.at(u32::try_from(lines).unwrap_or(u32::MAX)));
    debug_assert_eq!(
        (actual.record_accesses, actual.line_accesses),
        (lru.record_accesses, lru.line_accesses),
        "the curve of other references"
    );
    let divide = |actual: u64, least: u64, lru: u64| MissClasses {
        compulsory: least,
        capacity: lru - least,
        conflict: actual.wrapping_sub(lru).cast_signed(),
    };
    Classified {
        records: divide(actual.record_misses, least.record_misses, lru.record_misses),
        lines: divide(actual.line_misses, least.line_misses, lru.line_misses),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::local_memory::Geometry;
    use crate::hardware::replacement::{Fifo, Lru, Replacement};
    use crate::replay::Lines;
    use crate::replay::model::curve::curve;
    use crate::replay::model::replayer::{Replayer, Sum};
    use crate::replay::stream::reads::tests::{Overlapping, Single, captured};

    fn classes<R: Replacement>(records: &[u32], lines: &impl Lines, sets: u64, ways: u64) -> (Counters, Classified) {
        let trace = captured(&[records], 7);
        let geometry = Geometry { line_bytes: 16, database_lines: lines.count(), sets, ways };
        let (mut memory, mut sum) = (Replayer::<R, _>::new(lines, geometry, 1).expect("few slots"), Sum::new(&trace));
        memory.tile(&trace, 0, &mut sum).expect("sound");
        let actual = sum.finish();
        (actual, classify(&actual, &curve(&trace, &[0], lines).expect("sound"), sets * ways))
    }

    #[test]
    fn by_hand() {
        // Two sets of one line. 0 and 2 drive each other out of set 0; fully associative, both would stay.
        let (_, all) = classes::<Lru>(&[0, 2, 0, 2], &Single(8), 2, 1);
        assert_eq!(all.lines, MissClasses { compulsory: 2, capacity: 0, conflict: 2 });
        // A sweep over 0, 1, 2: LRU loses each line just before it is wanted, sets keep 1.
        let (_, all) = classes::<Lru>(&[0, 1, 2, 0, 1, 2], &Single(8), 2, 1);
        assert_eq!(all.lines, MissClasses { compulsory: 3, capacity: 3, conflict: -1 });
        // Belady's string: FIFO misses 9 where LRU misses 10.
        let (_, all) = classes::<Fifo>(&[1, 2, 3, 4, 1, 2, 5, 1, 2, 3, 4, 5], &Single(8), 1, 3);
        assert_eq!(all.lines, MissClasses { compulsory: 5, capacity: 5, conflict: -1 });
    }

    #[test]
    fn classes_sum_up_to_the_misses() {
        let records: Vec<u32> = (0..500u32).map(|i| i.wrapping_mul(0x9E37_79B1) >> 8).map(|i| i % 60).collect();
        for (sets, ways) in [(1, 16), (4, 4), (16, 1), (3, 5)] {
            let (actual, all) = classes::<Lru>(&records, &Overlapping { lines: 32 }, sets, ways);
            let sum = |c: MissClasses| (c.compulsory + c.capacity).cast_signed() + c.conflict;
            assert_eq!(sum(all.records), actual.record_misses.cast_signed());
            assert_eq!(sum(all.lines), actual.line_misses.cast_signed());
            assert!(sets > 1 || (all.records.conflict, all.lines.conflict) == (0, 0), "it is fully associative LRU");
        }
    }
}
