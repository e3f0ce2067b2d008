//! Walks through one file of references and checks all of it: frames, columns, checksums, words.

use std::fs::File;
use std::path::{Path, PathBuf};

use arrow_ipc::{MessageHeader, Schema, Type};

use super::format::{COLUMNS, row_crc32c};
use super::{FORMAT_VERSION, FileFacts};
use crate::database::{Layout, Section};
use crate::ids::{Attempt, Epoch, NodeId, TileId};
use crate::machine::references::{PART_WORDS, RecordNumbers, Word};
use crate::recording::frames::{Frame, FrameKind, FrameLimits, Frames, ReadAt};
use crate::recording::records_json;
use crate::regular_file;

/// The schema's metadata are the longest; a batch is some columns and the words.
pub(super) const LIMITS: FrameLimits =
    FrameLimits { metadata_bytes: 1 << 16, body_bytes: 4 * PART_WORDS as u64 + 4096 };

/// Where some words of a stream lie.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Place {
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
    pub(super) parts: Vec<Place>,
    pub(super) tiles: Vec<ScannedTile>,
    /// What ended the scan before the file did; all before it is sound.
    pub(super) fault: Option<String>,
}

/// A row without its words.
struct Row {
    tile: TileId,
    attempt: Attempt,
    part: u32,
    is_last: bool,
    primitive_tests: u64,
    /// As recorded: of the whole row.
    crc32c: u32,
    words: Place,
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
        let file = self.file.try_clone().map_err(|error| error.to_string())?;
        let mut frames = Frames::new(&file, LIMITS).map_err(|error| error.to_string())?;
        let numbers = RecordNumbers::new(layout);
        let mut tests = 0;
        let (mut body, mut words) = (Vec::new(), Vec::new());
        while let Some(frame) = frames.next_frame().map_err(|error| error.to_string())? {
            let at = |what: String| format!("byte {} (frame {}): {what}", frame.offset, frame.number);
            match (frame.number, frame.kind) {
                (0, FrameKind::Schema) => self.check_schema(&frame, layout).map_err(at)?,
                (0, _) => return Err(at("expected a schema".to_owned())),
                (_, FrameKind::Batch) => {
                    frame.read_body(&file, &mut body).map_err(|error| error.to_string())?;
                    let mut row = row(&frame, &body).map_err(at)?;
                    let checked = self.check_words(&mut row, frame.body_offset, &body, &mut words, &numbers);
                    let (reads, tested) = checked.map_err(at)?;
                    tests = if row.part == 0 { tested } else { tests + tested };
                    self.book(&row, reads, tests).map_err(at)?;
                }
                _ => return Err(at("expected a batch".to_owned())),
            }
        }
        match frames.offset() {
            0 => Err("the file is empty, expected a schema".to_owned()),
            _ => Ok(()),
        }
    }

    fn check_schema(&self, frame: &Frame, layout: &Layout) -> Result<(), String> {
        let message = frame.message().map_err(|error| error.to_string())?;
        let schema = message.header_as_schema().ok_or("expected a schema")?;
        let version = entry(schema, "marti.format_version").ok_or("expected the schema of recorded references")?;
        if entry(schema, "marti.format") != Some("references") {
            return Err("expected the schema of recorded references".to_owned());
        }
        if version != FORMAT_VERSION.to_string() {
            return Err(format!("recorded in version {version} of the format, expected {FORMAT_VERSION}"));
        }
        let process = (entry(schema, "marti.node"), entry(schema, "marti.epoch"));
        let expected = (self.node.0.to_string(), self.epoch.0.to_string());
        if process != (Some(expected.0.as_str()), Some(expected.1.as_str())) {
            return Err(format!("the references of another process, expected {}, {}", self.node, self.epoch));
        }
        if entry(schema, "marti.records") != Some(&records_json(layout)) {
            return Err("references to another database than that of the recording".to_owned());
        }
        check_columns(schema)
    }

    /// Checks a row's words, and counts reads and reads of primitives.
    fn check_words(
        &self,
        row: &mut Row,
        body_offset: u64,
        body: &[u8],
        words: &mut Vec<u32>,
        numbers: &RecordNumbers,
    ) -> Result<(u64, u64), String> {
        let from = (row.words.offset - body_offset) as usize;
        let bytes = &body[from..from + 4 * row.words.words as usize];
        row.words.crc32c = crc32c::crc32c(bytes);
        let found = row_crc32c(row.words.crc32c, row.tile, row.attempt, row.part, row.is_last, row.primitive_tests);
        // A fuzzer cannot guess checksums, and is to see what they guard.
        if found != row.crc32c && !cfg!(fuzzing) {
            return Err(format!("crc32c of the row is {found:#010x}, expected {:#010x}", row.crc32c));
        }
        words.clear();
        words.extend(bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])));
        let tested = numbers.section(Section::Triangles).start..numbers.section(Section::Surfaces).start;
        let (mut reads, mut tests) = (0u64, 0u64);
        for &word in words.iter() {
            if Word(word).is_read() {
                if word >= numbers.count() {
                    return Err(format!("a read of record {word}, expected one below {}", numbers.count()));
                }
                reads += 1;
                tests += u64::from(tested.contains(&word));
            } else if Word(word).decode().is_none() {
                return Err(format!("{word:#010x} is no word that this version knows"));
            }
        }
        Ok((reads, tests))
    }

    /// Adds the row to its tile.
    fn book(&mut self, row: &Row, reads: u64, tests: u64) -> Result<(), String> {
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
        self.parts.push(row.words);
        Ok(())
    }
}

