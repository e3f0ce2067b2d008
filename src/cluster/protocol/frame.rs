//! Messages to bytes and back: the only file that names the codec crate.
//!
//! A frame is a length (4 bytes, big-endian, of what follows), one message, and raw bulk bytes up to the
//! frame's end. Bulk bytes (lines, pixels, uploads) never pass through the codec, which would take them
//! one by one. Integers have fixed width, so that a message's size is known beforehand.

use bincode::config::{Configuration, Fixint, LittleEndian, standard};
use bincode::serde::{decode_from_slice, encode_into_std_write};
use serde::{Serialize, de::DeserializeOwned};

/// Bytes of a frame's length.
pub const PREFIX_BYTES: usize = 4;

const CONFIGURATION: Configuration<LittleEndian, Fixint> = standard().with_fixed_int_encoding();

/// What a frame may hold. Implemented by `messages` alone, beside each message.
pub trait Message: Serialize + DeserializeOwned + Send + 'static {
    /// For errors.
    const NAME: &'static str;
    /// Most bytes of the encoded message, without bulk bytes.
    const BYTES_MAX: usize;
    /// Most bulk bytes that may follow the message; 0 where the conversation has none.
    const BULK_BYTES_MAX: usize;

    /// The message at the start of `bytes` and how many bytes it takes. Never allocates more than
    /// [`Self::BYTES_MAX`], whatever lengths the bytes claim.
    ///
    /// # Errors
    /// The bytes are not such a message.
    fn decode_start(bytes: &[u8]) -> Result<(Self, usize), CodecError>;
}

/// Makes messages of types, with the most bytes of each and of the bulk bytes that may follow it.
macro_rules! messages {
    ($($name:ident: $bytes_max:expr, bulk $bulk_bytes_max:expr;)*) => { $(
        impl $crate::protocol::frame::Message for $name {
            const NAME: &'static str = stringify!($name);
            const BYTES_MAX: usize = $bytes_max;
            const BULK_BYTES_MAX: usize = $bulk_bytes_max;

            fn decode_start(bytes: &[u8]) -> Result<(Self, usize), $crate::protocol::frame::CodecError> {
                $crate::protocol::frame::decode_within::<Self, { $bytes_max }>(bytes)
            }
        }
    )* };
}

pub(super) use messages;

/// The message at the start of `bytes`, for which at most `LIMIT` bytes are allocated.
pub(super) fn decode_within<M: Message, const LIMIT: usize>(bytes: &[u8]) -> Result<(M, usize), CodecError> {
    decode_from_slice(bytes, CONFIGURATION.with_limit::<LIMIT>())
        .map_err(|error| CodecError::Malformed { name: M::NAME, why: error.to_string() })
}

/// Most bytes that may follow the length of a frame with such a message.
pub const fn frame_bytes_max<M: Message>() -> usize {
    M::BYTES_MAX + M::BULK_BYTES_MAX
}

