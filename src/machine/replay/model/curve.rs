//! Misses of LRU memories of all sizes at once.

use crate::replay::model::replayer::Counters;
use crate::replay::model::stack_distance::LruStack;
use crate::replay::plan::schedule::TileSchedule;
use crate::replay::stream::reads;
use crate::replay::{Lines, Trace, TraceError};

/// How often a fully associative LRU memory misses, for every number of lines that it may have.
///
/// A line is missed by memories of at most as many lines as were referenced since; a record, whose lines are
/// referenced one after the other, by those that miss any of its lines: by its line of the largest distance.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct LruCurve {
    lines: Distances,
    /// Of each record's lines, all but one of the largest distance: what is left of `lines` are the records' own.
    others: Distances,
}

/// The curve at a number of lines. From here to the next point it is flat.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Point {
    pub lines: u32,
    pub record_misses: u64,
    pub line_misses: u64,
}

impl LruCurve {
    /// What a memory of so many lines counts.
    pub fn at(&self, lines: u32) -> Counters {
        let (line_accesses, line_misses) = (self.lines.all(), self.lines.at_least(lines));
        Counters {
            record_accesses: line_accesses - self.others.all(),
            record_misses: line_misses - self.others.at_least(lines),
            line_accesses,
            line_misses,
        }
    }

    /// What no memory can avoid: lines referenced for the first time, and the records that they belong to.
    pub fn compulsory(&self) -> Counters {
        self.at(u32::MAX)
    }

    /// The least number of lines from which on only compulsory misses are left.
    pub fn enough(&self) -> u32 {
        self.lines.counts.iter().rposition(|&n| n > 0).map_or(0, |distance| distance as u32 + 1)
    }

    /// From one line on, all numbers of lines where the curve changes.
    pub fn points(&self) -> Vec<Point> {
        let Counters { record_accesses, line_accesses, .. } = self.at(0);
        let mut now = Point { lines: 0, record_misses: record_accesses, line_misses: line_accesses };
        let mut points = Vec::new();
        for distance in 0..self.enough().max(1) {
            let lines = self.lines.exactly(distance);
            now.lines = distance + 1;
            now.line_misses -= lines;
            now.record_misses -= lines - self.others.exactly(distance);
            if distance == 0 || lines > 0 {
                points.push(now);
            }
        }
        points
    }

    /// Of several memories of the same size, each with its own references.
    pub fn add(&mut self, other: &Self) {
        self.lines.add(&other.lines);
        self.others.add(&other.others);
    }

    /// Counts the references of a part by their distances.
    fn count(&mut self, stream: &LineStream, distances: &[u32]) {
        distances.iter().for_each(|&distance| self.lines.count(distance));
        self.lines.count_many(0, stream.repeated);
        for wide in &stream.wide[..stream.wides] {
            let mut rest = &distances[(wide.end - wide.lines) as usize..wide.end as usize];
            // A line that is referenced again at once has distance 0.
            let mut farthest = 0;
            if !wide.repeats {
                (farthest, rest) = (rest[0], &rest[1..]);
            }
            for &distance in rest {
                self.others.count(farthest.min(distance));
                farthest = farthest.max(distance);
            }
        }
    }
}

/// The curve of one process's memory, which is empty at first: `tiles` are those that it traced, in order, as indices
/// into those of the trace. All tiles reference lines; only those of accepted ones are counted.
///
/// # Errors
/// The trace's; a word of a kind that this version does not know, or a record that does not exist.
pub fn curve(trace: &(impl Trace + ?Sized), tiles: &[u32], lines: &impl Lines) -> Result<LruCurve, TraceError> {
    let mut stack = LruStack::new(lines.count());
    let mut curve = LruCurve::default();
    let (mut words, mut stream, mut distances) = (Vec::new(), LineStream::default(), Vec::new());
    for &tile in tiles {
        let tile = &trace.tiles()[tile as usize];
        for part in tile.parts.clone() {
            trace.read(part, &mut words)?;
            stream.read(&words, lines)?;
            distances.resize(stream.len, 0);
            stack.references(&stream.lines[..stream.len], &mut distances);
            if tile.accepted {
                curve.count(&stream, &distances);
            }
        }
    }
    Ok(curve)
}

/// The curve of each node's memory. Those of a cluster are to be added: each of its nodes has a memory of that size.
///
/// # Errors
/// As [`curve`]'s.
pub fn by_node(
    trace: &(impl Trace + ?Sized),
    schedule: &TileSchedule,
    lines: &impl Lines,
) -> Result<Vec<LruCurve>, TraceError> {
    let of_node = |processes: &Vec<Vec<u32>>| {
        let mut sum = LruCurve::default();
        for tiles in processes {
            sum.add(&curve(trace, tiles, lines)?);
        }
        Ok(sum)
    };
    schedule.nodes.iter().map(of_node).collect()
}

