//! Writes a recording: batches of rows go through a bounded queue to a thread that owns the file.
//!
//! The file is `bus.arrows.partial` until it is whole. Every batch is handed to the operating system at
//! once, so that a bus that is killed loses only the rows it had not sent yet. No row is dropped: when
//! the queue is full, who pushes waits, and the wait is counted.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};

use super::format::Metadata;
use super::row_stream::{RowStream, Sidecar};
use crate::hardware::transaction::Transaction;
use crate::recording::RecordingError;

/// Most rows of a batch.
pub(super) const BATCH_ROWS: usize = 8192;
/// A batch is sent with fewer rows when its first one completed so long before its last one.
const BATCH_NANOSECONDS: u64 = 500_000_000;
/// Batches that may wait for the thread: some 20 MB.
const QUEUE_BATCHES: usize = 16;
/// A file system that takes longer than this for what is in the queue counts as broken. Less than what a bus may be stuck.
const DEADLINE: Duration = Duration::from_secs(15);

/// What was recorded.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Summary {
    pub rows: u64,
    /// Of the file.
    pub bytes: u64,
    /// How often a batch waited because the queue was full.
    pub waits: u64,
}

enum Message {
    Rows(Vec<Transaction>),
    /// All rows were sent: make the recording whole.
    End,
}

/// The sending end of a recording. Dropped unfinished, it leaves all rows in the partial file.
pub struct Writer {
    /// The partial file, for messages.
    path: PathBuf,
    batch: Vec<Transaction>,
    waits: u64,
    sender: Option<Sender<Message>>,
    /// The thread's result; disconnected once it was received.
    result: Receiver<Result<Option<Sidecar>, RecordingError>>,
}

impl Writer {
    /// Creates `bus.arrows.partial` in a folder that exists.
    ///
    /// # Errors
    /// The file cannot be created, or the thread not be started.
    pub fn create(folder: &Path, metadata: &Metadata) -> Result<Self, RecordingError> {
        Self::start(RowStream::create(folder, metadata)?)
    }

    fn start(stream: RowStream) -> Result<Self, RecordingError> {
        let path = stream.path().to_owned();
        let (sender, messages) = bounded(QUEUE_BATCHES);
        let (report, result) = bounded(1);
        let run = move || {
            // Nobody listens when the writer was dropped and did not wait any longer.
            let _ = report.send(write_all(stream, &messages));
        };
        match thread::Builder::new().name("recording".to_owned()).spawn(run) {
            Ok(_) => Ok(Self { path, batch: Vec::with_capacity(BATCH_ROWS), waits: 0, sender: Some(sender), result }),
            Err(source) => Err(RecordingError::Io { path, source }),
        }
    }

    /// Records a transaction; they are to come in order of sequence.
    ///
    /// # Errors
    /// An earlier row could not be written, such as when the disk is full, or the queue stayed full for the
    /// deadline of 15 s. Every later call fails too.
    pub fn push(&mut self, row: Transaction) -> Result<(), RecordingError> {
        if self.sender.is_none() {
            return Err(self.ended());
        }
        self.batch.push(row);
        let age = self
            .batch
            .first()
            .map_or(0, |first| row.completion_nanoseconds.saturating_sub(first.completion_nanoseconds));
        if self.batch.len() >= BATCH_ROWS || age >= BATCH_NANOSECONDS {
            self.flush()?;
        }
        Ok(())
    }

