//! Which lines of a memory a record lies in.

use crate::hardware::local_memory::{Geometry, GeometryError};
use crate::hardware::references::{RecordNumbers, ReferenceWord};
use crate::replay::stream::placement::Placement;
use trace::database::{Layout, Section};
use trace::tracer::simd::{Registers, Simd, Task};

/// Records by number → lines by number, for one size of line.
pub trait Lines: Sync {
    /// The record's first line, and how many lines it lies in, which follow one another.
    fn of(&self, record: u32) -> (u32, u32);

    /// The same of many words, at most [`SPANS_MAX`]; a word that is no read has no lines.
    #[inline(always)]
    fn spans(&self, words: &[u32], spans: &mut Spans) {
        for ((&word, first), count) in words.iter().zip(&mut spans.first).zip(&mut spans.count) {
            (*first, *count) = if ReferenceWord(word).is_read() { self.of(word) } else { (0, 0) };
        }
    }

    /// Lines are numbered below this.
    fn count(&self) -> u32;

    /// The set of a line among so many.
    fn set(&self, line: u32, sets: u64) -> u64;

    /// Where these lines are placed in a memory.
    ///
    /// # Errors
    /// More lines of sets that are referenced than can be simulated.
    fn placement(&self, geometry: &Geometry) -> Result<Placement, GeometryError> {
        Placement::of_any(geometry, |line, sets| self.set(line, sets))
    }
}

/// Words whose lines are found at once.
pub const SPANS_MAX: usize = 512;

/// Lines of words.
#[derive(Clone, Debug)]
pub struct Spans {
    /// The first line of each.
    first: [u32; SPANS_MAX],
    /// How many lines it lies in.
    count: [u32; SPANS_MAX],
}

impl Default for Spans {
    fn default() -> Self {
        Self { first: [0; SPANS_MAX], count: [0; SPANS_MAX] }
    }
}

impl Spans {
    /// First line and number of lines of each word.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (u32, u32)> {
        self.first.iter().copied().zip(self.count.iter().copied())
    }
}

/// The lines of a database image.
#[derive(Clone, Debug)]
pub struct RecordLines {
    numbers: RecordNumbers,
    /// By section: words of a record with its padding, and what must be added to its number times that to get its first word.
    words: [u32; Section::COUNT],
    offset: [u32; Section::COUNT],
    /// A line's words are 2 to this power.
    line_shift: u32,
    count: u32,
    has_polygons: bool,
    simd: Simd,
}

/// Polygons are in the last section.
const WITHOUT_POLYGONS: usize = Section::Polygons as usize;

impl RecordLines {
    /// Of a database with this layout, in lines of so many bytes: a power of two, 16 to 256.
    ///
    /// # Panics
    /// There are no lines of that size.
    pub fn new(layout: &Layout, line_bytes: u32) -> Self {
        assert!(
            line_bytes.is_power_of_two() && (16..=256).contains(&line_bytes),
            "a line of {line_bytes} bytes: expected a power of two, 16 to 256"
        );
        let numbers = RecordNumbers::new(layout);
        let words = layout.strides().bytes().map(|bytes| bytes / 4);
        let offset = Section::ALL.map(|section| {
            let base = (layout.span(section).base.0 / 4) as u32;
            base.wrapping_sub(numbers.number(section, 0).wrapping_mul(words[section as usize]))
        });
        let line_shift = (line_bytes / 4).trailing_zeros();
        let count = (layout.database_bytes() / u64::from(line_bytes)) as u32;
        let has_polygons = layout.has_polygons();
        Self { numbers, words, offset, line_shift, count, has_polygons, simd: Simd::best() }
    }

    #[cold]
    #[inline(never)]
    fn spans_with_polygons(&self, words: &[u32], spans: &mut Spans) {
        self.simd.run(Find::<{ Section::COUNT }> { lines: self, words, spans });
    }
}