/// The lines that a part references, one after the other, but for those that repeat the one before.
///
/// It is filled without a branch for records of one or two lines, which no processor could foretell: what is not to be
/// kept is written and then written over. So the vectors are longer than what they hold.
#[derive(Debug, Default)]
struct LineStream {
    lines: Vec<u32>,
    len: usize,
    repeated: u64,
    wide: Vec<WideRecord>,
    wides: usize,
    /// The line before; before the first part, there is none.
    newest: Option<u32>,
}

/// A record of several lines.
#[derive(Clone, Copy, Debug, Default)]
struct WideRecord {
    /// Where its lines end in the stream, and how many are there.
    end: u32,
    lines: u32,
    /// Whether its first line repeats the one before, and is not there.
    repeats: bool,
}

impl LineStream {
    /// Holds the references of these words, and no others.
    fn read(&mut self, words: &[u32], lines: &impl Lines) -> Result<(), TraceError> {
        (self.len, self.repeated, self.wides) = (0, 0, 0);
        // Two lines a record; those of more make room themselves.
        self.lines.resize(2 * words.len() + 1, 0);
        self.wide.resize(words.len() + 1, WideRecord::default());
        reads::for_each(words, lines, |first, count| self.push(first, count))
    }

    #[inline(always)]
    fn push(&mut self, first: u32, count: u32) {
        let repeats = self.newest == Some(first);
        self.newest = Some(first + count - 1);
        self.repeated += u64::from(repeats);
        self.lines[self.len] = first;
        self.len += usize::from(!repeats);
        let several = usize::from(count > 1);
        self.lines[self.len] = first + 1;
        self.len += several;
        if count > 2 {
            self.lines.resize(self.lines.len() + count as usize, 0);
            for line in first + 2..first + count {
                self.lines[self.len] = line;
                self.len += 1;
            }
        }
        self.wide[self.wides] = WideRecord { end: self.len as u32, lines: count - u32::from(repeats), repeats };
        self.wides += several;
    }
}

/// References by their distance.
#[derive(Clone, Debug, Default)]
struct Distances {
    first: u64,
    /// By distance, up to any number above the largest one; those beyond are 0.
    counts: Vec<u64>,
}

impl Distances {
    #[inline(always)]
    fn count(&mut self, distance: u32) {
        if let Some(count) = self.counts.get_mut(distance as usize) {
            *count += 1;
        } else {
            self.count_farther(distance);
        }
    }

    #[cold]
    #[inline(never)]
    fn count_farther(&mut self, distance: u32) {
        if distance == LruStack::FIRST {
            self.first += 1;
        } else {
            self.counts.resize((distance as usize + 1).next_power_of_two(), 0);
            self.counts[distance as usize] += 1;
        }
    }

    fn count_many(&mut self, distance: u32, times: u64) {
        if times > 0 {
            self.count(distance);
            self.counts[distance as usize] += times - 1;
        }
    }

    fn exactly(&self, distance: u32) -> u64 {
        self.counts.get(distance as usize).copied().unwrap_or(0)
    }

    fn at_least(&self, distance: u32) -> u64 {
        self.first + self.counts.iter().skip(distance as usize).sum::<u64>()
    }

    fn all(&self) -> u64 {
        self.at_least(0)
    }

    fn add(&mut self, other: &Self) {
        self.first += other.first;
        self.counts.resize(self.counts.len().max(other.counts.len()), 0);
        self.counts.iter_mut().zip(&other.counts).for_each(|(mine, theirs)| *mine += theirs);
    }
}

impl PartialEq for Distances {
    fn eq(&self, other: &Self) -> bool {
        let len = self.counts.len().max(other.counts.len()) as u32;
        self.first == other.first && (0..len).all(|distance| self.exactly(distance) == other.exactly(distance))
    }
}

