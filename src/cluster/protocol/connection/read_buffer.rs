//! Bytes received and not yet handed out, for readers that do their own system calls.

use std::io::{self, Read};

use super::Fault;
use crate::protocol::frame::{self, CodecError};

/// Grows by what has arrived, never by what a length claims.
#[derive(Debug)]
pub struct ReadBuffer {
    /// Received and not handed out: `bytes[start..end]`.
    bytes: Vec<u8>,
    start: usize,
    end: usize,
}

impl ReadBuffer {
    /// Room for so many bytes before the first growth.
    pub fn with_room(bytes: usize) -> Self {
        Self { bytes: vec![0; bytes.max(frame::PREFIX_BYTES)], start: 0, end: 0 }
    }

    /// Bytes of the next frame, its length included, if it is whole.
    ///
    /// # Errors
    /// It is longer than `bytes_max`, its length not included.
    pub fn whole_frame(&self, bytes_max: usize) -> Result<Option<usize>, CodecError> {
        let received = self.bytes.get(self.start..self.end).unwrap_or_default();
        let bytes = frame::frame_bytes(received, bytes_max)?.map(|bytes| frame::PREFIX_BYTES + bytes);
        Ok(bytes.filter(|&bytes| bytes <= received.len()))
    }

    /// Hands out a frame of so many bytes, its length included, as [`Self::whole_frame`] found it; what is
    /// returned is without its length.
    pub fn take(&mut self, bytes: usize) -> &[u8] {
        let start = self.start + frame::PREFIX_BYTES;
        self.start = (self.start + bytes).min(self.end);
        self.bytes.get(start..self.start).unwrap_or_default()
    }

    /// Reads once, when [`Self::whole_frame`] found none. `true`: all room was filled, more may wait.
    ///
    /// # Errors
    /// [`Fault::Closed`] or, in the middle of a frame, [`Fault::Torn`] when the peer has closed; what the
    /// read returned otherwise.
    pub fn fill_from(&mut self, mut stream: impl Read) -> Result<bool, Fault> {
        self.make_room();
        let room = self.bytes.len() - self.end;
        let bytes = stream.read(&mut self.bytes[self.end..])?;
        self.end += bytes;
        match bytes {
            0 if self.start == self.end => Err(Fault::Closed),
            0 => Err(Fault::Torn),
            _ => Ok(bytes == room),
        }
    }

    fn make_room(&mut self) {
        if self.start > 0 {
            self.bytes.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.bytes.len() {
            self.bytes.resize(2 * self.bytes.len(), 0);
        }
    }
}

/// Whether a read or write that failed so may be tried again later.
pub fn would_block(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut)
}
