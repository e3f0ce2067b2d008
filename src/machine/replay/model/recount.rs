//! A curve held against brute force.

use std::collections::VecDeque;

use crate::hardware::local_memory::Geometry;
use crate::hardware::replacement::Lru;
use crate::replay::model::curve::{LruCurve, curve};
use crate::replay::model::replayer::{Counters, Replayer, Sum, Tally};
use crate::replay::stream::reads;
use crate::replay::{Captured, Lines, Trace, TraceError};

/// What the curve was recomputed by.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Method {
    /// The tags of a local memory, as nodes have them, of that size alone.
    Directory,
    /// A list of lines in order of their latest reference.
    List,
}

/// A number on a curve, twice.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Comparison {
    pub method: Method,
    /// Of the memory.
    pub lines: u32,
    pub curve: Counters,
    pub recomputed: Counters,
}

impl Comparison {
    pub fn agrees(&self) -> bool {
        self.curve == self.recomputed
    }
}

/// Recomputes the curve of one process at each of `sizes`, in lines: all of it by a [`Method::Directory`], and about
/// its first `list_records` records by a [`Method::List`], which takes a time of records times size.
///
/// # Errors
/// As [`curve`]'s.
pub fn recount(
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    lines: &impl Lines,
    curve: &LruCurve,
    sizes: &[u32],
    list_records: u64,
) -> Result<Vec<Comparison>, TraceError> {
    let prefix = prefix(trace, tiles, list_records)?;
    let prefix_tiles: Vec<u32> = (0..prefix.tiles.len() as u32).collect();
    let prefix_curve = self::curve(&prefix, &prefix_tiles, lines)?;
    let mut compared = Vec::new();
    for &size in sizes {
        let recomputed = by_directory(trace, tiles, lines, size)?;
        compared.push(Comparison { method: Method::Directory, lines: size, curve: curve.at(size), recomputed });
        let recomputed = by_list(&prefix, lines, size)?;
        compared.push(Comparison { method: Method::List, lines: size, curve: prefix_curve.at(size), recomputed });
    }
    Ok(compared)
}

/// The first parts that hold so many words.
fn prefix(trace: &(impl Trace + ?Sized), tiles: &[u32], words_wanted: u64) -> Result<Captured, TraceError> {
    let mut prefix = Captured::default();
    let (mut words, mut room) = (Vec::new(), words_wanted);
    for &tile in tiles {
        let tile = &trace.tiles()[tile as usize];
        let first = prefix.parts.len() as u32;
        for part in tile.parts.clone() {
            trace.read(part, &mut words)?;
            let taken = words.len().min(usize::try_from(room).unwrap_or(usize::MAX));
            room -= taken as u64;
            prefix.parts.push(words[..taken].to_vec());
            if room == 0 {
                break;
            }
        }
        let mut tile = tile.clone();
        tile.parts = first..prefix.parts.len() as u32;
        prefix.tiles.push(tile);
        if room == 0 {
            break;
        }
    }
    Ok(prefix)
}

fn by_directory(
    trace: &(impl Trace + ?Sized),
    tiles: &[u32],
    lines: &impl Lines,
    size: u32,
) -> Result<Counters, TraceError> {
    // The directory does not ask how large a line is.
    let geometry = Geometry { line_bytes: 16, database_lines: lines.count(), sets: 1, ways: size.into() };
    let mut memory = Replayer::<Lru, _>::new(lines, geometry, 0)?;
    let mut sum = Sum::new(trace);
    let mut words = Vec::new();
    for &tile in tiles {
        sum.tile(tile);
        for part in trace.tiles()[tile as usize].parts.clone() {
            trace.read(part, &mut words)?;
            reads::writes_as_reads(&mut words);
            memory.words(&words, &mut sum)?;
        }
    }
    Ok(sum.finish())
}

fn by_list(trace: &Captured, lines: &impl Lines, size: u32) -> Result<Counters, TraceError> {
    let mut list = VecDeque::<u32>::new();
    let mut sum = Counters::default();
    for tile in &trace.tiles {
        for part in tile.parts.clone() {
            let mut totals = Counters::default();
            reads::for_each(&trace.parts[part as usize], lines, |first, count| {
                let before = totals.line_misses;
                for line in first..first + count {
                    match list.iter().position(|&l| l == line) {
                        Some(place) => drop(list.remove(place)),
                        None => totals.line_misses += 1,
                    }
                    list.push_front(line);
                    list.truncate(size as usize);
                }
                totals.record_accesses += 1;
                totals.line_accesses += u64::from(count);
                totals.record_misses += u64::from(totals.line_misses > before);
            })?;
            if tile.accepted {
                sum.add(&totals);
            }
        }
    }
    Ok(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::RecordLines;
    use crate::replay::model::optimal::optimal;
    use crate::replay::plan::schedule::TileSchedule;
    use crate::replay::stream::captured::tests::teapot;
    use crate::replay::stream::reads::tests::{Single, captured};

    #[test]
    fn the_teapots_curve_is_right_at_every_size_that_is_recomputed() {
        let (database, mut trace) = teapot(32, 1);
        trace.tiles[3].accepted = false;
        let layout = &database.database().header.layout;
        for line_bytes in [16, 64, 256] {
            let lines = RecordLines::new(layout, line_bytes);
            let tiles = &TileSchedule::recorded(&trace, 1).nodes[0][0];
            let curve = curve(&trace, tiles, &lines).expect("sound");
            let sizes = [16, 20, 100, lines.count() / 16, lines.count() / 4, curve.enough(), lines.count()];
            let compared = recount(&trace, tiles, &lines, &curve, &sizes, 20_000).expect("sound");
            assert_eq!(compared.len(), 2 * sizes.len());
            for comparison in compared {
                assert!(comparison.agrees(), "{line_bytes}: {comparison:?}");
                assert!(comparison.recomputed.record_misses > 0);
            }
            let geometries = sizes.map(|ways| Geometry {
                line_bytes,
                database_lines: lines.count(),
                sets: 1,
                ways: u64::from(ways),
            });
            let least = optimal(&trace, tiles, &lines, &geometries).expect("sound");
            for (size, least) in sizes.into_iter().zip(least) {
                let lru = curve.at(size);
                assert!(curve.compulsory().line_misses <= least.line_misses && least.line_misses <= lru.line_misses);
                assert_eq!((least.record_accesses, least.line_accesses), (lru.record_accesses, lru.line_accesses));
            }
        }
    }

    #[test]
    fn a_wrong_curve_is_found() {
        let trace = captured(&[&[1, 2, 3, 1, 2, 3]], 4);
        let other = curve(&captured(&[&[1, 2, 3, 3, 2, 1]], 4), &[0], &Single(9)).expect("sound");
        let compared = recount(&trace, &[0], &Single(9), &other, &[2, 3], 5).expect("sound");
        assert_eq!(compared.iter().map(Comparison::agrees).collect::<Vec<_>>(), [false, true, true, true]);
        assert_eq!(compared[1].recomputed.record_accesses, 5);
    }
}