/// A frame that is too long, or does not hold what it should.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum CodecError {
    #[error("a frame of {bytes} bytes, at most {bytes_max} are allowed here")]
    FrameTooLong { bytes: usize, bytes_max: usize },
    #[error("a {name} of {bytes} bytes, at most {bytes_max} are allowed")]
    MessageTooLong { name: &'static str, bytes: usize, bytes_max: usize },
    #[error("a {name} followed by {bytes} bulk bytes, at most {bytes_max} are allowed")]
    UnexpectedBulk { name: &'static str, bytes: usize, bytes_max: usize },
    #[error("not a {name}: {why}")]
    Malformed { name: &'static str, why: String },
}

/// A whole frame, its length included.
///
/// # Errors
/// The message or the bulk bytes are longer than allowed, or a path in the message is not UTF-8.
pub fn encode<M: Message>(message: &M, bulk: &[u8]) -> Result<Vec<u8>, CodecError> {
    let mut out = Vec::with_capacity(PREFIX_BYTES + 64 + bulk.len());
    encode_into(message, &mut out, |out| out.extend_from_slice(bulk))?;
    Ok(out)
}

/// Appends a whole frame to `out`, its length included; `append_bulk` appends the bulk bytes.
/// Allocates nothing when `out` has room.
///
/// # Errors
/// As [`encode`]; `out` is then as it was.
pub fn encode_into<M: Message>(
    message: &M,
    out: &mut Vec<u8>,
    append_bulk: impl FnOnce(&mut Vec<u8>),
) -> Result<(), CodecError> {
    let start = out.len();
    encode_head(message, 0, out)?;
    let head_end = out.len();
    append_bulk(out);
    let (head, bulk) = out[start..].split_at_mut(head_end - start);
    let result = write_length::<M>(head, bulk.len());
    if result.is_err() {
        out.truncate(start);
    }
    result
}

/// Appends the start of a frame to `out`: its length and the message. So many bulk bytes are to follow.
///
/// # Errors
/// As [`encode`]; `out` is then as it was.
pub fn encode_head<M: Message>(message: &M, bulk_bytes: usize, out: &mut Vec<u8>) -> Result<(), CodecError> {
    let start = out.len();
    out.extend_from_slice(&[0; PREFIX_BYTES]);
    let encoded = encode_into_std_write(message, out, CONFIGURATION)
        .map_err(|error| CodecError::Malformed { name: M::NAME, why: error.to_string() });
    let result = encoded.and_then(|bytes| {
        if bytes > M::BYTES_MAX {
            return Err(CodecError::MessageTooLong { name: M::NAME, bytes, bytes_max: M::BYTES_MAX });
        }
        write_length::<M>(&mut out[start..], bulk_bytes)
    });
    if result.is_err() {
        out.truncate(start);
    }
    result
}

/// Writes the length of a frame whose start is `head`.
fn write_length<M: Message>(head: &mut [u8], bulk_bytes: usize) -> Result<(), CodecError> {
    check_bulk::<M>(bulk_bytes)?;
    let bytes = head.len() - PREFIX_BYTES + bulk_bytes;
    // Cannot fail: no message and its bulk bytes may be longer than a u32 together.
    let length = u32::try_from(bytes).map_err(|_| CodecError::FrameTooLong { bytes, bytes_max: u32::MAX as usize })?;
    head[..PREFIX_BYTES].copy_from_slice(&length.to_be_bytes());
    Ok(())
}

/// The message and the bulk bytes of a frame, given without its length.
///
/// # Errors
/// The frame does not begin with such a message, or more bulk bytes follow than it may have.
pub fn decode<M: Message>(frame: &[u8]) -> Result<(M, &[u8]), CodecError> {
    let (message, bytes) = M::decode_start(frame)?;
    let bulk = frame.get(bytes..).unwrap_or_default();
    check_bulk::<M>(bulk.len())?;
    Ok((message, bulk))
}

/// The message of a frame without bulk bytes, given without its length.
///
/// # Errors
/// The frame does not hold such a message, and nothing else.
pub fn decode_whole<M: Message>(frame: &[u8]) -> Result<M, CodecError> {
    match decode(frame)? {
        (message, []) => Ok(message),
        (_, bulk) => Err(CodecError::UnexpectedBulk { name: M::NAME, bytes: bulk.len(), bytes_max: 0 }),
    }
}

fn check_bulk<M: Message>(bytes: usize) -> Result<(), CodecError> {
    if bytes > M::BULK_BYTES_MAX {
        return Err(CodecError::UnexpectedBulk { name: M::NAME, bytes, bytes_max: M::BULK_BYTES_MAX });
    }
    Ok(())
}

/// Bytes of the frame at the start of `received`, without its length; `None` while the length itself is
/// not whole. The frame may not be whole yet.
///
/// # Errors
/// The frame is longer than `bytes_max`.
pub fn frame_bytes(received: &[u8], bytes_max: usize) -> Result<Option<usize>, CodecError> {
    let Some(prefix) = received.first_chunk::<PREFIX_BYTES>() else {
        return Ok(None);
    };
    let bytes = u32::from_be_bytes(*prefix) as usize;
    if bytes > bytes_max {
        return Err(CodecError::FrameTooLong { bytes, bytes_max });
    }
    Ok(Some(bytes))
}

/// The frame at the start of `received`, without its length; `None` while it is not whole.
///
/// # Errors
/// The frame is longer than `bytes_max`.
pub fn first_frame(received: &[u8], bytes_max: usize) -> Result<Option<&[u8]>, CodecError> {
    let bytes = frame_bytes(received, bytes_max)?;
    Ok(bytes.and_then(|bytes| received.get(PREFIX_BYTES..PREFIX_BYTES + bytes)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::protocol::control::{BusCommand, DisplayReport, MasterReport, NodeCommand};
    use crate::protocol::control::{Holdings, PRODUCERS_MAX, Share, TileSet};
    use crate::protocol::hello::{HELLO_BYTES_MAX, Hello, HelloReply};
    use crate::protocol::hello::{Role, RunToken};
    use crate::protocol::image::TilePixels;
    use crate::protocol::mac::Mac;
    use crate::protocol::memory::{MemoryReply, MemoryRequest};
    use crate::protocol::work::TileDone;
    use crate::protocol::work::WorkRequest;
    use ground::ids::Producer;
    use ground::ids::{Address, Attempt, Epoch, NodeId, TileId};
    use machine::hardware::stats::MemoryStats;
    use machine::hardware::totals::LostAttempt;
    use trace::tracer::TraceStats;

    fn fetch() -> MemoryRequest {
        MemoryRequest::Fetch {
            tile: TileId(7),
            attempt: Attempt(1),
            section: trace::database::Section::Triangles,
            address: Address(0x1_0000),
            line_bytes: 256,
            lines: u32::MAX,
            accesses_before: u64::MAX,
        }
    }

    fn tile_done() -> TileDone {
        let mut memory = MemoryStats::default();
        for (i, counters) in memory.counters.as_flattened_mut().iter_mut().enumerate() {
            counters.line_accesses = u64::MAX - i as u64;
        }
        let trace = TraceStats { primitive_tests: u64::MAX, ..TraceStats::default() };
        TileDone { tile: TileId(1), attempt: Attempt(2), trace, memory: Some(memory), render_cpu_nanoseconds: 3 }
    }

    #[track_caller]
    fn round_trip<M: Message + PartialEq + std::fmt::Debug>(message: M, bulk: &[u8]) {
        let bytes = encode(&message, bulk).expect("within its limits");
        let frame = first_frame(&bytes, frame_bytes_max::<M>()).expect("not too long").expect("whole");
        assert_eq!(frame.len() + PREFIX_BYTES, bytes.len());
        assert_eq!(decode::<M>(frame), Ok((message, bulk)));
        for cut in 0..bytes.len() {
            assert_eq!(first_frame(&bytes[..cut], frame_bytes_max::<M>()), Ok(None), "{cut} bytes are no whole frame");
        }
    }

    #[test]
    fn messages_come_back_with_their_bulk_bytes() {
        round_trip(Hello::new(Role::Node(NodeId(3)), Epoch(1), RunToken::new([9; 32])), &[]);
        round_trip(HelloReply::Refused("expected another".to_owned()), &[]);
        round_trip(fetch(), &[]);
        round_trip(MemoryRequest::Store { address: Address(256) }, &[1, 2, 3]);
        round_trip(MemoryReply::Data { bytes: 3 }, &[1, 2, 3]);
        round_trip(TilePixels { tile: TileId(1), attempt: Attempt(0), permit: Mac::default(), crc32c: 7 }, &[5; 300]);
        round_trip(WorkRequest::Done { done: Box::new(tile_done()), receipt: Mac::default() }, &[]);
        let lost = LostAttempt { tile: TileId(2), attempt: Attempt(3) };
        round_trip(BusCommand::Finish { lost: vec![lost; 1000] }, &[]);
    }

    /// However many tiles an image has, and however many processes rendered them, one message has room.
    #[test]
    fn the_largest_image_fits_a_report_of_the_display() {
        let tiles: TileSet = (0..1 << 24).map(|_| true).collect();
        let producer = Producer::default();
        let condemned = DisplayReport::Condemned(producer, tiles.clone());
        assert!(encode(&condemned, &[]).is_ok());
        let shares = vec![Share { producer, tiles: 1, latest: TileId(0) }; PRODUCERS_MAX];
        assert!(encode(&DisplayReport::Restored(Holdings { tiles, shares }), &[]).is_ok());
    }

    #[test]
    fn several_frames_are_appended_to_one_buffer() {
        let mut out = vec![0xAA];
        encode_into(&fetch(), &mut out, |_| ()).expect("short");
        let first = out.len();
        encode_into(&MemoryRequest::Store { address: Address(0) }, &mut out, |out| out.push(1)).expect("short");
        let frame = first_frame(&out[1..], 1000).expect("not too long").expect("whole");
        assert_eq!(decode(frame), Ok((fetch(), &[][..])));
        let frame = first_frame(&out[first..], 1000).expect("not too long").expect("whole");
        assert_eq!(decode(frame), Ok((MemoryRequest::Store { address: Address(0) }, &[1][..])));
    }

    #[test]
    fn a_frame_that_claims_4_gib_is_refused_by_its_first_four_bytes() {
        let expected = CodecError::FrameTooLong { bytes: u32::MAX as usize, bytes_max: HELLO_BYTES_MAX };
        assert_eq!(frame_bytes(&[0xff; 4], HELLO_BYTES_MAX), Err(expected));
    }

    #[test]
    fn a_length_inside_of_a_message_is_not_believed() {
        // A refusal of 2^40 bytes, then of one byte more than there may be: neither is allocated.
        for claimed in [1u64 << 40, HELLO_BYTES_MAX as u64] {
            let frame = [&1u32.to_le_bytes()[..], &claimed.to_le_bytes(), b"short"].concat();
            let error = decode::<HelloReply>(&frame).expect_err("a claim");
            assert!(matches!(error, CodecError::Malformed { name: "HelloReply", .. }), "{error}");
        }
        // Two thousand million lost attempts in a frame that ends after the first.
        let frame = [&1u32.to_le_bytes()[..], &(2u64 << 30).to_le_bytes(), &[0; 10]].concat();
        assert!(decode::<BusCommand>(&frame).is_err());
    }

    #[test]
    fn bytes_behind_a_message_are_bulk_or_an_error() {
        let frame = &encode(&WorkRequest::Ready, &[]).expect("short")[PREFIX_BYTES..];
        let longer = [frame, &[0]].concat();
        let expected = CodecError::UnexpectedBulk { name: "WorkRequest", bytes: 1, bytes_max: 0 };
        assert_eq!(decode::<WorkRequest>(&longer), Err(expected.clone()));
        assert_eq!(encode(&WorkRequest::Ready, &[0]), Err(expected));
    }

    #[test]
    fn what_is_too_long_is_not_sent_and_leaves_no_trace() {
        let long = HelloReply::Refused("x".repeat(HELLO_BYTES_MAX));
        let mut out = vec![1, 2];
        let error = encode_into(&long, &mut out, |_| ()).expect_err("too long");
        assert!(matches!(error, CodecError::MessageTooLong { name: "HelloReply", bytes_max: HELLO_BYTES_MAX, .. }));
        assert_eq!(out, [1, 2]);
    }

    proptest! {
        #[test]
        fn garbage_decodes_to_an_error_or_a_message_but_never_panics(frame in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = decode::<Hello>(&frame);
            let _ = decode::<MemoryRequest>(&frame);
            let _ = decode::<NodeCommand>(&frame);
            let _ = decode::<MasterReport>(&frame);
            let _ = decode::<TilePixels>(&frame);
            let _ = first_frame(&frame, 100);
        }
    }
}
