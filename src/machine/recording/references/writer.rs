//! Writes the references of one node process, tile by tile.
//!
//! A tile's rows are handed to the operating system before its end is reported, so that a process that is killed takes no
//! accepted tile with it. Writing is part of tracing, on the same thread: memory at the speed of a copy.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use arrow_ipc::writer::{IpcWriteOptions, StreamWriter};
use arrow_schema::{ArrowError, SchemaRef};

use super::format::{Part, batch, file_name, schema};
use crate::recording::RecordingError;
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use ground::patient_file::PatientFile;
use ground::regular_file;
use trace::database::Layout;

/// The stream of one node process.
pub struct Writer {
    path: PathBuf,
    schema: SchemaRef,
    stream: StreamWriter<BufWriter<PatientFile>>,
    tile: TileId,
    attempt: Attempt,
    part: u32,
    /// The first error; it is returned at the end of the tile.
    error: Option<ArrowError>,
}

impl Writer {
    /// Creates the process's file in a folder that exists.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(folder: &Path, node: NodeId, epoch: Epoch, layout: &Layout) -> Result<Self, RecordingError> {
        let path = folder.join(file_name(node, epoch));
        let file = regular_file::create(&path).map_err(|source| RecordingError::Io { path: path.clone(), source })?;
        let schema = schema(node, epoch, layout);
        let stream = IpcWriteOptions::try_new(8, false, arrow_ipc::MetadataVersion::V5)
            .and_then(|options| {
                let file = BufWriter::with_capacity(1 << 16, PatientFile(file));
                let mut stream = StreamWriter::try_new_with_options(file, &schema, options)?;
                stream.flush()?;
                Ok(stream)
            })
            .map_err(|source| RecordingError::Arrow { path: path.clone(), source })?;
        Ok(Self { path, schema, stream, tile: TileId(0), attempt: Attempt(0), part: 0, error: None })
    }

    /// What is written from here on are references of this tile.
    pub fn begin(&mut self, tile: TileId, attempt: Attempt) {
        (self.tile, self.attempt, self.part) = (tile, attempt, 0);
    }

    /// Writes a part of the tile that is not its last. An error is returned at the tile's end.
    pub fn part(&mut self, words: &[u32]) {
        self.write(words, None);
    }

    /// Writes the tile's last part. `primitive_tests` are those that the tracer counted in the whole of it.
    ///
    /// # Errors
    /// Some of the tile could not be written.
    pub fn end(&mut self, words: &[u32], primitive_tests: u64) -> Result<(), RecordingError> {
        self.write(words, Some(primitive_tests));
        let flushed = self.stream.flush();
        let written = self.error.take().map_or(flushed, Err);
        written.map_err(|source| RecordingError::Arrow { path: self.path.clone(), source })
    }

    fn write(&mut self, words: &[u32], primitive_tests: Option<u64>) {
        let part = Part { tile: self.tile, attempt: self.attempt, part: self.part, primitive_tests, words };
        self.part += 1;
        let written = batch(&self.schema, &part).and_then(|batch| self.stream.write(&batch));
        if let Err(error) = written {
            self.error.get_or_insert(error);
        }
    }
}