    /// Sends the rows of the batch begun, if any. To be called when the bus is idle: no row comes then that
    /// would do it.
    ///
    /// # Errors
    /// As for [`Self::push`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        if self.batch.is_empty() {
            return Ok(());
        }
        let rows = std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH_ROWS));
        self.send(Message::Rows(rows))
    }

    /// How often a batch waited because the queue was full.
    pub fn waits(&self) -> u64 {
        self.waits
    }

    /// Makes the recording whole: renames the file and writes the sidecar.
    ///
    /// # Errors
    /// As for [`Self::push`]. The partial file stays then.
    pub fn finish(mut self) -> Result<Summary, RecordingError> {
        self.flush()?;
        self.send(Message::End)?;
        self.sender = None;
        match self.result()? {
            Some(sidecar) => Ok(Summary { rows: sidecar.rows, bytes: sidecar.bytes, waits: self.waits }),
            None => Err(self.ended()),
        }
    }

    fn send(&mut self, message: Message) -> Result<(), RecordingError> {
        let Some(sender) = &self.sender else { return Err(self.ended()) };
        let sent = match sender.try_send(message) {
            Err(TrySendError::Full(message)) => {
                self.waits += 1;
                sender.send_timeout(message, DEADLINE).map_err(|error| error.is_timeout())
            }
            sent => sent.map_err(|_| false),
        };
        match sent {
            Ok(()) => Ok(()),
            Err(true) => Err(RecordingError::Stalled { path: self.path.clone(), deadline: DEADLINE }),
            Err(false) => {
                self.sender = None;
                Err(self.result().err().unwrap_or_else(|| self.ended()))
            }
        }
    }

    /// Waits for the thread to end.
    fn result(&self) -> Result<Option<Sidecar>, RecordingError> {
        match self.result.recv_timeout(DEADLINE) {
            Ok(result) => result,
            Err(error) if error.is_timeout() => {
                Err(RecordingError::Stalled { path: self.path.clone(), deadline: DEADLINE })
            }
            Err(_) => Err(self.ended()),
        }
    }

    fn ended(&self) -> RecordingError {
        RecordingError::Ended { path: self.path.clone() }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if self.sender.is_some() {
            // What failed was returned by `push` already; a drop can only do its best.
            let _ = self.flush();
            self.sender = None;
            let _ = self.result();
        }
    }
}

