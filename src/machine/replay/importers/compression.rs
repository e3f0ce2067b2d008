//! Compressed traces: gzip, zstd and xz, each perhaps of several members, frames or streams one after the other.

use std::cell::Cell;
use std::io::{self, BufRead, Read};
use std::rc::Rc;

use flate2::bufread::MultiGzDecoder;
use lzma_rust2::XzReader;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

/// How far back in what was decompressed a stream may reach; that much memory is taken when it says that it does. It is what
/// `zstd -d` and `xz -d` take by themselves, above all that their levels make.
const WINDOW_BYTES_MAX: u64 = if cfg!(fuzzing) { 8 << 20 } else { 128 << 20 };

/// How a trace is compressed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Compression {
    Gzip,
    Zstd,
    Xz,
}

impl Compression {
    /// Bytes that [`Self::of`] needs.
    pub const PREFIX_BYTES: usize = 6;

    /// By the first bytes of a file; `None` for a plain one.
    pub fn of(prefix: &[u8]) -> Option<Self> {
        match prefix {
            // Deflate, and no flag that is not defined (RFC 1952, section 2.3).
            [0x1f, 0x8b, 8, flags, ..] if flags & 0xe0 == 0 => Some(Self::Gzip),
            // A frame, or a skippable one (RFC 8878, sections 3.1.1 and 3.1.2).
            [0x28, 0xb5, 0x2f, 0xfd, ..] | [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Some(Self::Zstd),
            [0xfd, b'7', b'z', b'X', b'Z', 0, ..] => Some(Self::Xz),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Gzip => "gzip",
            Self::Zstd => "zstd",
            Self::Xz => "xz",
        }
    }

    /// What the input holds. Errors give a byte of the compressed input, at or after the place of the fault.
    pub fn decompress<'a>(self, input: impl BufRead + 'a) -> Box<dyn Read + 'a> {
        let at = Rc::new(Cell::new(0));
        let input = Counted { input, at: Rc::clone(&at) };
        match self {
            Self::Gzip => Box::new(Placed { decoder: MultiGzDecoder::new(input), compression: self, at }),
            Self::Zstd => Box::new(Placed { decoder: ZstdFrames::new(input), compression: self, at }),
            Self::Xz => {
                let decoder = XzReader::new_mem_limit(input, true, (WINDOW_BYTES_MAX >> 10) as u32);
                Box::new(Placed { decoder, compression: self, at })
            }
        }
    }
}

/// Counts the bytes that were taken.
struct Counted<R> {
    input: R,
    at: Rc<Cell<u64>>,
}

impl<R: BufRead> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.input.read(buffer)?;
        self.at.set(self.at.get() + read as u64);
        Ok(read)
    }
}

impl<R: BufRead> BufRead for Counted<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.input.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.input.consume(amount);
        self.at.set(self.at.get() + amount as u64);
    }
}

/// A decoder whose errors have a place.
struct Placed<D> {
    decoder: D,
    compression: Compression,
    at: Rc<Cell<u64>>,
}

impl<D: Read> Read for Placed<D> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.decoder.read(buffer).map_err(|error| {
            if error.kind() == io::ErrorKind::Interrupted {
                return error;
            }
            let (name, at) = (self.compression.name(), self.at.get());
            let what = match error.kind() {
                io::ErrorKind::UnexpectedEof => {
                    format!("{name}: the compressed stream ends at byte {at}, expected the rest of it")
                }
                _ => format!("{name}: byte {at} of the compressed stream: {error}"),
            };
            io::Error::new(error.kind(), what)
        })
    }
}

/// The frames of a zstd file. What a skippable frame has is left out.
struct ZstdFrames<R> {
    input: R,
    decoder: FrameDecoder,
    in_frame: bool,
    /// What was decompressed of the frame so far.
    frame_bytes: u64,
}

impl<R: BufRead> ZstdFrames<R> {
    fn new(input: R) -> Self {
        let mut decoder = FrameDecoder::new();
        decoder.set_max_window_size(WINDOW_BYTES_MAX);
        Self { input, decoder, in_frame: false, frame_bytes: 0 }
    }

    /// Begins the next frame; `false` at the end of the file.
    fn begin(&mut self) -> io::Result<bool> {
        while !self.input.fill_buf()?.is_empty() {
            match self.decoder.reset(&mut self.input) {
                Ok(()) => {
                    (self.in_frame, self.frame_bytes) = (true, 0);
                    return Ok(true);
                }
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                    let length = u64::from(length);
                    if io::copy(&mut self.input.by_ref().take(length), &mut io::sink())? < length {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                }
                Err(error) => return Err(zstd_error(error)),
            }
        }
        Ok(false)
    }

    fn end(&mut self) -> io::Result<()> {
        self.in_frame = false;
        // 0 where the frame does not say it.
        let (found, expected) = (self.frame_bytes, self.decoder.content_size());
        if expected > 0 && found != expected {
            let what = format!("a frame of {found} bytes, expected {expected} as it says");
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        match (self.decoder.get_checksum_from_data(), self.decoder.get_calculated_checksum()) {
            (Some(found), Some(calculated)) if found != calculated && !cfg!(fuzzing) => {
                let what = format!("checksum {found:#010x} of a frame, expected {calculated:#010x}");
                Err(io::Error::new(io::ErrorKind::InvalidData, what))
            }
            _ => Ok(()),
        }
    }
}

impl<R: BufRead> Read for ZstdFrames<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        while self.in_frame || self.begin()? {
            if !self.decoder.is_finished() && self.decoder.can_collect() == 0 {
                let decoded = self.decoder.decode_blocks(&mut self.input, BlockDecodingStrategy::UptoBlocks(1));
                decoded.map_err(zstd_error)?;
            }
            let read = self.decoder.read(buffer)?;
            if read > 0 {
                self.frame_bytes += read as u64;
                return Ok(read);
            }
            if self.decoder.is_finished() {
                self.end()?;
            }
        }
        Ok(0)
    }
}

/// An end of the input within a frame is one of its causes.
fn zstd_error(error: FrameDecoderError) -> io::Error {
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
    while let Some(one) = cause {
        if one.downcast_ref::<io::Error>().is_some_and(|error| error.kind() == io::ErrorKind::UnexpectedEof) {
            return io::ErrorKind::UnexpectedEof.into();
        }
        cause = one.source();
    }
    io::Error::new(io::ErrorKind::InvalidData, error.to_string())
}
