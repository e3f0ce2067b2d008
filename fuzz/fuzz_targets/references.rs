//! A recording of references: `references.json`, a NUL, the stream of node 0. All that is whole in it is read.
#![no_main]

use cluster::topology::recorded::open_references;
use ground::ids::{Epoch, NodeId};
use libfuzzer_sys::fuzz_target;
use machine::hardware::trace::Trace;
use machine::recording::references::{SIDECAR_NAME, cut_torn_tails, file_name, scan};
use marti_fuzz::{split, with_folder};

fuzz_target!(|data: &[u8]| {
    let (sidecar, stream) = split(data);
    let name = file_name(NodeId(0), Epoch(0));
    with_folder(&[(SIDECAR_NAME, sidecar), (&name, stream)], |folder| {
        let _ = cut_torn_tails(folder);
        let Ok(opened) = open_references(folder) else { return };
        let recording = opened.recording;
        let _ = scan(folder, &recording.layout);
        let mut words = Vec::new();
        for part in recording.tiles().iter().flat_map(|tile| tile.parts.clone()) {
            recording.read(part, &mut words).expect("it was checked when it was opened");
        }
    });
});