/// The thread: writes batches as they come; `None` when the sender went away before the end.
fn write_all(mut stream: RowStream, messages: &Receiver<Message>) -> Result<Option<Sidecar>, RecordingError> {
    for message in messages {
        match message {
            Message::Rows(rows) => stream.write(&rows)?,
            Message::End => return stream.finish().map(Some),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use arrow_ipc::reader::StreamReader;

    use super::super::format::tests::{metadata, row};
    use super::super::row_stream::{FILE_NAME, SIDECAR_NAME};
    use super::super::rows::rows;
    use super::*;

    /// The rows of all batches that can be read, up to the end or the first that cannot.
    fn read(bytes: &[u8]) -> Vec<Transaction> {
        let reader = StreamReader::try_new(bytes, None).expect("a schema");
        reader.map_while(Result::ok).flat_map(|batch| rows(&batch).expect("rows")).collect()
    }

    fn record(folder: &Path, count: u64) -> Summary {
        let mut writer = Writer::create(folder, &metadata()).expect("a folder to write to");
        (0..count).for_each(|sequence| writer.push(row(sequence)).expect("written"));
        writer.finish().expect("whole")
    }

    #[test]
    fn rows_written_are_rows_read() {
        let folder = tempfile::tempdir().expect("a folder");
        // Several full batches and a begun one.
        let count = 2 * BATCH_ROWS as u64 + 77;
        let summary = record(folder.path(), count);
        let bytes = fs::read(folder.path().join(FILE_NAME)).expect("renamed");
        assert_eq!((summary.rows, summary.bytes), (count, bytes.len() as u64));
        assert_eq!(read(&bytes), (0..count).map(row).collect::<Vec<_>>());

        let json = fs::read(folder.path().join(SIDECAR_NAME)).expect("a sidecar");
        let expected = Sidecar {
            format_version: 1,
            marti_version: env!("CARGO_PKG_VERSION").to_owned(),
            rows: count,
            bytes: bytes.len() as u64,
            crc32c: crc32c::crc32c(&bytes),
            first_sequence: Some(0),
            last_sequence: Some(count - 1),
            complete: true,
        };
        assert_eq!(serde_json::from_slice::<Sidecar>(&json).expect("as documented"), expected);
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2, "no partial file stays");
    }

    #[test]
    fn an_empty_recording_is_whole_too() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(record(folder.path(), 0).rows, 0);
        assert!(read(&fs::read(folder.path().join(FILE_NAME)).expect("renamed")).is_empty());
    }

    #[test]
    fn cut_anywhere_all_whole_batches_are_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut writer = Writer::create(folder.path(), &metadata()).expect("a folder to write to");
        let mut ends = Vec::new();
        for batch in 0..5 {
            (0..10).for_each(|i| writer.push(row(10 * batch + i)).expect("written"));
            writer.flush().expect("written");
            ends.push(10 * (batch + 1));
        }
        writer.finish().expect("whole");
        let bytes = fs::read(folder.path().join(FILE_NAME)).expect("renamed");
        let mut seen = Vec::new();
        for cut in 1500..bytes.len() {
            let Ok(reader) = StreamReader::try_new(&bytes[..cut], None) else { continue };
            let count = reader.map_while(Result::ok).map(|batch| batch.num_rows() as u64).sum::<u64>();
            if seen.last() != Some(&count) {
                seen.push(count);
            }
        }
        // One batch more each time, never a part of one.
        assert_eq!(seen, [vec![0], ends].concat());
    }

    #[test]
    fn half_a_second_of_rows_is_sent() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut writer = Writer::create(folder.path(), &metadata()).expect("a folder to write to");
        let later = Transaction { completion_nanoseconds: BATCH_NANOSECONDS + 20, ..row(1) };
        writer.push(row(0)).expect("written");
        assert_eq!(writer.batch.len(), 1);
        writer.push(later).expect("written");
        assert!(writer.batch.is_empty());
    }

    #[test]
    fn dropped_unfinished_it_leaves_its_rows_in_the_partial_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut writer = Writer::create(folder.path(), &metadata()).expect("a folder to write to");
        (0..100).for_each(|sequence| writer.push(row(sequence)).expect("written"));
        drop(writer);
        let bytes = fs::read(folder.path().join("bus.arrows.partial")).expect("not renamed");
        assert_eq!(read(&bytes).len(), 100);
        assert!(!folder.path().join(SIDECAR_NAME).exists());
    }

    #[test]
    fn a_recording_is_a_new_file_and_goes_through_no_link() {
        let folder = tempfile::tempdir().expect("a folder");
        let victim = folder.path().join("victim");
        fs::write(&victim, "safe").expect("a folder to write to");
        symlink(&victim, folder.path().join("bus.arrows.partial")).expect("a link");
        drop(Writer::create(folder.path(), &metadata()).expect("a folder to write to"));
        assert_eq!(fs::read(&victim).expect("there"), b"safe");
        let error = Writer::create(&folder.path().join("none"), &metadata()).err().expect("no folder");
        assert!(error.to_string().contains("bus.arrows.partial"), "{error}");
    }

    #[test]
    fn a_file_that_breaks_on_the_way_is_an_error_for_who_pushes() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut stream = RowStream::create(folder.path(), &metadata()).expect("a folder to write to");
        stream.break_disk();
        let mut writer = Writer::start(stream).expect("a thread");
        let failed = (0..100 * BATCH_ROWS as u64).find_map(|sequence| writer.push(row(sequence)).err());
        let error = failed.expect("no space").to_string();
        assert!(error.contains("No space left"), "{error}");
        assert!(writer.push(row(0)).is_err(), "every later call fails too");
        assert!(writer.finish().is_err());
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Writer::create(Path::new("no/such/folder"), &metadata()).err().expect("no folder");
        assert!(error.to_string().starts_with("cannot write no/such/folder/bus.arrows.partial: "), "{error}");
    }
}
