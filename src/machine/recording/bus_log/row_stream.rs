//! The files of a recording: rows go into `bus.arrows.partial`, which becomes `bus.arrows` when it is whole,
//! with `bus.json` beside it.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use arrow_ipc::writer::StreamWriter;
use serde::{Deserialize, Serialize};

use super::format::{FORMAT_VERSION, Format, Metadata};
use crate::hardware::transaction::Transaction;
use crate::recording::{RecordingError, sidecar};
use ground::ids::{ClusterId, Epoch};
use ground::patient_file::PatientFile;
use ground::regular_file;

/// The recording's name once it is whole.
pub const FILE_NAME: &str = "bus.arrows";
/// The sidecar's name.
pub const SIDECAR_NAME: &str = "bus.json";

/// Where the log of a run is: `recording` in the run's folder, or that folder itself.
pub fn folder(of: &Path) -> PathBuf {
    let inner = of.join("recording");
    if inner.is_dir() { inner } else { of.to_owned() }
}

/// Where the log of one of a run's buses is: `cluster-C/epoch-E` in the folder of the recording, without the parts whose
/// number is 0.
pub fn folder_of(recording: &Path, cluster: ClusterId, epoch: Epoch) -> PathBuf {
    let mut folder = recording.to_owned();
    if cluster != ClusterId(0) {
        folder.push(format!("cluster-{}", cluster.0));
    }
    if epoch != Epoch(0) {
        folder.push(format!("epoch-{}", epoch.0));
    }
    folder
}

/// `bus.json`: by which a reader knows that `bus.arrows` is whole.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Sidecar {
    pub format_version: u32,
    pub marti_version: String,
    pub rows: u64,
    /// Of `bus.arrows`.
    pub bytes: u64,
    /// Of `bus.arrows`.
    pub crc32c: u32,
    /// `null` in an empty recording.
    pub first_sequence: Option<u64>,
    pub last_sequence: Option<u64>,
    /// Always true: an incomplete recording has no sidecar.
    pub complete: bool,
}

impl sidecar::Sidecar for Sidecar {
    const NAME: &'static str = SIDECAR_NAME;
    const FORMAT_VERSION: u32 = FORMAT_VERSION;
    /// One takes some 250.
    const BYTES_MAX: u64 = 64 << 10;
}

/// A recording on its way to its files.
pub(super) struct RowStream {
    folder: PathBuf,
    partial: PathBuf,
    format: Format,
    stream: StreamWriter<BufWriter<Checked<PatientFile>>>,
    rows: u64,
    /// The first and the last.
    sequences: Option<(u64, u64)>,
}

impl RowStream {
    /// Creates the partial file and writes the schema.
    pub(super) fn create(folder: &Path, metadata: &Metadata) -> Result<Self, RecordingError> {
        let partial = folder.join(FILE_NAME).with_extension("arrows.partial");
        let file =
            regular_file::create(&partial).map_err(|source| RecordingError::Io { path: partial.clone(), source })?;
        let format = Format::new(metadata);
        let file = BufWriter::with_capacity(1 << 18, Checked { inner: PatientFile(file), bytes: 0, crc32c: 0 });
        let stream = StreamWriter::try_new(file, format.schema())
            .and_then(|mut stream| stream.flush().map(|()| stream))
            .map_err(|source| RecordingError::Arrow { path: partial.clone(), source })?;
        Ok(Self { folder: folder.to_owned(), partial, format, stream, rows: 0, sequences: None })
    }

    /// The partial file.
    pub(super) fn path(&self) -> &Path {
        &self.partial
    }

    /// Writes a batch and hands it to the operating system.
    pub(super) fn write(&mut self, rows: &[Transaction]) -> Result<(), RecordingError> {
        self.format
            .batch(rows)
            .and_then(|batch| self.stream.write(&batch))
            .and_then(|()| self.stream.flush())
            .map_err(|source| RecordingError::Arrow { path: self.partial.clone(), source })?;
        self.rows += rows.len() as u64;
        if let (Some(first), Some(last)) = (rows.first(), rows.last()) {
            let first = self.sequences.map_or(first.sequence, |(first, _)| first);
            self.sequences = Some((first, last.sequence));
        }
        Ok(())
    }

    /// Ends the stream, renames the file and writes the sidecar.
    pub(super) fn finish(self) -> Result<Sidecar, RecordingError> {
        let Self { folder, partial, format, stream, rows, sequences } = self;
        let buffered = stream.into_inner().map_err(|source| RecordingError::Arrow { path: partial.clone(), source })?;
        let whole = folder.join(FILE_NAME);
        let checked = buffered.get_ref();
        let in_file = |path: &Path, result: io::Result<()>| {
            result.map_err(|source| RecordingError::Io { path: path.to_owned(), source })
        };
        in_file(&partial, checked.inner.0.sync_all())?;
        in_file(&whole, fs::rename(&partial, &whole))?;
        let sidecar = Sidecar {
            format_version: format.version(),
            marti_version: env!("CARGO_PKG_VERSION").to_owned(),
            rows,
            bytes: checked.bytes,
            crc32c: checked.crc32c,
            first_sequence: sequences.map(|(first, _)| first),
            last_sequence: sequences.map(|(_, last)| last),
            complete: true,
        };
        let json = serde_json::to_string_pretty(&sidecar).map_err(io::Error::from);
        let written = json.and_then(|json| sidecar::write::<Sidecar>(&folder, &(json + "\n")));
        in_file(&folder.join(SIDECAR_NAME), written)?;
        Ok(sidecar)
    }
}

/// Counts and checks the bytes on their way to a file.
struct Checked<W> {
    inner: W,
    bytes: u64,
    crc32c: u32,
}

impl<W: Write> Write for Checked<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.bytes += written as u64;
        self.crc32c = crc32c::crc32c_append(self.crc32c, bytes.get(..written).unwrap_or(bytes));
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
impl RowStream {
    /// From here on the disk is full.
    pub(super) fn break_disk(&mut self) {
        let full = std::fs::File::options().write(true).open("/dev/full").expect("a device that is always full");
        self.stream.get_mut().get_mut().inner = PatientFile(full);
    }
}
