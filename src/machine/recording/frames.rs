//! The frames of an Arrow IPC stream, walked without trusting a length: each is held against the file and a limit
//! before anything is allocated or read by it.
//!
//! ```text
//! frame:  0xFFFFFFFF | i32 metadata bytes | metadata, a flatbuffer that gives the body's bytes | body
//! end:    0xFFFFFFFF | 0
//! ```

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use arrow_ipc::{Message, MessageHeader, root_as_message};

/// Before the metadata.
const PREFIX_BYTES: u64 = 8;
const MARKER: [u8; 4] = [0xff; 4];

/// Bytes that can be read at any place, from any thread.
pub trait ReadAt {
    /// # Errors
    /// The file cannot be asked.
    fn bytes(&self) -> io::Result<u64>;

    /// # Errors
    /// The bytes are not there, or cannot be read.
    fn read_exact_at(&self, into: &mut [u8], offset: u64) -> io::Result<()>;
}

impl ReadAt for File {
    fn bytes(&self) -> io::Result<u64> {
        self.metadata().map(|metadata| metadata.len())
    }

    fn read_exact_at(&self, into: &mut [u8], offset: u64) -> io::Result<()> {
        FileExt::read_exact_at(self, into, offset)
    }
}

impl ReadAt for [u8] {
    fn bytes(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }

    fn read_exact_at(&self, into: &mut [u8], offset: u64) -> io::Result<()> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX);
        let source = self.get(start..).and_then(|rest| rest.get(..into.len()));
        into.copy_from_slice(source.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}

impl<T: ReadAt + ?Sized> ReadAt for &T {
    fn bytes(&self) -> io::Result<u64> {
        (**self).bytes()
    }

    fn read_exact_at(&self, into: &mut [u8], offset: u64) -> io::Result<()> {
        (**self).read_exact_at(into, offset)
    }
}

/// The most that a frame of a stream may take.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct FrameLimits {
    pub metadata_bytes: u32,
    pub body_bytes: u64,
}

/// What a frame carries.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FrameKind {
    Schema,
    Dictionary,
    Batch,
}

/// A frame whose metadata are a sound flatbuffer and whose body lies within the file. What the metadata say of the
/// body is not checked: [`super::batches`] does.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Frame {
    /// From 0; the schema is the first.
    pub number: u64,
    pub kind: FrameKind,
    /// Of its first byte in the file.
    pub offset: u64,
    pub metadata: Vec<u8>,
    pub body_offset: u64,
    pub body_bytes: u64,
}

impl Frame {
    /// The first byte after it.
    pub fn end(&self) -> u64 {
        self.body_offset + self.body_bytes
    }

    /// # Errors
    /// Never for the metadata that [`Frames`] gave it.
    pub fn message(&self) -> Result<Message<'_>, FrameError> {
        message(&self.metadata).map_err(|fault| FrameError { frame: self.number, offset: self.offset, fault })
    }

    /// Reads the body, for which there is room in `into`.
    ///
    /// # Errors
    /// The file has become shorter since, or cannot be read.
    pub fn read_body(&self, file: &(impl ReadAt + ?Sized), into: &mut [u8]) -> Result<(), FrameError> {
        file.read_exact_at(into, self.body_offset).map_err(|error| FrameError {
            frame: self.number,
            offset: self.body_offset,
            fault: FrameFault::Io(error.to_string()),
        })
    }
}

/// How a stream ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StreamEnd {
    /// By its mark.
    Marked,
    /// Between two frames, with the file: who wrote it was killed, or it was cut just there.
    Unmarked,
}

/// Where a stream stops being one.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("byte {offset} (frame {frame}): {fault}")]
pub struct FrameError {
    /// From 0; all frames before it are sound.
    pub frame: u64,
    /// Of what is wrong.
    pub offset: u64,
    pub fault: FrameFault,
}

