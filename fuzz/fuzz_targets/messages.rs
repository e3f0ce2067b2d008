//! Every message of the wire: the first byte says which. What is decoded is encoded again, and that is decoded again.
#![no_main]

use cluster::protocol::control::{
    Bootstrap, BusCommand, BusReport, DisplayCommand, DisplayReport, MasterCommand, MasterReport, NodeCommand,
    NodeReport,
};
use cluster::protocol::frame::{self, Message};
use cluster::protocol::hello::{Hello, HelloPrelude, HelloReply};
use cluster::protocol::image::{ImageReply, TilePixels};
use cluster::protocol::join::{JoinReply, JoinRequest};
use cluster::protocol::memory::{MemoryReply, MemoryRequest};
use cluster::protocol::work::{WorkReply, WorkRequest};
use libfuzzer_sys::fuzz_target;

fn decode<M: Message>(frame: &[u8]) {
    let Ok((message, bulk)) = frame::decode::<M>(frame) else { return };
    let encoded = frame::encode(&message, bulk).expect("what was decoded can be sent");
    let inner = frame::first_frame(&encoded, frame::frame_bytes_max::<M>()).expect("not too long").expect("whole");
    let (message, bulk) = frame::decode::<M>(inner).expect("what was sent can be decoded");
    assert_eq!(frame::encode(&message, bulk).expect("again"), encoded);
}

const DECODERS: [fn(&[u8]); 20] = [
    decode::<Bootstrap>,
    decode::<HelloPrelude>,
    decode::<Hello>,
    decode::<HelloReply>,
    decode::<JoinRequest>,
    decode::<JoinReply>,
    decode::<BusCommand>,
    decode::<BusReport>,
    decode::<MasterCommand>,
    decode::<MasterReport>,
    decode::<NodeCommand>,
    decode::<NodeReport>,
    decode::<DisplayCommand>,
    decode::<DisplayReport>,
    decode::<MemoryRequest>,
    decode::<MemoryReply>,
    decode::<WorkRequest>,
    decode::<WorkReply>,
    decode::<TilePixels>,
    decode::<ImageReply>,
];

fuzz_target!(|data: &[u8]| {
    if let Some((which, frame)) = data.split_first() {
        DECODERS[usize::from(*which) % DECODERS.len()](frame);
    }
});
