//! A topology file, then overrides (`--set`), each behind a NUL. What is accepted is written, and reads back as it was.
#![no_main]

use cluster::topology::{Override, Topology};
use libfuzzer_sys::fuzz_target;
use marti_fuzz::{split, with_file};

fuzz_target!(|data: &[u8]| {
    let (text, mut rest) = split(data);
    let mut overrides = Vec::new();
    while !rest.is_empty() {
        let (one, behind) = split(rest);
        overrides.extend(std::str::from_utf8(one).ok().and_then(|text| text.parse::<Override>().ok()));
        rest = behind;
    }
    let Ok(topology) = with_file("t.toml", text, |file| Topology::read(file, &overrides)) else { return };
    let placement = topology.placement();
    topology.cluster.ids().for_each(|cluster| _ = placement.of_cluster(cluster));
    let written = topology.to_toml().expect("what was read can be written");
    let again = with_file("t.toml", written.as_bytes(), |file| Topology::read(file, &[]));
    assert_eq!(again.expect("what was written can be read"), topology);
});
