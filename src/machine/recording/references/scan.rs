//! Walks through one file of references and checks all of it: frames, columns, checksums, words.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use arrow_array::cast::AsArray;
use arrow_array::types::{ArrowPrimitiveType, UInt32Type, UInt64Type};
use arrow_array::{Array, PrimitiveArray};
use arrow_schema::Schema;

use super::format::{COLUMNS, columns, row_crc32c};
use super::{FORMAT_VERSION, FileFacts};
use crate::hardware::references::{Event, PART_WORDS, RecordNumbers, ReferenceWord};
use crate::recording::batches::{Batch, BatchError, BatchLimits, Batches};
use crate::recording::frames::{FrameLimits, ReadAt};
use crate::recording::metadata;
use crate::recording::sidecar::checksum;
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use ground::regular_file;
use trace::database::{Layout, Section};

/// The schema's metadata are the longest; a batch is some columns and the words.
pub(super) const LIMITS: BatchLimits =
    BatchLimits { frame: FrameLimits { metadata_bytes: 1 << 16, body_bytes: 4 * PART_WORDS as u64 + 4096 }, rows: 1 };

/// Where some words of a stream lie.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Part {
    pub(super) offset: u64,
    pub(super) words: u32,
    /// Of the words alone.
    pub(super) crc32c: u32,
}

/// A tile of a file, traced to its end or not.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ScannedTile {
    pub(super) tile: TileId,
    pub(super) attempt: Attempt,
    pub(super) whole: bool,
    /// How many of the file's parts are this tile's.
    pub(super) parts: u32,
    /// Reads of records.
    pub(super) references: u64,
}

/// What is in a file.
#[derive(Debug)]
pub(super) struct Scan {
    pub(super) path: PathBuf,
    pub(super) file: File,
    pub(super) facts: FileFacts,
    pub(super) node: NodeId,
    pub(super) epoch: Epoch,
    pub(super) parts: Vec<Part>,
    pub(super) tiles: Vec<ScannedTile>,
    /// What ended the scan before the file did; all before it is sound.
    pub(super) fault: Option<String>,
}

/// A row, whose words are in its batch.
struct Row<'a> {
    tile: TileId,
    attempt: Attempt,
    part: u32,
    is_last: bool,
    primitive_tests: u64,
    /// As recorded: of the whole row.
    crc32c: u32,
    words: &'a [u32],
    offset: u64,
}

impl Scan {
    /// # Errors
    /// The file cannot be read at all, or is no recording of references of this database; the text names the file.
    pub(super) fn of(path: &Path, node: NodeId, epoch: Epoch, layout: &Layout) -> Result<Self, String> {
        let named = |what: String| format!("{}: {what}", path.display());
        let file = regular_file::open(path).map_err(|error| named(error.to_string()))?;
        let facts = facts(path, &file).map_err(|error| named(error.to_string()))?;
        let (path, parts, tiles) = (path.to_owned(), Vec::new(), Vec::new());
        let mut scan = Self { path, file, facts, node, epoch, parts, tiles, fault: None };
        if let Err(fault) = scan.walk(layout) {
            scan.fault = Some(format!("{}: {fault}", scan.path.display()));
        }
        Ok(scan)
    }

    fn walk(&mut self, layout: &Layout) -> Result<(), String> {
        if self.facts.bytes == 0 {
            return Err("the file is empty, expected a schema".to_owned());
        }
        let file = self.file.try_clone().map_err(|error| error.to_string())?;
        let said = |error: BatchError| at(error.offset, error.frame, &error.what);
        let batches = Batches::open(&file, LIMITS).map_err(said)?;
        self.check_schema(batches.schema(), layout).map_err(|what| at(0, 0, &what))?;
        let expected = |_| at(0, 0, &format!("expected the columns {}", COLUMNS.join(", ")));
        let mut batches = batches.with_columns(&columns()).map_err(expected)?;
        let numbers = RecordNumbers::new(layout);
        let tested = Tested::new(layout, &numbers);
        let mut tests = 0;
        while let Some(batch) = batches.next_batch().map_err(said)? {
            let mut take = || {
                let row = row(&batch)?;
                let (place, reads, tested) = check_words(&row, &numbers, &tested)?;
                tests = if row.part == 0 { tested } else { tests + tested };
                self.book(&row, place, reads, tests)
            };
            take().map_err(|what| at(batch.offset, batch.frame, &what))?;
        }
        Ok(())
    }

    fn check_schema(&self, schema: &Schema, layout: &Layout) -> Result<(), String> {
        let entry = |key: &str| schema.metadata().get(key).map(String::as_str);
        let version = entry("marti.format_version").ok_or("expected the schema of recorded references")?;
        if entry("marti.format") != Some("references") {
            return Err("expected the schema of recorded references".to_owned());
        }
        if !metadata::is_known_version(version) {
            return Err(format!("recorded in version {version} of the format, expected 1 to {FORMAT_VERSION}"));
        }
        let process = (entry("marti.node"), entry("marti.epoch"));
        let expected = (self.node.0.to_string(), self.epoch.0.to_string());
        if process != (Some(expected.0.as_str()), Some(expected.1.as_str())) {
            return Err(format!("the references of another process, expected {}, {}", self.node, self.epoch));
        }
        if !metadata::is_of_layout(layout, entry) {
            return Err("references to another database than that of the recording".to_owned());
        }
        Ok(())
    }

