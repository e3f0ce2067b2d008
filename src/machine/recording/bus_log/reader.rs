//! Reads a bus log back, batch by batch, in memory that does not grow with it.

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use super::format::{FORMAT_VERSION, Format, Metadata};
use super::row_stream::{FILE_NAME, SIDECAR_NAME, Sidecar};
use super::rows::{check, rows};
use super::writer::BATCH_ROWS;
use crate::hardware::transaction::Transaction;
use crate::recording::batches::{BatchError, BatchLimits, Batches};
use crate::recording::frames::{FrameLimits, ReadAt};
use crate::recording::sidecar::{self, Sidecar as _, SidecarFault, checksum};
use ground::regular_file;

/// A row takes some 70 bytes.
pub(super) const LIMITS: BatchLimits =
    BatchLimits { frame: FrameLimits { metadata_bytes: 64 << 10, body_bytes: 2 << 20 }, rows: BATCH_ROWS as u32 };

/// What of a damaged log can still be used: its first rows, whose sequence has no gap.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Usable {
    pub rows: u64,
    /// Whether bytes were lost, but none seen to be altered. Otherwise these rows are such as a bus can have written,
    /// but no checksum vouches for them.
    pub unaltered: bool,
}

impl fmt::Display for Usable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.rows.checked_sub(1) {
            None => f.write_str("nothing of it can be used"),
            Some(last) => {
                write!(f, "its first {} rows, sequence 0 to {last}, can be ", self.rows)?;
                f.write_str(if self.unaltered { "used" } else { "read, but no checksum vouches for them" })
            }
        }
    }
}

/// Why a log cannot be read, or not to its end.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ReadError {
    pub path: PathBuf,
    /// Of the fault, if it has a place.
    pub offset: Option<u64>,
    /// From 0; `None` for the schema and for the file as a whole.
    pub batch: Option<u64>,
    /// Expected and found.
    pub what: String,
    pub usable: Usable,
}

impl std::error::Error for ReadError {}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.path.display())?;
        if let Some(offset) = self.offset {
            write!(f, "byte {offset}, ")?;
        }
        if let Some(batch) = self.batch {
            write!(f, "batch {batch}, ")?;
        }
        write!(f, "{}; {}", self.what, self.usable)
    }
}

/// A bus log from its first row on.
#[derive(Debug)]
pub struct Reader {
    path: PathBuf,
    metadata: Metadata,
    batches: Batches<File>,
    /// What vouches for the file, and is checked at its end.
    sidecar: Option<Sidecar>,
    rows: u64,
    last: Option<Transaction>,
}

impl Reader {
    /// Opens the log in a folder once its sidecar has vouched for every byte of it.
    ///
    /// # Errors
    /// There is none, or it is not whole; the error says what of it [`Self::salvage`] would give.
    pub fn open(folder: &Path) -> Result<Self, ReadError> {
        match vouch(folder) {
            Ok(sidecar) => Ok(Self { sidecar: Some(sidecar), ..Self::salvage(folder)? }),
            Err(doubt) => Err(survey(folder, doubt)),
        }
    }

    /// Opens what is there, whole or not, and reads on to the first fault. Nothing vouches for what it gives.
    ///
    /// # Errors
    /// There is no log, or its schema is not that of one.
    pub fn salvage(folder: &Path) -> Result<Self, ReadError> {
        let path = found(folder);
        let file = regular_file::open(&path).map_err(|error| unusable(&path, error.to_string()))?;
        let of_batch = |error| ReadError::new(&path, error, 0);
        let batches = Batches::open(file, LIMITS).and_then(|batches| batches.with_columns(&Format::columns()));
        let batches = batches.map_err(of_batch)?;
        let metadata = Metadata::parse(|key| batches.schema().metadata().get(key).map(String::as_str));
        let metadata =
            metadata.map_err(|what| ReadError { offset: Some(0), ..unusable(&path, format!("schema: {what}")) })?;
        Ok(Self { path, metadata, batches, sidecar: None, rows: 0, last: None })
    }

    /// The file that is read.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Rows given so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The next rows, in order of sequence; `None` at the end.
    ///
    /// # Errors
    /// The log stops being one. It is not read on after that.
    pub fn next_rows(&mut self) -> Result<Option<Vec<Transaction>>, ReadError> {
        let batch = self.batches.next_batch().map_err(|error| ReadError::new(&self.path, error, self.rows))?;
        let Some(batch) = batch else {
            self.check_end()?;
            return Ok(None);
        };
        let fault = |what, rows| {
            let (offset, frame, batch) = (batch.offset, batch.frame, Some(batch.number));
            ReadError::new(&self.path, BatchError { offset, frame, batch, what, is_cut: false }, rows)
        };
        let read = rows(&batch.columns).map_err(|what| fault(what, self.rows))?;
        let mut last = self.last;
        for row in &read {
            check(row, last.as_ref(), &self.metadata).map_err(|what| fault(what, self.rows))?;
            last = Some(*row);
        }
        self.last = last;
        self.rows += read.len() as u64;
        Ok(Some(read))
    }

