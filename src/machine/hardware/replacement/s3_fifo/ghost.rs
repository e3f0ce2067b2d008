//! The lines that S3-FIFO's sets evicted lately, without data.

use crate::hardware::replacement::queues::Queues;

/// A queue of line numbers for each set. When one is full, it forgets its oldest line for a new one.
#[derive(Debug)]
pub(super) struct Ghost {
    /// A set remembers as many lines.
    capacity: u32,
    /// By entry. The entries of set `s` are `s · capacity` to `s · capacity + capacity − 1`.
    lines: Vec<u32>,
    /// By set, the queue of its entries and that of those which are free.
    queues: Queues,
    entries: EntryOfLine,
}

impl Ghost {
    pub(super) fn new(sets: u32, capacity: u32) -> Self {
        let mut queues = Queues::new(2 * sets, sets * capacity);
        (0..sets * capacity).for_each(|entry| queues.push(free(entry / capacity), entry));
        Self { capacity, lines: vec![0; (sets * capacity) as usize], queues, entries: EntryOfLine::default() }
    }

    /// Returns whether the line of this set was remembered.
    pub(super) fn forget(&mut self, set: u32, line: u32) -> bool {
        let Some(entry) = self.entries.get(line) else { return false };
        self.entries.set(line, None);
        self.queues.remove(taken(set), entry);
        self.queues.push(free(set), entry);
        true
    }

    /// Remembers a line of this set, which is not remembered yet.
    pub(super) fn remember(&mut self, set: u32, line: u32) {
        if self.capacity == 0 {
            return;
        }
        let entry = self.queues.pop(free(set)).or_else(|| {
            let oldest = self.queues.pop(taken(set))?;
            self.entries.set(self.lines[oldest as usize], None);
            Some(oldest)
        });
        let Some(entry) = entry else { return };
        self.lines[entry as usize] = line;
        self.entries.set(line, Some(entry));
        self.queues.push(taken(set), entry);
    }
}

fn taken(set: u32) -> u32 {
    2 * set
}

fn free(set: u32) -> u32 {
    2 * set + 1
}

/// The entry of each line that has one. A table of pages, so that only the parts of an image that were ever evicted cost memory.
#[derive(Debug, Default)]
struct EntryOfLine {
    /// Empty, or of [`PAGE_LINES`]: the entry plus one, or 0.
    pages: Vec<Box<[u32]>>,
}

const PAGE_LINES: usize = 4096;

impl EntryOfLine {
    fn get(&self, line: u32) -> Option<u32> {
        self.pages.get(line as usize / PAGE_LINES)?.get(line as usize % PAGE_LINES)?.checked_sub(1)
    }

    fn set(&mut self, line: u32, entry: Option<u32>) {
        let page = line as usize / PAGE_LINES;
        if page >= self.pages.len() {
            self.pages.resize(page + 1, Box::default());
        }
        if self.pages[page].is_empty() {
            self.pages[page] = vec![0; PAGE_LINES].into_boxed_slice();
        }
        self.pages[page][line as usize % PAGE_LINES] = entry.map_or(0, |entry| entry + 1);
    }
}
