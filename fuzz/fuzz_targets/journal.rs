//! The display's journal. Reader and writer see the same records; after the writer has cut it, it is whole.
#![no_main]

use cluster::journal::{Journal, Next, Reader, Record, Start, Subject};
use ground::ids::Producer;
use libfuzzer_sys::fuzz_target;
use marti_fuzz::with_file;
use trace::picture::{AovSet, Sides, Tiling};

const SUBJECT: Subject = Subject {
    tiling: Tiling::new(Sides { width: 5, height: 3, tile_width: 2, tile_height: 2 }).expect("possible"),
    aov: AovSet { depth: true, normal: false, primitive: false },
    fingerprint: [7; 32],
};

/// Records, and whether the journal is whole; `None`: it is no journal of this.
fn read(bytes: &[u8]) -> Option<(usize, bool)> {
    let mut reader = Reader::new(bytes, SUBJECT);
    if reader.start().ok()? == Start::Torn {
        return Some((0, false));
    }
    let mut records = 0;
    loop {
        match reader.next_record().expect("bytes can be read") {
            Next::Record(_) => records += 1,
            Next::End => return Some((records, true)),
            Next::Damaged(_) => return Some((records, false)),
        }
    }
}

fuzz_target!(|data: &[u8]| {
    let found = read(data);
    with_file("tiles", data, |path| {
        let _ = Journal::planes(path);
        let mut restored = 0;
        let opened = Journal::open(path, &SUBJECT, true, |_| restored += 1);
        assert_eq!(opened.is_ok(), found.is_some());
        let (Ok((mut journal, _)), Some((records, _))) = (opened, found) else { return };
        assert_eq!(restored, records);
        journal.append(&Record::Condemned(Producer::default())).expect("TMPDIR is writable");
        let bytes = std::fs::read(path).expect("it is there");
        assert_eq!(read(&bytes), Some((records + 1, true)), "what was cut and appended to is whole");
    });
});
