//! The reads of a stream as what memories see: lines.

use crate::hardware::references::{Event, ReferenceWord};
use crate::replay::stream::lines::{SPANS_MAX, Spans};
use crate::replay::{Lines, TraceError};

/// Gives each record that is read or written to `each`: its first line, and how many lines it lies in.
///
/// # Errors
/// A word of a kind that this version does not know, a record that lies outside of all lines, or an invalidation: what is
/// counted of all memories at once knows none.
#[inline(always)]
pub fn for_each(words: &[u32], lines: &impl Lines, mut each: impl FnMut(u32, u32)) -> Result<(), TraceError> {
    let end = lines.count();
    let mut spans = Spans::default();
    for words in words.chunks(SPANS_MAX) {
        lines.spans(words, &mut spans);
        for (&word, (first, count)) in words.iter().zip(spans.iter()) {
            if count > 0 {
                if first >= end || count > end - first {
                    return Err(TraceError(format!("there is no record {word}")));
                }
                each(first, count);
            } else if let Some((first, count)) = not_read(word, lines)? {
                each(first, count);
            }
        }
    }
    Ok(())
}

/// Makes reads of the writes, and leaves all out that is no reference: what a memory of a tracer knows.
pub fn writes_as_reads(words: &mut Vec<u32>) {
    words.retain_mut(|word| {
        let record = ReferenceWord(*word).record();
        *word = record.unwrap_or_default();
        record.is_some()
    });
}

/// The lines that a word which is no read references all the same.
#[cold]
#[inline(never)]
fn not_read(word: u32, lines: &impl Lines) -> Result<Option<(u32, u32)>, TraceError> {
    match ReferenceWord(word).decode() {
        Some(Event::Write(record)) => {
            let (first, count) = lines.of(record);
            if first >= lines.count() || count > lines.count() - first {
                return Err(TraceError(format!("there is no record {record}")));
            }
            Ok(Some((first, count)))
        }
        Some(Event::Read(_) | Event::Ray(_) | Event::CopyBack(_) | Event::CopyBackAll) => Ok(None),
        Some(Event::Invalidate(_) | Event::InvalidateAll) => {
            Err(TraceError("a trace with invalidations, expected one without".to_owned()))
        }
        None => Err(TraceError(format!("{word:#010x} is no word that this version knows"))),
    }
}

#[cfg(test)]
pub(in crate::replay) mod tests {
    use super::*;
    use crate::replay::Captured;
    use ground::ids::{NodeId, TileId};
    use trace::tracer::RayKind;

    /// Records of one to three lines, which overlap: record `r` begins at line `r / 2`.
    pub(in crate::replay) struct Overlapping {
        pub lines: u32,
    }

    impl Lines for Overlapping {
        fn of(&self, record: u32) -> (u32, u32) {
            (record / 2, 1 + record % 3)
        }

        fn count(&self) -> u32 {
            self.lines
        }

        fn set(&self, line: u32, sets: u64) -> u64 {
            u64::from(line) % sets
        }
    }

    /// A record is a line.
    pub(in crate::replay) struct Single(pub u32);

    impl Lines for Single {
        fn of(&self, record: u32) -> (u32, u32) {
            (record, 1)
        }

        fn count(&self) -> u32 {
            self.0
        }

        fn set(&self, line: u32, sets: u64) -> u64 {
            u64::from(line) % sets
        }
    }

    /// One node's tiles, each of so many parts of at most `part` words.
    pub(in crate::replay) fn captured(tiles: &[&[u32]], part: usize) -> Captured {
        let mut captured = Captured::default();
        for (tile, records) in (0..).zip(tiles) {
            captured.push(NodeId(0), TileId(tile), records.chunks(part).map(<[u32]>::to_vec));
        }
        captured
    }

    #[test]
    fn what_is_no_read_of_a_line_is_refused() {
        let read = |word: u32| for_each(&[word], &Overlapping { lines: 4 }, |_, _| {});
        // Record 5 would lie in lines 2 to 4, record 7 in 3 and 4, record 6 in 3 alone.
        assert!(read(5).is_err() && read(7).is_err() && read(6).is_ok());
        assert!(read(1_000_000).is_err());
        assert_eq!(read(ReferenceWord::ray(RayKind::Shadow).0), Ok(()));
        assert_eq!(read(ReferenceWord::copy_back(1).0), Ok(()));
        for unknown in [2 << 30 | 7, 3 << 30 | 4, 3 << 30 | 3 << 24, ReferenceWord::write(5).0] {
            assert!(read(unknown).is_err(), "{unknown:#x}");
        }
        let mut written = Vec::new();
        let words = [ReferenceWord::write(0).0, ReferenceWord::write(2).0];
        let lines = &Overlapping { lines: 4 };
        for_each(&words, lines, |first, count| written.push((first, count))).expect("writes");
        assert_eq!(written, [(0, 1), (1, 3)]);
    }
}
