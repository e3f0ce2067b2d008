//! References, one by one → a trace.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs::File;
use std::io::{self, Write};

use super::access::{Access, AccessKind, ObjectId};
use super::imported::{Contents, Imported, Notes, Objects};
use super::table_lines::{Extent, LINES_MAX};
use crate::hardware::references::{PART_WORDS, ReferenceWord};

/// A trace has at most so many references; they fill 16 GiB of a temporary file.
const REFERENCES_MAX: u64 = 1 << 32;

/// No object is larger, 1 TiB, so that the bytes of all references can be added.
const OBJECT_BYTES_MAX: u64 = 1 << 40;

/// Collects references into an [`Imported`]: to bytes or to objects.
pub(super) struct Builder {
    records: Records,
    /// Of the part that is not full yet.
    part: Vec<u32>,
    words: File,
    word_count: u64,
    /// More are refused.
    pub(super) references_max: u64,
    pub(super) notes: Notes,
}

/// What was referenced, each different one a record, numbered in the order in which they first appear.
enum Records {
    Bytes {
        numbers: HashMap<Extent, u32>,
        extents: Vec<Extent>,
    },
    Objects {
        /// The object of an id.
        numbers: HashMap<u64, u32>,
        texts: HashMap<Box<[u8]>, u32>,
        /// The record of an object with another size than its first.
        resized: HashMap<(u32, u64), u32>,
        objects: Objects,
    },
}

impl Builder {
    /// Of a trace of bytes.
    pub(super) fn of_bytes() -> Result<Self, String> {
        Self::new(Records::Bytes { numbers: HashMap::new(), extents: Vec::new() })
    }

    /// Of a trace of objects.
    pub(super) fn of_objects() -> Result<Self, String> {
        Self::new(Records::Objects {
            numbers: HashMap::new(),
            texts: HashMap::new(),
            resized: HashMap::new(),
            objects: Objects::default(),
        })
    }

    fn new(records: Records) -> Result<Self, String> {
        Ok(Self {
            records,
            part: Vec::with_capacity(PART_WORDS),
            words: tempfile::tempfile().map_err(|error| temporary(&error))?,
            word_count: 0,
            references_max: REFERENCES_MAX,
            notes: Notes::default(),
        })
    }

    /// Appends a reference to bytes.
    ///
    /// # Errors
    /// What is wrong with it, and what was expected.
    pub(super) fn access(&mut self, Access { kind, address, bytes }: Access) -> Result<(), String> {
        let extent = Extent::new(address, bytes)?;
        let Records::Bytes { numbers, extents } = &mut self.records else { return Err(MIXED.to_owned()) };
        let record = match numbers.entry(extent) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                let number = next_number(extents.len())?;
                extents.push(extent);
                *new.insert(number)
            }
        };
        self.reference(kind, record)
    }

    /// Appends a reference to an object of so many bytes. One without a size is left out, as libCacheSim leaves it out. A record
    /// is an object with a size.
    ///
    /// # Errors
    /// What is wrong with it, and what was expected.
    pub(super) fn object(&mut self, kind: AccessKind, id: ObjectId<'_>, bytes: u64) -> Result<(), String> {
        let Records::Objects { numbers, texts, resized, objects } = &mut self.records else {
            return Err(MIXED.to_owned());
        };
        if bytes > OBJECT_BYTES_MAX {
            return Err(format!("an object of {bytes} bytes, expected at most {OBJECT_BYTES_MAX}"));
        }
        if bytes == 0 {
            self.notes.left_out += 1;
            return Ok(());
        }
        let known = match id {
            ObjectId::Number(number) => numbers.get(&number),
            ObjectId::Text(text) => texts.get(text),
        };
        let record = match known {
            None => {
                let (object, record) = (objects.ids.len() as u32, next_number(objects.bytes.len())?);
                match id {
                    ObjectId::Number(number) => {
                        objects.ids.push(number);
                        numbers.insert(number, object);
                    }
                    ObjectId::Text(text) => {
                        objects.ids.push(u64::from(object));
                        texts.insert(text.into(), object);
                    }
                }
                objects.first.push(record);
                objects.record(object, bytes);
                record
            }
            Some(&object) if objects.bytes[objects.first[object as usize] as usize] == bytes => {
                objects.first[object as usize]
            }
            Some(&object) => {
                self.notes.resized += 1;
                match resized.entry((object, bytes)) {
                    Entry::Occupied(known) => *known.get(),
                    Entry::Vacant(new) => {
                        let record = next_number(objects.bytes.len())?;
                        objects.record(object, bytes);
                        *new.insert(record)
                    }
                }
            }
        };
        self.reference(kind, record)
    }

    /// Appends what concerns all that the memory holds.
    ///
    /// # Errors
    /// There are too many references, or no room for them.
    pub(super) fn whole_memory(&mut self, kind: AccessKind) -> Result<(), String> {
        match kind {
            AccessKind::CopyBack => {
                self.notes.copy_backs += 1;
                self.word(ReferenceWord::COPY_BACK_ALL)
            }
            AccessKind::Invalidate => {
                self.notes.invalidations += 1;
                self.word(ReferenceWord::INVALIDATE_ALL)
            }
            AccessKind::Read | AccessKind::Fetch | AccessKind::Write => {
                Err("a size of 0, expected 1 or more".to_owned())
            }
        }
    }

    fn reference(&mut self, kind: AccessKind, record: u32) -> Result<(), String> {
        let (word, count) = match kind {
            AccessKind::Read | AccessKind::Fetch => (ReferenceWord::read(record), None),
            AccessKind::Write => (ReferenceWord::write(record), Some(&mut self.notes.writes)),
            AccessKind::CopyBack => (ReferenceWord::copy_back(record), Some(&mut self.notes.copy_backs)),
            AccessKind::Invalidate => (ReferenceWord::invalidate(record), Some(&mut self.notes.invalidations)),
        };
        self.notes.references += u64::from(word.record().is_some());
        if let Some(count) = count {
            *count += 1;
        }
        self.word(word)
    }

    fn word(&mut self, word: ReferenceWord) -> Result<(), String> {
        if self.word_count == self.references_max {
            return Err(format!("more than {} references, expected fewer", self.references_max));
        }
        self.part.push(word.0);
        self.word_count += 1;
        if self.part.len() == PART_WORDS { self.keep_part() } else { Ok(()) }
    }

    /// The trace, for lines of `line_bytes` or more.
    ///
    /// # Errors
    /// There are no references, or they are to more than can be simulated.
    pub(super) fn finish(mut self, line_bytes: u32) -> Result<Imported, String> {
        if self.notes.references == 0 {
            return Err("no references, expected at least one".to_owned());
        }
        self.keep_part()?;
        let contents = match self.records {
            Records::Bytes { extents, .. } => Contents::Bytes(extents),
            Records::Objects { objects, .. } => Contents::Objects(objects),
        };
        Imported::new(self.words, self.word_count, contents, self.notes, line_bytes)
    }

    fn keep_part(&mut self) -> Result<(), String> {
        self.words.write_all(bytemuck::cast_slice(&self.part)).map_err(|error| temporary(&error))?;
        self.part.clear();
        Ok(())
    }
}

const MIXED: &str = "references to bytes and to objects, expected either";

fn next_number(records: usize) -> Result<u32, String> {
    if records as u64 == LINES_MAX {
        return Err(format!("more than {LINES_MAX} different addresses and sizes, or objects, expected fewer"));
    }
    Ok(records as u32)
}

fn temporary(error: &io::Error) -> String {
    format!("a temporary file for its references: {error}")
}