/// Length and checksum of a file.
pub(super) fn facts(path: &Path, file: &File) -> std::io::Result<FileFacts> {
    let bytes = ReadAt::bytes(file)?;
    let mut block = vec![0; bytes.min(1 << 18) as usize];
    let (mut crc32c, mut at) = (0, 0);
    while at < bytes {
        let length = (bytes - at).min(block.len() as u64) as usize;
        ReadAt::read_exact_at(file, &mut block[..length], at)?;
        crc32c = crc32c::crc32c_append(crc32c, &block[..length]);
        at += length as u64;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(FileFacts { name, bytes, crc32c })
}

fn entry<'a>(schema: Schema<'a>, key: &str) -> Option<&'a str> {
    schema.custom_metadata()?.iter().find(|entry| entry.key() == Some(key))?.value()
}

fn check_columns(schema: Schema) -> Result<(), String> {
    let types = [Type::Int, Type::Int, Type::Int, Type::Bool, Type::Int, Type::Int, Type::List];
    let fields = schema.fields().ok_or("expected columns")?;
    let found = fields.iter().map(|field| (field.name().unwrap_or_default(), field.type_type()));
    if !found.take(COLUMNS.len()).eq(COLUMNS.into_iter().zip(types)) {
        return Err(format!("expected the columns {}", COLUMNS.join(", ")));
    }
    Ok(())
}

/// Takes a batch apart. The columns' buffers are validity and values in turn; the list's are validity, offsets,
/// and those of its words.
fn row(frame: &Frame, body: &[u8]) -> Result<Row, String> {
    let message = frame.message().map_err(|error| error.to_string())?;
    if message.header_type() != MessageHeader::RecordBatch {
        return Err("expected a batch".to_owned());
    }
    let batch = message.header_as_record_batch().ok_or("expected a batch")?;
    if batch.length() != 1 || batch.compression().is_some() {
        return Err("expected a batch of one row, uncompressed".to_owned());
    }
    let buffers = batch.buffers().ok_or("expected buffers")?;
    // Later versions may add columns at the end.
    if buffers.len() < 2 * COLUMNS.len() + 2 {
        return Err(format!("{} buffers, expected {} columns", buffers.len(), COLUMNS.len()));
    }
    let values = |buffer: usize, bytes: usize| -> Result<&[u8], String> {
        let place = buffers.get(buffer);
        let start = usize::try_from(place.offset()).unwrap_or(usize::MAX);
        let is_there = place.length() >= bytes as i64;
        let values = body.get(start..).and_then(|rest| rest.get(..bytes)).filter(|_| is_there);
        values.ok_or_else(|| format!("buffer {buffer} lies outside of its batch"))
    };
    let u32_of = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let column = |column: usize| -> Result<u32, String> { Ok(u32_of(values(2 * column + 1, 4)?)) };
    let tests = values(9, 8)?;
    let offsets = values(13, 8)?;
    let (first, words) = (u32_of(offsets), u32_of(&offsets[4..]));
    if first != 0 || words == 0 || words as usize > PART_WORDS {
        return Err(format!("words {first} to {words} of a part, expected 0 to 1 or more, at most {PART_WORDS}"));
    }
    values(15, 4 * words as usize)?;
    let offset = frame.body_offset + buffers.get(15).offset() as u64;
    Ok(Row {
        tile: TileId(column(0)?),
        attempt: Attempt(column(1)?),
        part: column(2)?,
        is_last: values(7, 1)?[0] & 1 == 1,
        primitive_tests: u64::from(u32_of(tests)) | u64::from(u32_of(&tests[4..])) << 32,
        crc32c: column(5)?,
        words: Place { offset, words, crc32c: 0 },
    })
}