impl Lines for RecordLines {
    #[inline(always)]
    fn of(&self, record: u32) -> (u32, u32) {
        let section = self.numbers.place(record).0 as usize;
        let words = self.words[section];
        let start = record.wrapping_mul(words).wrapping_add(self.offset[section]);
        let (first, last) = (start >> self.line_shift, (start + words - 1) >> self.line_shift);
        (first, last - first + 1)
    }

    #[inline(always)]
    fn spans(&self, words: &[u32], spans: &mut Spans) {
        if self.has_polygons {
            return self.spans_with_polygons(words, spans);
        }
        self.simd.run(Find::<WITHOUT_POLYGONS> { lines: self, words, spans });
    }

    fn count(&self) -> u32 {
        self.count
    }

    #[inline(always)]
    fn set(&self, line: u32, sets: u64) -> u64 {
        u64::from(line) % sets
    }

    /// There are no gaps, and nothing to be counted.
    fn placement(&self, geometry: &Geometry) -> Result<Placement, GeometryError> {
        Ok(Placement::without_gaps(geometry))
    }
}

/// [`Lines::spans`] without a branch, which compilers turn into vector instructions. The first so many sections have records.
struct Find<'a, const SECTIONS: usize> {
    lines: &'a RecordLines,
    words: &'a [u32],
    spans: &'a mut Spans,
}

impl<const SECTIONS: usize> Task for Find<'_, SECTIONS> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        let RecordLines { numbers, words, offset, line_shift, .. } = *self.lines;
        let starts = Section::ALL.map(|section| numbers.section(section).start);
        let Spans { first, count } = self.spans;
        for ((&word, first), count) in self.words.iter().zip(first).zip(count) {
            let (mut length, mut add) = (words[0], offset[0]);
            for section in 1..SECTIONS {
                let is_there = word >= starts[section];
                length = if is_there { words[section] } else { length };
                add = if is_there { offset[section] } else { add };
            }
            let start = word.wrapping_mul(length).wrapping_add(add);
            *first = start >> line_shift;
            let last = start.wrapping_add(length - 1) >> line_shift;
            *count = if ReferenceWord(word).is_read() { last.wrapping_sub(*first).wrapping_add(1) } else { 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::database::strides::Strides;
    use trace::tracer::RayKind;

    #[test]
    fn records_lie_where_the_layout_puts_them() {
        let records = [80, 100, 50, 7, 3, 60, 20, 4, 0];
        let with_polygons = [80, 100, 50, 7, 3, 60, 20, 4, 9];
        let strides = Strides::new([4, 4, 76, 16, 100, 8, 72, 64, 300]).expect("possible");
        for layout in [
            Layout::new(records),
            Layout::new(with_polygons),
            Layout::padded(records, strides),
            Layout::padded(with_polygons, strides),
        ] {
            records_lie_where(&layout.expect("small"));
        }
    }

    fn records_lie_where(layout: &Layout) {
        let numbers = RecordNumbers::new(layout);
        for line_bytes in [16, 32, 64, 128, 256] {
            let lines = RecordLines::new(layout, line_bytes);
            for section in Section::ALL {
                for index in 0..layout.span(section).records as u32 {
                    let number = numbers.number(section, index);
                    assert_eq!(numbers.place(number), (section, index));
                    let bytes = layout.record_bytes(section);
                    let start = layout.span(section).base.0 + u64::from(index) * bytes;
                    let line = |byte: u64| (byte / u64::from(line_bytes)) as u32;
                    let (first, last) = (line(start), line(start + bytes - 1));
                    assert_eq!(lines.of(number), (first, last - first + 1), "{section:?} {index}");
                    assert!(last < lines.count());
                }
            }
            let words: Vec<u32> = (0..numbers.count()).chain([ReferenceWord::ray(RayKind::Shadow).0]).collect();
            for words in words.chunks(SPANS_MAX) {
                let mut spans = Spans::default();
                lines.spans(words, &mut spans);
                let expected = |&word: &u32| {
                    if ReferenceWord(word).is_read() { lines.of(word) } else { (spans.first[words.len() - 1], 0) }
                };
                assert!(words.iter().map(expected).eq(spans.iter().take(words.len())), "lines of {line_bytes}");
            }
        }
    }
}
