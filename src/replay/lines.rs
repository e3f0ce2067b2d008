//! Which lines of a memory a record lies in.

use crate::database::{Layout, Section};
use crate::machine::references::RecordNumbers;

/// Records by number → lines by number, for one size of line.
pub trait Lines: Sync {
    /// The record's first line, and how many lines it lies in, which follow one another.
    fn of(&self, record: u32) -> (u32, u32);

    /// Lines are numbered below this.
    fn count(&self) -> u32;

    /// The set of a line among so many.
    fn set(&self, line: u32, sets: u32) -> u32;
}

/// The lines of a database image.
#[derive(Clone, Debug)]
pub struct RecordLines {
    numbers: RecordNumbers,
    /// By section: words of a record, and what must be added to its number times that to get its first word.
    words: [u32; Section::COUNT],
    offset: [u32; Section::COUNT],
    /// A line's words are 2 to this power.
    line_shift: u32,
    count: u32,
}

impl RecordLines {
    /// `line_bytes` is a power of two, 16 to 256.
    pub fn new(layout: &Layout, line_bytes: u32) -> Self {
        let numbers = RecordNumbers::new(layout);
        let words = Section::ALL.map(|section| section.record_bytes() as u32 / 4);
        let offset = Section::ALL.map(|section| {
            let base = (layout.span(section).base.0 / 4) as u32;
            base.wrapping_sub(numbers.number(section, 0).wrapping_mul(words[section as usize]))
        });
        let line_shift = (line_bytes / 4).trailing_zeros();
        Self { numbers, words, offset, line_shift, count: (layout.image_bytes() / u64::from(line_bytes)) as u32 }
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

    fn count(&self) -> u32 {
        self.count
    }

    #[inline(always)]
    fn set(&self, line: u32, sets: u32) -> u32 {
        line % sets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_lie_where_the_layout_puts_them() {
        let layout = Layout::new([80, 100, 50, 7, 3, 60, 20, 4]).expect("small");
        let numbers = RecordNumbers::new(&layout);
        for line_bytes in [16, 32, 64, 128, 256] {
            let lines = RecordLines::new(&layout, line_bytes);
            for section in Section::ALL {
                for index in 0..layout.span(section).records as u32 {
                    let number = numbers.number(section, index);
                    assert_eq!(numbers.place(number), (section, index));
                    let start = layout.span(section).base.0 + u64::from(index) * section.record_bytes();
                    let line = |byte: u64| (byte / u64::from(line_bytes)) as u32;
                    let (first, last) = (line(start), line(start + section.record_bytes() - 1));
                    assert_eq!(lines.of(number), (first, last - first + 1), "{section:?} {index}");
                    assert!(last < lines.count());
                }
            }
        }
    }
}
