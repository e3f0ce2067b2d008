//! The file of a journal, and the right to append to it.

use std::fs::{File, TryLockError};
use std::io::{self, BufReader, IoSlice, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use super::format::{Head, Header, Record, Subject};
use super::reader::{self, HeaderFault, Next, Reader, Start};
use ground::patient_file::with_room;
use ground::regular_file;
use trace::picture::AovSet;

/// For a display whose manager was killed to end too: until then it might append beside its successor.
const LOCK_DEADLINE: Duration = Duration::from_secs(3);
const LOCK_PAUSE: Duration = Duration::from_millis(20);

/// A journal that can be appended to, by no other process until this is dropped.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
}

#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    #[error("{}: {fault}", path.display())]
    Header { path: PathBuf, fault: HeaderFault },
    #[error("{}: {error}", path.display())]
    Io { path: PathBuf, error: io::Error },
    #[error("{}: another process still appends to it, after {} s", path.display(), LOCK_DEADLINE.as_secs())]
    Locked { path: PathBuf },
    #[error("cannot append to {}: {error}", path.display())]
    Append { path: PathBuf, error: io::Error },
}

impl Journal {
    /// Opens the file, or makes it. With `resume`, `restore` gets every record that can be used, oldest first, and what
    /// comes after them is cut off; the text says why and how much. Without, or if it is empty, the journal starts over.
    /// May wait for 3 s.
    ///
    /// # Errors
    /// The file cannot be opened, read or cut, belongs to something else, or another process appends to it.
    pub fn open(
        path: &Path,
        subject: &Subject,
        resume: bool,
        restore: impl FnMut(&Record),
    ) -> Result<(Self, Option<String>), JournalError> {
        let file = regular_file::edit(path).map_err(|error| unopened(path, error))?;
        let named = |error| JournalError::Io { path: path.to_owned(), error };
        if !lock(&file).map_err(named)? {
            return Err(JournalError::Locked { path: path.to_owned() });
        }
        let (kept, damage) = read(&file, subject, resume, restore)
            .map_err(|fault| JournalError::Header { path: path.to_owned(), fault })?;
        let mut journal = Self { path: path.to_owned(), file };
        let dropped = journal.begin(kept, subject).map_err(named)?;
        let incident = damage.filter(|_| dropped > 0).map(|why| {
            let path = path.display();
            format!("{path}: dropped the last {dropped} bytes, from byte {kept} on: {why}")
        });
        Ok((journal, incident))
    }

    /// Which planes the tiles of a journal hold; `None` where there is no sound header.
    pub fn planes(path: &Path) -> Option<AovSet> {
        Some(reader::subject(regular_file::open(path).ok()?)?.aov)
    }

    /// Whether [`Self::open`] would go on with the file, if there is one.
    ///
    /// # Errors
    /// It cannot be read, or belongs to something else.
    pub fn check(path: &Path, subject: &Subject) -> Result<(), JournalError> {
        let file = match regular_file::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            opened => opened.map_err(|error| unopened(path, error))?,
        };
        let start = Reader::new(file, *subject).start();
        start.map(drop).map_err(|fault| JournalError::Header { path: path.to_owned(), fault })
    }

    /// Appends in one write, so that the operating system has the record before it is acknowledged. After an error nothing
    /// can be appended any more.
    ///
    /// # Errors
    /// The file cannot be written: the disk has been full for 3 s, as a rule.
    pub fn append(&mut self, record: &Record) -> Result<(), JournalError> {
        let written = match Head::of(record) {
            Some((head, payload)) => write_together(&mut self.file, bytemuck::bytes_of(&head), payload),
            None => Err(io::Error::other("a tile of more than 4 GiB")),
        };
        written.map_err(|error| JournalError::Append { path: self.path.clone(), error })
    }

    #[cfg(test)]
    pub(super) fn of_file(path: &str, file: File) -> Self {
        Self { path: path.into(), file }
    }

    /// Cuts off what is not kept, of which there were so many bytes, and is behind the rest.
    fn begin(&mut self, kept: u64, subject: &Subject) -> io::Result<u64> {
        let dropped = self.file.metadata()?.len().saturating_sub(kept);
        self.file.set_len(kept)?;
        self.file.seek(SeekFrom::Start(kept))?;
        if kept == 0 {
            write_together(&mut self.file, bytemuck::bytes_of(&Header::of(subject)), &[])?;
        }
        Ok(dropped)
    }
}

/// A pipe, a device, a folder or a link is no journal.
fn unopened(path: &Path, error: io::Error) -> JournalError {
    let path = path.to_owned();
    match regular_file::is_refused(&error) {
        true => JournalError::Header { path, fault: HeaderFault::Foreign },
        false => JournalError::Io { path, error },
    }
}

/// Bytes that are kept, and why no more are.
fn read(
    file: &File,
    subject: &Subject,
    resume: bool,
    mut restore: impl FnMut(&Record),
) -> Result<(u64, Option<&'static str>), HeaderFault> {
    let mut reader = Reader::new(BufReader::with_capacity(1 << 18, file), *subject);
    match reader.start() {
        // Not ours to remove, either way.
        Err(fault @ (HeaderFault::Foreign | HeaderFault::Io(_))) => return Err(fault),
        _ if !resume => return Ok((0, None)),
        Err(fault) => return Err(fault),
        Ok(Start::Torn) => return Ok((0, Some("its header is cut short"))),
        Ok(Start::Header) => {}
    }
    loop {
        match reader.next_record()? {
            Next::Record(record) => restore(&record),
            Next::End => return Ok((reader.offset(), None)),
            Next::Damaged(why) => return Ok((reader.offset(), Some(why))),
        }
    }
}

/// Whether the file is ours alone now. Where files cannot be locked, as on some network file systems, this is not known.
fn lock(file: &File) -> io::Result<bool> {
    let deadline = Instant::now() + LOCK_DEADLINE;
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(true),
            Err(TryLockError::WouldBlock) if Instant::now() >= deadline => return Ok(false),
            Err(TryLockError::WouldBlock) => thread::sleep(LOCK_PAUSE),
            Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {
                tracing::warn!("the journal cannot be locked: {error}");
                return Ok(true);
            }
            Err(TryLockError::Error(error)) => return Err(error),
        }
    }
}

fn write_together(file: &mut File, head: &[u8], payload: &[u8]) -> io::Result<()> {
    let mut parts = &mut [IoSlice::new(head), IoSlice::new(payload)][..];
    while !parts.is_empty() {
        match with_room(|| file.write_vectored(parts)) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(bytes) => IoSlice::advance_slices(&mut parts, bytes),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}
