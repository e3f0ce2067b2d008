//! What a tracer reads, before any memory sees it: a stream of words that can be replayed through other memories.
//!
//! A word is a read of a record or a mark. Records are numbered through all sections of the image in order:
//! record `i` of a section has the number of records in the sections before it, plus `i`. That is below 2³⁰, as an
//! image of at most 2³² bytes has no more records of at least four.

use std::ops::Range;

use trace::database::records::OctreeWord;
use trace::database::{Layout, Section};
use trace::tracer::memory_port::plain_reads;
use trace::tracer::{MemoryPort, RayKind};

/// A word of a reference stream.
///
/// Bits 31–30: 0 a read; 1 a write and 2 an invalidation, each of the record that bits 29–0 number; 3 a mark. A mark whose bit
/// 29 is set is a copy back of the record that bits 28–0 number. Of all others bits 29–24 say what is marked: 0 a ray's start,
/// its kind in bits 23–0; 1 a copy back and 2 an invalidation of all that a memory holds, bits 23–0 being 0. Recordings have
/// reads and rays alone; the rest is of traces that came from elsewhere.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ReferenceWord(pub u32);

/// What a [`ReferenceWord`] says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event {
    /// Of the record with this number.
    Read(u32),
    /// The reads from here on are made for a ray of this kind; a primary one begins the tile's next pixel, row by row.
    Ray(RayKind),
    /// Of the record with this number.
    Write(u32),
    /// What is dirty of the record is written back, and stays.
    CopyBack(u32),
    /// The record is dropped, dirty or not.
    Invalidate(u32),
    /// All that is dirty is written back.
    CopyBackAll,
    /// All is dropped.
    InvalidateAll,
}

impl ReferenceWord {
    const WRITE: u32 = 1 << 30;
    const INVALIDATE: u32 = 2 << 30;
    const MARK: u32 = 3 << 30;
    const COPY_BACK: u32 = Self::MARK | 1 << 29;
    pub const COPY_BACK_ALL: Self = Self(Self::MARK | 1 << 24);
    pub const INVALIDATE_ALL: Self = Self(Self::MARK | 2 << 24);

    #[inline(always)]
    pub const fn read(record: u32) -> Self {
        Self(record)
    }

    pub const fn ray(kind: RayKind) -> Self {
        Self(Self::MARK | kind as u32)
    }

    pub const fn write(record: u32) -> Self {
        Self(Self::WRITE | record)
    }

    /// Of a record below 2²⁹.
    pub const fn copy_back(record: u32) -> Self {
        Self(Self::COPY_BACK | record)
    }

    pub const fn invalidate(record: u32) -> Self {
        Self(Self::INVALIDATE | record)
    }

    /// Whether it is a read; bits 29–0 are its record then.
    #[inline(always)]
    pub const fn is_read(self) -> bool {
        self.0 < 1 << 30
    }

    /// The record that is read or written; `None` for all else.
    #[inline(always)]
    pub const fn record(self) -> Option<u32> {
        if self.0 < 2 << 30 { Some(self.0 & !Self::WRITE) } else { None }
    }

    /// The kind of the ray whose start it marks; `None` for all else.
    #[inline(always)]
    pub fn ray_kind(self) -> Option<RayKind> {
        self.0.checked_sub(Self::MARK).and_then(|kind| RayKind::ALL.get(kind as usize)).copied()
    }

    /// `None` for what no version writes yet.
    #[inline(always)]
    pub fn decode(self) -> Option<Event> {
        if self.is_read() {
            return Some(Event::Read(self.0));
        }
        self.ray_kind().map_or_else(|| self.decode_imported(), |kind| Some(Event::Ray(kind)))
    }

    /// What recordings have not.
    #[inline(never)]
    fn decode_imported(self) -> Option<Event> {
        match self.0 {
            0..Self::WRITE => None,
            Self::WRITE..Self::INVALIDATE => Some(Event::Write(self.0 - Self::WRITE)),
            Self::INVALIDATE..Self::MARK => Some(Event::Invalidate(self.0 - Self::INVALIDATE)),
            Self::COPY_BACK.. => Some(Event::CopyBack(self.0 - Self::COPY_BACK)),
            _ if self == Self::COPY_BACK_ALL => Some(Event::CopyBackAll),
            _ if self == Self::INVALIDATE_ALL => Some(Event::InvalidateAll),
            _ => None,
        }
    }
}

/// The numbers of records across sections.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RecordNumbers {
    /// The number of each section's first record, and that of all records.
    first: [u32; Section::COUNT + 1],
}

impl RecordNumbers {
    pub fn new(layout: &Layout) -> Self {
        let mut first = [0; Section::COUNT + 1];
        for section in Section::ALL {
            // Below 2³⁰, as above.
            first[section as usize + 1] = first[section as usize] + layout.span(section).records as u32;
        }
        Self { first }
    }

    /// Of all sections.
    pub fn count(&self) -> u32 {
        self.first[Section::COUNT]
    }

    #[inline(always)]
    pub fn number(&self, section: Section, index: u32) -> u32 {
        self.first[section as usize] + index
    }

    /// The numbers of a section's records.
    pub fn section(&self, section: Section) -> Range<u32> {
        self.first[section as usize]..self.first[section as usize + 1]
    }

    /// The section of a record, and its index there. Numbers too large are in the last section.
    #[inline(always)]
    pub fn place(&self, record: u32) -> (Section, u32) {
        let mut section = 0;
        for first in &self.first[1..Section::COUNT] {
            section += usize::from(record >= *first);
        }
        (Section::ALL[section], record - self.first[section])
    }
}

/// A stream is kept in parts of at most so many words; all but a tile's last one have as many.
pub const PART_WORDS: usize = 1 << 16;