    fn check_end(&self) -> Result<(), ReadError> {
        let Some(sidecar) = &self.sidecar else { return Ok(()) };
        let said = (sidecar.rows, sidecar.first_sequence, sidecar.last_sequence);
        let last = self.last.map(|row| row.sequence);
        let found = (self.rows, last.map(|_| 0), last);
        if said == found {
            return Ok(());
        }
        let what = format!("{SIDECAR_NAME} says {}, found {}", Rows(said), Rows(found));
        Err(ReadError { usable: Usable { rows: self.rows, unaltered: true }, ..unusable(&self.path, what) })
    }
}

impl ReadError {
    fn new(path: &Path, error: BatchError, rows: u64) -> Self {
        let BatchError { offset, batch, what, is_cut, .. } = error;
        let what = if batch.is_none() { format!("schema: {what}") } else { what };
        let usable = Usable { rows, unaltered: is_cut };
        Self { path: path.to_owned(), offset: Some(offset), batch, what, usable }
    }
}

/// Rows, the first's sequence, the last's.
struct Rows((u64, Option<u64>, Option<u64>));

impl fmt::Display for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rows, first, last) = self.0;
        write!(f, "{rows} rows")?;
        match (first, last) {
            (Some(first), Some(last)) => write!(f, ", sequence {first} to {last}"),
            _ => Ok(()),
        }
    }
}

fn unusable(path: &Path, what: String) -> ReadError {
    let usable = Usable { rows: 0, unaltered: false };
    ReadError { path: path.to_owned(), offset: None, batch: None, what, usable }
}

/// The whole log, else the one that was not finished.
fn found(folder: &Path) -> PathBuf {
    let whole = folder.join(FILE_NAME);
    let partial = whole.with_extension("arrows.partial");
    if !whole.exists() && partial.exists() { partial } else { whole }
}

/// Why a log is not whole, and whether bytes of it may have been altered.
struct Doubt {
    what: String,
    altered: bool,
}

/// Reads how far a doubtful log goes.
fn survey(folder: &Path, doubt: Doubt) -> ReadError {
    let mut reader = match Reader::salvage(folder) {
        Ok(reader) => reader,
        Err(error) => return ReadError { what: format!("{}; {}", error.what, doubt.what), ..error },
    };
    let fault = loop {
        match reader.next_rows() {
            Ok(Some(_)) => {}
            Ok(None) => break None,
            Err(error) => break Some(error),
        }
    };
    let unaltered = !doubt.altered && fault.as_ref().is_none_or(|error| error.usable.unaltered);
    let usable = Usable { rows: reader.rows, unaltered };
    match fault {
        Some(error) => ReadError { what: format!("{}; {}", error.what, doubt.what), usable, ..error },
        None => ReadError { usable, ..unusable(&reader.path, doubt.what) },
    }
}

/// That the sidecar is there and describes the file byte by byte.
fn vouch(folder: &Path) -> Result<Sidecar, Doubt> {
    let lost = |what: String| Doubt { what, altered: false };
    let altered = |what: String| Doubt { what, altered: true };
    let path = found(folder);
    if path.extension().is_some_and(|extension| extension == "partial") {
        return Err(lost("the bus was ended before it could finish this file".to_owned()));
    }
    // Without it nothing shows whether bytes were altered.
    let (sidecar, _) = sidecar::read::<Sidecar>(folder).map_err(|fault| {
        let max = Sidecar::BYTES_MAX;
        altered(match fault {
            SidecarFault::Io(error) => format!("{SIDECAR_NAME}: {error}"),
            SidecarFault::Long(bytes) => format!("{SIDECAR_NAME}: expected at most {max} bytes, found {bytes}"),
            SidecarFault::Json(error) => format!("{SIDECAR_NAME} is not a sidecar: {error}"),
            SidecarFault::Version { found, complete } => format!(
                "{SIDECAR_NAME}: expected format version 1 to {FORMAT_VERSION} and complete, found {found} and {complete}"
            ),
        })
    })?;
    let file = regular_file::open(&path).map_err(|error| lost(error.to_string()))?;
    let bytes = ReadAt::bytes(&file).map_err(|error| lost(error.to_string()))?;
    if bytes != sidecar.bytes {
        let what = format!("{SIDECAR_NAME} says {} bytes, the file has {bytes}", sidecar.bytes);
        return Err(Doubt { what, altered: bytes > sidecar.bytes });
    }
    let crc32c = checksum(&file, bytes).map_err(|error| lost(error.to_string()))?;
    if crc32c != sidecar.crc32c {
        return Err(altered(format!(
            "{SIDECAR_NAME} says crc32c {:#010x}, the file has {crc32c:#010x}: bytes were altered",
            sidecar.crc32c
        )));
    }
    Ok(sidecar)
}
