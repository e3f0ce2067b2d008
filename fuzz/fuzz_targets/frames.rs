//! A stream of frames that arrives in pieces: the same frames as when all of it is there, and the same refusal.
#![no_main]

use cluster::protocol::connection::read_buffer::ReadBuffer;
use cluster::protocol::frame::{self, PREFIX_BYTES};
use libfuzzer_sys::fuzz_target;

const FRAME_BYTES_MAX: usize = 300;

fn whole(mut stream: &[u8]) -> (Vec<Vec<u8>>, bool) {
    let mut frames = Vec::new();
    loop {
        match frame::first_frame(stream, FRAME_BYTES_MAX) {
            Ok(Some(frame)) => {
                frames.push(frame.to_vec());
                stream = &stream[PREFIX_BYTES + frame.len()..];
            }
            Ok(None) => return (frames, true),
            Err(_) => return (frames, false),
        }
    }
}

fn in_pieces(mut stream: &[u8], piece: usize) -> (Vec<Vec<u8>>, bool) {
    let (mut frames, mut buffer) = (Vec::new(), ReadBuffer::with_room(8));
    loop {
        match buffer.whole_frame(FRAME_BYTES_MAX) {
            Ok(Some(bytes)) => frames.push(buffer.take(bytes).to_vec()),
            Ok(None) => {
                let (mut now, later) = stream.split_at(piece.min(stream.len()));
                let before = now.len();
                if buffer.fill_from(&mut now).is_err() {
                    return (frames, true);
                }
                stream = &stream[before - now.len()..];
                assert!(stream.len() >= later.len());
            }
            Err(_) => return (frames, false),
        }
    }
}

fuzz_target!(|data: &[u8]| {
    if let Some((piece, stream)) = data.split_first() {
        assert_eq!(in_pieces(stream, 1 + usize::from(*piece)), whole(stream));
    }
});