/// A port that writes down what is read through it.
#[derive(Debug)]
pub struct Recorder<'a, M, F> {
    port: &'a mut M,
    numbers: RecordNumbers,
    words: &'a mut Vec<u32>,
    keep: F,
}

impl<'a, M, F: FnMut(&[u32])> Recorder<'a, M, F> {
    /// Collects in `words`, which is empty, and gives each full part to `keep`. The last part stays in `words`.
    pub fn new(port: &'a mut M, numbers: RecordNumbers, words: &'a mut Vec<u32>, keep: F) -> Self {
        Self { port, numbers, words, keep }
    }

    #[inline(always)]
    fn note(&mut self, word: ReferenceWord) {
        if self.words.len() == PART_WORDS {
            self.keep_part();
        }
        self.words.push(word.0);
    }

    #[inline(always)]
    fn note_read(&mut self, section: Section, index: u32) {
        self.note(ReferenceWord::read(self.numbers.number(section, index)));
    }

    #[cold]
    #[inline(never)]
    fn keep_part(&mut self) {
        (self.keep)(self.words);
        self.words.clear();
    }
}

macro_rules! noted_read {
    ($($read:ident: $section:ident -> $record:ty,)*) => {$(
        #[inline(always)]
        fn $read(&mut self, index: u32) -> Result<$record, M::Error> {
            self.note_read(Section::$section, index);
            self.port.$read(index)
        }
    )*};
}

impl<M: MemoryPort, F: FnMut(&[u32])> MemoryPort for Recorder<'_, M, F> {
    type Error = M::Error;

    #[inline(always)]
    fn set_ray_kind(&mut self, kind: RayKind) {
        self.note(ReferenceWord::ray(kind));
        self.port.set_ray_kind(kind);
    }

    #[inline(always)]
    fn octree_node(&mut self, index: u32, level: u32) -> Result<OctreeWord, M::Error> {
        self.note_read(Section::OctreeNodes, index);
        self.port.octree_node(index, level)
    }

    plain_reads!(noted_read);

    fn corrupt(&mut self, what: &'static str) -> M::Error {
        self.port.corrupt(what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::stream::captured;
    use trace::tracer::slices::Slices;

    #[test]
    fn words_say_what_was_put_into_them() {
        for record in [0, 1, (1 << 30) - 1] {
            assert!(ReferenceWord::read(record).is_read());
            assert_eq!(ReferenceWord::read(record).decode(), Some(Event::Read(record)));
        }
        for (code, kind) in (0..).zip(RayKind::ALL) {
            assert_eq!(ReferenceWord::ray(kind).0, 0xC000_0000 | code);
            assert_eq!(
                (ReferenceWord::ray(kind).is_read(), ReferenceWord::ray(kind).decode()),
                (false, Some(Event::Ray(kind)))
            );
        }
    }

    #[test]
    fn words_of_imported_traces_are_no_reads() {
        for record in [0, 7, (1 << 29) - 1] {
            for (word, event) in [
                (ReferenceWord::write(record), Event::Write(record)),
                (ReferenceWord::copy_back(record), Event::CopyBack(record)),
                (ReferenceWord::invalidate(record), Event::Invalidate(record)),
            ] {
                assert_eq!((word.is_read(), word.decode()), (false, Some(event)));
            }
            assert_eq!(ReferenceWord::write(record).record(), Some(record));
            assert_eq!(ReferenceWord::read(record).record(), Some(record));
            assert_eq!(ReferenceWord::invalidate(record).record(), None);
        }
        assert_eq!(ReferenceWord::COPY_BACK_ALL.decode(), Some(Event::CopyBackAll));
        assert_eq!(ReferenceWord::INVALIDATE_ALL.decode(), Some(Event::InvalidateAll));
    }

    #[test]
    fn what_is_reserved_is_nothing_yet() {
        let kinds = RayKind::COUNT as u32;
        // Ray kinds and marks that there are not.
        for word in [3 << 30 | kinds, 3 << 30 | 1 << 24 | 1, 3 << 30 | 3 << 24, (3 << 30 | 1 << 29) - 1] {
            assert_eq!((ReferenceWord(word).is_read(), ReferenceWord(word).decode()), (false, None), "{word:#010x}");
        }
    }

    #[test]
    fn a_recorder_gives_full_parts_away_and_keeps_the_order() {
        let (database, _) = captured::tests::teapot(8, 1);
        let numbers = RecordNumbers::new(&database.database().header.layout);
        let records = numbers.section(Section::Triangles).len() as u32;
        for extra in [0, 1, 77] {
            let (mut port, mut words, mut parts) = (Slices::new(&database), Vec::new(), Vec::<Vec<u32>>::new());
            let mut recorder = Recorder::new(&mut port, numbers, &mut words, |part| parts.push(part.to_vec()));
            let mut expected = Vec::new();
            // Mark and read in turn.
            for i in 0..PART_WORDS as u32 + extra / 2 {
                let (kind, index) = (RayKind::ALL[i as usize % RayKind::COUNT], i % records);
                recorder.set_ray_kind(kind);
                let Ok(triangle) = recorder.triangle(index);
                assert_eq!(Ok(triangle), Slices::new(&database).triangle(index), "what is read goes through");
                expected.extend([ReferenceWord::ray(kind).0, numbers.number(Section::Triangles, index)]);
            }
            assert!(parts.iter().all(|part| part.len() == PART_WORDS), "all but the last are full");
            assert!((1..=PART_WORDS).contains(&words.len()), "a tile that just fills its parts has no empty one");
            parts.push(words);
            assert_eq!(parts.concat(), expected);
        }
    }
}
