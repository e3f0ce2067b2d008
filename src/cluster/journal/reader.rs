//! Takes a journal apart, from wherever its bytes come. Nothing is believed before its checksum, and no length at all:
//! how long a record is follows from its tile.

use std::io::{self, Read};

use bytemuck::Zeroable;

use super::format::{FORMAT_VERSION, Head, Header, MAGIC, Record, Subject};
use ground::ids::TileId;
use trace::picture::{Pixels, Sides};

/// How a journal begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Start {
    Header,
    /// Nothing, or what is left of a header whose writer was stopped: nothing can follow.
    Torn,
}

/// Why a file is not the journal that was asked for.
#[derive(Debug, thiserror::Error)]
pub enum HeaderFault {
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    #[error("is no journal of tiles, and is not overwritten: move it away")]
    Foreign,
    #[error("is a journal of version {found}, expected {FORMAT_VERSION}")]
    Version { found: u32 },
    #[error("its header is corrupt: remove the file to start over")]
    Corrupt,
    #[error("is the journal of another image: {0}")]
    Other(String),
}

/// What comes after the last record.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Next<'a> {
    Record(Record<'a>),
    /// The journal is whole.
    End,
    /// Nothing from here on can be used, because of this.
    Damaged(&'static str),
}

#[derive(Debug)]
pub struct Reader<R> {
    input: R,
    subject: Subject,
    /// The last record's.
    planes: Vec<u8>,
    offset: u64,
}

impl<R: Read> Reader<R> {
    /// For a journal of this subject.
    pub fn new(input: R, subject: Subject) -> Self {
        Self { input, subject, planes: Vec::new(), offset: 0 }
    }

    /// Reads the header: to be called first.
    ///
    /// # Errors
    /// The bytes cannot be read, or do not begin a journal of this subject.
    pub fn start(&mut self) -> Result<Start, HeaderFault> {
        let mut header = Header::zeroed();
        let bytes = bytemuck::bytes_of_mut(&mut header);
        let read = fill(&mut self.input, bytes)?;
        if bytes.iter().all(|byte| *byte == 0) {
            return Ok(Start::Torn);
        }
        let magic = read.min(MAGIC.len());
        if bytes[..magic] != MAGIC[..magic] {
            return Err(HeaderFault::Foreign);
        }
        if read >= 12 && header.version != FORMAT_VERSION {
            return Err(HeaderFault::Version { found: header.version });
        }
        if read < Header::BYTES {
            return Ok(Start::Torn);
        }
        if !header.is_sound() {
            return Err(HeaderFault::Corrupt);
        }
        let subject = header.subject().map_err(|error| HeaderFault::Other(error.to_string()))?;
        differences(&subject, &self.subject)?;
        self.offset = Header::BYTES as u64;
        Ok(Start::Header)
    }

    /// The next record. After an end or damage there is none.
    ///
    /// # Errors
    /// The bytes cannot be read.
    pub fn next_record(&mut self) -> io::Result<Next<'_>> {
        let mut head = Head::zeroed();
        match fill(&mut self.input, bytemuck::bytes_of_mut(&mut head))? {
            0 => return Ok(Next::End),
            Head::BYTES => {}
            _ => return Ok(Next::Damaged("the last record is cut short")),
        }
        let Some(bytes) = self.payload_bytes(&head) else {
            return Ok(Next::Damaged("what follows is no record"));
        };
        self.planes.resize(bytes, 0);
        if fill(&mut self.input, &mut self.planes)? < bytes {
            return Ok(Next::Damaged("the last record is cut short"));
        }
        match head.record(&self.planes) {
            Some(record) if head.is_sound(&self.planes) => {
                self.offset += (Head::BYTES + bytes) as u64;
                Ok(Next::Record(record))
            }
            _ => Ok(Next::Damaged("a record's checksum is wrong")),
        }
    }

    /// Bytes up to the end of the last record.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Of the payload that a record of this tile and kind has; `None` when the head says otherwise.
    fn payload_bytes(&self, head: &Head) -> Option<usize> {
        let rect = self.subject.tiling.rect(TileId(head.tile))?;
        let pixels = if head.has_pixels() { rect.pixel_count() } else { 0 };
        let bytes = Pixels::byte_len(pixels, self.subject.aov);
        (head.length as usize == bytes).then_some(bytes)
    }
}

/// What a journal is of, as its header says; `None` where that is not sound.
pub(super) fn subject(mut input: impl Read) -> Option<Subject> {
    let mut header = Header::zeroed();
    fill(&mut input, bytemuck::bytes_of_mut(&mut header)).ok()?;
    let is_known = header.magic == MAGIC && header.version == FORMAT_VERSION && header.is_sound();
    is_known.then(|| header.subject().ok()).flatten()
}

fn differences(found: &Subject, expected: &Subject) -> Result<(), HeaderFault> {
    let other = |what: String| Err(HeaderFault::Other(what));
    let size = |subject: &Subject| {
        let Sides { width, height, tile_width, tile_height } = subject.tiling.sides();
        format!("{width}x{height} pixels in tiles of {tile_width}x{tile_height}")
    };
    if found.tiling != expected.tiling {
        return other(format!("{}, expected {}", size(found), size(expected)));
    }
    if found.aov != expected.aov {
        return other(format!("its tiles hold {:?}, expected {:?}", found.aov, expected.aov));
    }
    if found.fingerprint != expected.fingerprint {
        let hexadecimal = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let [found, expected] = [found, expected].map(|subject| hexadecimal(&subject.fingerprint[..8]));
        return other(format!("scene and settings have the fingerprint {found}…, expected {expected}…"));
    }
    Ok(())
}

/// Reads until `bytes` are full or the input ends; returns how many were read.
fn fill(input: &mut impl Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut read = 0;
    while read < bytes.len() {
        match input.read(&mut bytes[read..]) {
            Ok(0) => break,
            Ok(more) => read += more,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(read)
}