#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FrameFault {
    #[error("cannot be read: {0}")]
    Io(String),
    #[error("expected the beginning of a frame, ff ff ff ff, found {}", Hex(.0))]
    Marker([u8; 4]),
    #[error("expected {expected} bytes of {what}, the file ends after {found}")]
    Cut { what: &'static str, expected: u64, found: u64 },
    #[error("expected 1 to {max} bytes of metadata, found {found}")]
    MetadataBytes { found: i32, max: u32 },
    #[error("expected the metadata of an Arrow message, found none: {0}")]
    Metadata(String),
    #[error("expected a schema, a dictionary or a batch, found {0}")]
    Kind(String),
    #[error("expected 0 to {max} bytes of body, found {found}")]
    BodyBytes { found: i64, max: u64 },
    #[error("expected the file to end with its stream, found {0} bytes more")]
    Trailing(u64),
}

struct Hex<'a>(&'a [u8]);

impl std::fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, byte) in self.0.iter().enumerate() {
            write!(f, "{}{byte:02x}", if i == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

/// A walk through the frames of a stream. Bodies are passed over, not read.
#[derive(Debug)]
pub struct Frames<F> {
    file: F,
    file_bytes: u64,
    limits: FrameLimits,
    /// Of the next frame.
    offset: u64,
    number: u64,
    end: Option<StreamEnd>,
}

impl<F: ReadAt> Frames<F> {
    /// # Errors
    /// The file cannot be asked for its length.
    pub fn new(file: F, limits: FrameLimits) -> Result<Self, FrameError> {
        let asked = file.bytes();
        let fault = |error: io::Error| FrameError { frame: 0, offset: 0, fault: FrameFault::Io(error.to_string()) };
        Ok(Self { file, file_bytes: asked.map_err(fault)?, limits, offset: 0, number: 0, end: None })
    }

    pub fn file(&self) -> &F {
        &self.file
    }

    /// Where the next frame begins.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// `None` until the end was reached.
    pub fn end(&self) -> Option<StreamEnd> {
        self.end
    }

    /// The next frame; `None` at the [`end`](Self::end).
    ///
    /// # Errors
    /// There is something else than a frame. The walk does not go on after that: it fails again.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, FrameError> {
        if self.end.is_some() {
            return Ok(None);
        }
        if self.offset == self.file_bytes {
            self.end = Some(StreamEnd::Unmarked);
            return Ok(None);
        }
        let Some(metadata_bytes) = self.metadata_bytes()? else {
            let rest = self.file_bytes - self.offset - PREFIX_BYTES;
            if rest > 0 {
                return Err(self.error(PREFIX_BYTES, FrameFault::Trailing(rest)));
            }
            self.end = Some(StreamEnd::Marked);
            return Ok(None);
        };
        let frame = self.frame(metadata_bytes)?;
        self.offset = frame.end();
        self.number += 1;
        Ok(Some(frame))
    }

    /// `None` for the end of the stream.
    fn metadata_bytes(&self) -> Result<Option<u32>, FrameError> {
        let mut prefix = [0; PREFIX_BYTES as usize];
        self.expect(0, PREFIX_BYTES, "a frame's beginning")?;
        self.read(&mut prefix, 0)?;
        let [a, b, c, d, length @ ..] = prefix;
        if [a, b, c, d] != MARKER {
            return Err(self.error(0, FrameFault::Marker([a, b, c, d])));
        }
        let max = self.limits.metadata_bytes;
        match i32::from_le_bytes(length) {
            0 => Ok(None),
            found => match u32::try_from(found) {
                Ok(bytes) if bytes <= max => Ok(Some(bytes)),
                _ => Err(self.error(4, FrameFault::MetadataBytes { found, max })),
            },
        }
    }

    fn frame(&self, metadata_bytes: u32) -> Result<Frame, FrameError> {
        self.expect(PREFIX_BYTES, u64::from(metadata_bytes), "metadata")?;
        let mut metadata = vec![0; metadata_bytes as usize];
        self.read(&mut metadata, PREFIX_BYTES)?;
        let described = message(&metadata).and_then(|message| Ok((kind(&message)?, message.bodyLength())));
        let (kind, found) = described.map_err(|fault| self.error(PREFIX_BYTES, fault))?;
        let max = self.limits.body_bytes;
        let body_bytes = u64::try_from(found).ok().filter(|bytes| *bytes <= max);
        let body_bytes = body_bytes.ok_or_else(|| self.error(PREFIX_BYTES, FrameFault::BodyBytes { found, max }))?;
        let body = PREFIX_BYTES + u64::from(metadata_bytes);
        self.expect(body, body_bytes, "body")?;
        let (number, offset) = (self.number, self.offset);
        Ok(Frame { number, kind, offset, metadata, body_offset: offset + body, body_bytes })
    }

    /// That so many bytes lie at `at` of this frame.
    fn expect(&self, at: u64, expected: u64, what: &'static str) -> Result<(), FrameError> {
        let found = self.file_bytes - self.offset - at;
        if found < expected {
            return Err(self.error(at, FrameFault::Cut { what, expected, found }));
        }
        Ok(())
    }

    fn read(&self, into: &mut [u8], at: u64) -> Result<(), FrameError> {
        let read = self.file.read_exact_at(into, self.offset + at);
        read.map_err(|error| self.error(at, FrameFault::Io(error.to_string())))
    }

    fn error(&self, at: u64, fault: FrameFault) -> FrameError {
        FrameError { frame: self.number, offset: self.offset + at, fault }
    }
}

fn message(metadata: &[u8]) -> Result<Message<'_>, FrameFault> {
    root_as_message(metadata).map_err(|error| FrameFault::Metadata(first_line(&error.to_string())))
}