    /// Adds the row to its tile.
    fn book(&mut self, row: &Row, place: Part, reads: u64, tests: u64) -> Result<(), String> {
        let (tile, attempt) = (row.tile, row.attempt);
        match self.tiles.last().filter(|last| !last.whole) {
            Some(open) if (open.tile, open.attempt, open.parts) != (tile, attempt, row.part) => {
                let ScannedTile { tile: of, attempt: at, parts, .. } = open;
                return Err(format!("part {} of {tile}, {attempt}, expected part {parts} of {of}, {at}", row.part));
            }
            None if row.part != 0 => {
                return Err(format!("part {} of {tile}, {attempt}, expected part 0 of a tile", row.part));
            }
            _ => {}
        }
        if row.is_last && row.primitive_tests != tests {
            return Err(format!("{tile}, {attempt}: {tests} primitives read, expected {}", row.primitive_tests));
        }
        if row.part == 0 {
            self.tiles.push(ScannedTile { tile, attempt, whole: false, parts: 0, references: 0 });
        }
        if let Some(open) = self.tiles.last_mut() {
            open.parts += 1;
            open.whole = row.is_last;
            open.references += reads;
        }
        self.parts.push(place);
        Ok(())
    }
}

/// Length and checksum of a file.
fn facts(path: &Path, file: &File) -> std::io::Result<FileFacts> {
    let bytes = ReadAt::bytes(file)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(FileFacts { name, bytes, crc32c: checksum(file, bytes)? })
}

fn at(offset: u64, frame: u64, what: &str) -> String {
    format!("byte {offset} (frame {frame}): {what}")
}

fn row(batch: &Batch) -> Result<Row<'_>, String> {
    if batch.columns.num_rows() != 1 {
        return Err("expected a batch of one row, uncompressed".to_owned());
    }
    let columns = batch.columns.columns();
    let not_it = || "expected the columns of the schema".to_owned();
    let is_last = columns[3].as_boolean_opt().ok_or_else(not_it)?.value(0);
    let list = columns[6].as_list_opt::<i32>().ok_or_else(not_it)?;
    let [first, end] = *list.value_offsets() else { return Err(not_it()) };
    if first != 0 || end <= 0 || end as usize > PART_WORDS {
        return Err(format!("words {first} to {end} of a part, expected 0 to 1 or more, at most {PART_WORDS}"));
    }
    let words = list.values().as_primitive_opt::<UInt32Type>().ok_or_else(not_it)?;
    let words = words.values().get(..end as usize).ok_or_else(not_it)?;
    let place = batch.place(bytemuck::cast_slice(words));
    Ok(Row {
        tile: TileId(value::<UInt32Type>(&columns[0])?),
        attempt: Attempt(value::<UInt32Type>(&columns[1])?),
        part: value::<UInt32Type>(&columns[2])?,
        is_last,
        primitive_tests: value::<UInt64Type>(&columns[4])?,
        crc32c: value::<UInt32Type>(&columns[5])?,
        words,
        offset: place.ok_or("expected words at a multiple of 4 bytes")?,
    })
}

/// Of a column with one row.
fn value<T: ArrowPrimitiveType>(column: &dyn Array) -> Result<T::Native, String> {
    let column: Option<&PrimitiveArray<T>> = column.as_primitive_opt();
    column.map(|column| column.value(0)).ok_or_else(|| format!("expected a column of {}", T::DATA_TYPE))
}

/// Records whose read is a test of a primitive: polygons are, or else triangles, and spheres and cones.
struct Tested {
    primitives: Range<u32>,
    polygons: Range<u32>,
}

impl Tested {
    fn new(layout: &Layout, numbers: &RecordNumbers) -> Self {
        let first = if layout.has_polygons() { Section::Spheres } else { Section::Triangles };
        let primitives = numbers.section(first).start..numbers.section(Section::Surfaces).start;
        Self { primitives, polygons: numbers.section(Section::Polygons) }
    }

    fn contains(&self, record: u32) -> bool {
        self.primitives.contains(&record) || self.polygons.contains(&record)
    }
}

/// Checks a row's words, and counts reads and reads of primitives.
fn check_words(row: &Row, numbers: &RecordNumbers, tested: &Tested) -> Result<(Part, u64, u64), String> {
    let crc32c = crc32c::crc32c(bytemuck::cast_slice(row.words));
    let found = row_crc32c(crc32c, row.tile, row.attempt, row.part, row.is_last, row.primitive_tests);
    // A fuzzer cannot guess checksums, and is to see what they guard.
    if found != row.crc32c && !cfg!(fuzzing) {
        return Err(format!("crc32c of the row is {found:#010x}, expected {:#010x}", row.crc32c));
    }
    let (mut reads, mut tests) = (0u64, 0u64);
    for &word in row.words {
        if ReferenceWord(word).is_read() {
            if word >= numbers.count() {
                return Err(format!("a read of record {word}, expected one below {}", numbers.count()));
            }
            reads += 1;
            tests += u64::from(tested.contains(word));
        } else if !matches!(ReferenceWord(word).decode(), Some(Event::Ray(_))) {
            return Err(format!("{word:#010x} is no word that this version knows"));
        }
    }
    Ok((Part { offset: row.offset, words: row.words.len() as u32, crc32c }, reads, tests))
}