impl Eq for Distances {}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::replay::stream::reads::tests::{Overlapping, Single, captured};
    use ground::ids::Epoch;

    fn curve_of(string: &[u32]) -> LruCurve {
        curve(&captured(&[string], 5), &[0], &Single(64)).expect("sound")
    }

    fn line_misses(string: &[u32], sizes: std::ops::RangeInclusive<u32>) -> Vec<u64> {
        let curve = curve_of(string);
        sizes.map(|lines| curve.at(lines).line_misses).collect()
    }

    #[test]
    fn beladys_string() {
        // On which FIFO misses 9 times with three frames and 10 with four; LRU never more with more.
        let string = [1, 2, 3, 4, 1, 2, 5, 1, 2, 3, 4, 5];
        assert_eq!(line_misses(&string, 1..=6), [12, 12, 10, 8, 5, 5]);
    }

    #[test]
    fn mattsons_kind_of_string() {
        // a b b c b a d c a a; distances ∞ ∞ 0 ∞ 1 2 ∞ 3 2 0, by hand.
        let string = [0, 1, 1, 2, 1, 0, 3, 2, 0, 0];
        assert_eq!(line_misses(&string, 0..=5), [10, 8, 7, 5, 4, 4]);
        let curve = curve_of(&string);
        assert_eq!((curve.compulsory().line_misses, curve.enough()), (4, 4));
        let points: Vec<_> = curve.points().iter().map(|p| (p.lines, p.record_misses, p.line_misses)).collect();
        assert_eq!(points, [(1, 8, 8), (2, 7, 7), (3, 5, 5), (4, 4, 4)]);
    }

    #[test]
    fn nothing_is_a_flat_curve() {
        let none = LruCurve::default();
        assert_eq!(none.points(), [Point { lines: 1, record_misses: 0, line_misses: 0 }]);
        assert_eq!((none.at(0), none.enough()), (Counters::default(), 0));
        assert_eq!(curve_of(&[3, 3]).points(), [Point { lines: 1, record_misses: 1, line_misses: 1 }]);
    }

    #[test]
    fn a_tile_that_was_lost_fills_the_memory_and_counts_for_nothing() {
        let mut trace = captured(&[&[1, 2], &[3, 1], &[2, 3]], 2);
        trace.tiles[1].accepted = false;
        let curve = curve(&trace, &[0, 1, 2], &Single(9)).expect("sound");
        // Counted: 1 and 2 for the first time, 2 and 3 each at distance 2.
        let misses = |lines| curve.at(lines).line_misses;
        assert_eq!((curve.at(9).record_accesses, misses(2), misses(3)), (4, 4, 2));
    }

    #[test]
    fn a_process_begins_with_an_empty_memory_and_nodes_add_up() {
        let mut trace = captured(&[&[1, 2], &[1, 2], &[2, 1]], 2);
        trace.tiles[2].epoch = Epoch(1);
        let schedule = TileSchedule::recorded(&trace, 2);
        let curves = by_node(&trace, &schedule, &Single(9)).expect("sound");
        assert_eq!(curves.len(), 2);
        assert_eq!([1, 2].map(|lines| curves[0].at(lines).line_misses), [6, 4]);
        assert_eq!(curves[1], LruCurve::default());
        let mut sum = curves[0].clone();
        sum.add(&curves[0]);
        assert_eq!([1, 2].map(|lines| sum.at(lines).line_misses), [12, 8]);
    }

    #[test]
    fn a_record_that_does_not_exist_is_an_error() {
        assert!(curve(&captured(&[&[9]], 1), &[0], &Single(9)).is_err());
    }

    proptest! {
        /// Records of several lines against lists, at every size.
        #[test]
        fn agrees_with_lists(records in prop::collection::vec(0u32..60, 0..300), part in 1usize..40) {
            let lines = Overlapping { lines: 32 };
            let curve = curve(&captured(&[&records], part), &[0], &lines).expect("sound");
            let mut before = None;
            for size in 1..=33u32 {
                let expected = by_list(&records, &lines, size as usize);
                prop_assert_eq!(curve.at(size), expected, "{} lines", size);
                prop_assert!(before.is_none_or(|before| expected.line_misses <= before), "inclusion");
                before = Some(expected.line_misses);
            }
            for point in curve.points() {
                let at = curve.at(point.lines);
                prop_assert_eq!((at.record_misses, at.line_misses), (point.record_misses, point.line_misses));
            }
            prop_assert_eq!(curve.at(curve.enough()), curve.compulsory());
        }
    }

    fn by_list(records: &[u32], lines: &impl Lines, size: usize) -> Counters {
        let (mut list, mut totals) = (Vec::new(), Counters::default());
        for (first, count) in records.iter().map(|&record| lines.of(record)) {
            let mut missing = 0;
            for line in first..first + count {
                match list.iter().position(|&l| l == line) {
                    Some(place) => drop(list.remove(place)),
                    None => missing += 1,
                }
                list.insert(0, line);
                list.truncate(size);
            }
            totals.record_accesses += 1;
            totals.line_accesses += u64::from(count);
            totals.record_misses += u64::from(missing > 0);
            totals.line_misses += missing;
        }
        totals
    }
}