fn kind(message: &Message<'_>) -> Result<FrameKind, FrameFault> {
    let (kind, is_there) = match message.header_type() {
        MessageHeader::Schema => (FrameKind::Schema, message.header_as_schema().is_some()),
        MessageHeader::DictionaryBatch => (FrameKind::Dictionary, message.header_as_dictionary_batch().is_some()),
        MessageHeader::RecordBatch => (FrameKind::Batch, message.header_as_record_batch().is_some()),
        other => return Err(FrameFault::Kind(format!("{other:?}"))),
    };
    if is_there { Ok(kind) } else { Err(FrameFault::Kind(format!("an empty {kind:?}"))) }
}

/// The rest is where in the flatbuffer it was.
fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim().to_owned()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{RecordBatch, UInt32Array};
    use arrow_ipc::writer::StreamWriter;
    use arrow_schema::{DataType, Field, Schema};

    use super::*;

    const LIMITS: FrameLimits = FrameLimits { metadata_bytes: 4096, body_bytes: 1024 };

    /// A schema and three batches of eight rows.
    fn stream() -> Vec<u8> {
        let schema = Arc::new(Schema::new(vec![Field::new("n", DataType::UInt32, false)]));
        let mut writer = StreamWriter::try_new(Vec::new(), &schema).expect("in memory");
        for n in 0..3 {
            let column = Arc::new(UInt32Array::from(vec![n; 8]));
            writer.write(&RecordBatch::try_new(schema.clone(), vec![column]).expect("one column")).expect("in memory");
        }
        writer.into_inner().expect("in memory")
    }

    fn walk(bytes: &[u8]) -> (Vec<Frame>, Result<StreamEnd, FrameError>) {
        let mut frames = Frames::new(bytes, LIMITS).expect("a length");
        let mut found = Vec::new();
        loop {
            match frames.next_frame() {
                Ok(Some(frame)) => found.push(frame),
                Ok(None) => return (found, Ok(frames.end().expect("ended"))),
                Err(error) => return (found, Err(error)),
            }
        }
    }

    #[test]
    fn frames_follow_one_another_to_the_end() {
        let bytes = stream();
        let (frames, end) = walk(&bytes);
        assert_eq!(end, Ok(StreamEnd::Marked));
        let kinds: Vec<_> = frames.iter().map(|frame| frame.kind).collect();
        assert_eq!(kinds, [FrameKind::Schema, FrameKind::Batch, FrameKind::Batch, FrameKind::Batch]);
        for (i, pair) in frames.windows(2).enumerate() {
            assert_eq!((pair[0].number, pair[0].end()), (i as u64, pair[1].offset));
        }
        let mut body = vec![0; frames[3].body_bytes as usize];
        frames[3].read_body(bytes.as_slice(), &mut body).expect("there");
        assert!(body.windows(32).any(|values| values == [2, 0, 0, 0].repeat(8)), "{body:?}");
        assert_eq!(frames[3].message().expect("verified").bodyLength() as usize, body.len());
    }

    #[test]
    fn cut_anywhere_the_frames_before_are_found() {
        let bytes = stream();
        let ends: Vec<u64> = walk(&bytes).0.iter().map(Frame::end).collect();
        for cut in 0..bytes.len() as u64 {
            let (frames, end) = walk(&bytes[..cut as usize]);
            assert_eq!(frames.len(), ends.iter().filter(|end| **end <= cut).count(), "{cut}");
            match end {
                Ok(end) => assert_eq!((end, cut == 0 || ends.contains(&cut)), (StreamEnd::Unmarked, true), "{cut}"),
                Err(error) => assert!(matches!(error.fault, FrameFault::Cut { .. }), "{cut}: {error}"),
            }
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        let bytes = stream();
        let second = walk(&bytes).0[1].offset as usize;
        let at = |place: usize, with: &[u8]| {
            let mut bytes = bytes.clone();
            bytes[place..place + with.len()].copy_from_slice(with);
            walk(&bytes).1.expect_err("damaged").to_string()
        };
        let here = format!("byte {second} (frame 1): ");
        let length = format!("byte {} (frame 1): ", second + 4);
        let inside = format!("byte {} (frame 1): ", second + 8);
        assert_eq!(at(second, &[0; 4]), here + "expected the beginning of a frame, ff ff ff ff, found 00 00 00 00");
        let refused = at(second + 4, &i32::MAX.to_le_bytes());
        assert_eq!(refused, format!("{length}expected 1 to 4096 bytes of metadata, found {}", i32::MAX));
        assert_eq!(at(second + 4, &[0xff; 4]), length + "expected 1 to 4096 bytes of metadata, found -1");
        assert!(at(second + 8, &[0xff; 8]).starts_with(&(inside + "expected the metadata of an Arrow message")));
        assert!(at(second + 4, &[0; 4]).contains("expected the file to end with its stream"));
        let whole = bytes.len();
        let trailing = walk(&[&bytes[..], b"more"].concat()).1.expect_err("more");
        assert_eq!(trailing, FrameError { frame: 4, offset: whole as u64, fault: FrameFault::Trailing(4) });
    }

    #[test]
    fn a_length_is_held_against_limit_and_file_before_it_is_used() {
        let bytes = stream();
        let frame = walk(&bytes).0.remove(1);
        let body_bytes = frame.body_bytes.to_le_bytes();
        let place = frame.metadata.windows(8).position(|window| window == body_bytes).expect("the body's length");
        let place = frame.offset as usize + 8 + place;
        for (length, expected) in [
            (i64::MAX, "expected 0 to 1024 bytes of body, found 9223372036854775807"),
            (-8, "expected 0 to 1024 bytes of body, found -8"),
            (1 << 40, "expected 0 to 1024 bytes of body"),
            (1024, "expected 1024 bytes of body, the file ends after"),
        ] {
            let mut bytes = bytes.clone();
            bytes[place..place + 8].copy_from_slice(&length.to_le_bytes());
            let error = walk(&bytes).1.expect_err("too long").to_string();
            assert!(error.contains(expected), "{length}: {error}");
        }
    }
}
