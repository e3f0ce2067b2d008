//! The bytes of a journal: a header that says what it is of, then records, each with its own checksum.

use bytemuck::{Pod, Zeroable};

use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::picture::{AovSet, Sides, Tiling, TilingError};

/// Raised with every change of what follows.
pub const FORMAT_VERSION: u32 = 2;
pub(super) const MAGIC: [u8; 8] = *b"marti\0jl";

/// What a journal is of: one of anything else is refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Subject {
    pub tiling: Tiling,
    pub aov: AovSet,
    /// Of scene and image settings.
    pub fingerprint: [u8; 32],
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Record<'a> {
    /// A tile's planes, as [`trace::picture::Pixels::write_bytes`] lays them out.
    Pixels { tile: TileId, attempt: Attempt, producer: Producer, planes: &'a [u8] },
    /// The process is wrong: no tile of it counts, wherever its record is.
    Condemned(Producer),
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Header {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    /// Width, height, tile width, tile height.
    tiling: [u32; 4],
    /// Bit 0 depth, bit 1 normal, bit 2 primitive.
    aov: u32,
    fingerprint: [u8; 32],
    /// Of all before it.
    crc32c: u32,
}

impl Header {
    pub(super) const BYTES: usize = size_of::<Self>();

    pub(super) fn of(subject: &Subject) -> Self {
        let Subject { tiling, aov, fingerprint } = *subject;
        let Sides { width, height, tile_width, tile_height } = tiling.sides();
        let mut header = Self {
            magic: MAGIC,
            version: FORMAT_VERSION,
            tiling: [width, height, tile_width, tile_height],
            aov: u32::from(aov.depth) | u32::from(aov.normal) << 1 | u32::from(aov.primitive) << 2,
            fingerprint,
            crc32c: 0,
        };
        header.crc32c = header.checksum();
        header
    }

    pub(super) fn is_sound(&self) -> bool {
        // A fuzzer cannot guess checksums, and is to see what they guard.
        self.crc32c == self.checksum() || cfg!(fuzzing)
    }

    /// Of a sound header.
    ///
    /// # Errors
    /// There is no such tiling.
    pub(super) fn subject(&self) -> Result<Subject, TilingError> {
        let [width, height, tile_width, tile_height] = self.tiling;
        let aov = |bit: u32| self.aov >> bit & 1 == 1;
        Ok(Subject {
            tiling: Sides { width, height, tile_width, tile_height }.try_into()?,
            aov: AovSet { depth: aov(0), normal: aov(1), primitive: aov(2) },
            fingerprint: self.fingerprint,
        })
    }

    fn checksum(&self) -> u32 {
        crc32c::crc32c(&bytemuck::bytes_of(self)[..Self::BYTES - 4])
    }
}

const PIXELS: u8 = 1;
const CONDEMNED: u8 = 3;

/// A record without its payload.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Head {
    /// Of the rest of the head, and the payload.
    pub(super) crc32c: u32,
    pub(super) tile: u32,
    attempt: u32,
    epoch: u32,
    node: u16,
    kind: u8,
    zero: u8,
    /// Bytes of the payload.
    pub(super) length: u32,
    run: u64,
}

impl Head {
    pub(super) const BYTES: usize = size_of::<Self>();

    /// The head of a record, and its payload; `None` when the payload is longer than a head can say.
    pub(super) fn of<'a>(record: &Record<'a>) -> Option<(Self, &'a [u8])> {
        let (kind, tile, attempt, producer, payload) = match *record {
            Record::Pixels { tile, attempt, producer, planes } => (PIXELS, tile, attempt, producer, planes),
            Record::Condemned(producer) => (CONDEMNED, TileId(0), Attempt(0), producer, &[][..]),
        };
        let mut head = Self {
            crc32c: 0,
            tile: tile.0,
            attempt: attempt.0,
            epoch: producer.epoch.0,
            node: producer.node.0,
            kind,
            zero: 0,
            length: u32::try_from(payload.len()).ok()?,
            run: producer.run.0,
        };
        head.crc32c = head.checksum(payload);
        Some((head, payload))
    }

    pub(super) fn has_pixels(&self) -> bool {
        self.kind == PIXELS
    }

    pub(super) fn is_sound(&self, payload: &[u8]) -> bool {
        self.crc32c == self.checksum(payload) || cfg!(fuzzing)
    }

    /// `None`: of no known kind.
    pub(super) fn record<'a>(&self, payload: &'a [u8]) -> Option<Record<'a>> {
        let (tile, attempt) = (TileId(self.tile), Attempt(self.attempt));
        let producer = Producer { run: RunId(self.run), node: NodeId(self.node), epoch: Epoch(self.epoch) };
        match self.kind {
            PIXELS => Some(Record::Pixels { tile, attempt, producer, planes: payload }),
            CONDEMNED => Some(Record::Condemned(producer)),
            _ => None,
        }
    }

    fn checksum(&self, payload: &[u8]) -> u32 {
        crc32c::crc32c_append(crc32c::crc32c(&bytemuck::bytes_of(self)[4..]), payload)
    }
}
