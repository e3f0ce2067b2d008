//! Reads a recording of references, and replays it through memories of other sizes:
//!
//! ```text
//! marti run topologies/teapot.toml --record references --out out/teapot
//! cargo run --release --example read_recording -- out/teapot
//! ```

use std::error::Error;
use std::path::Path;

use marti::machine::specification::MemorySize;
use marti::open_references;
use marti::replay::evaluation::{Evaluation, evaluate};
use marti::replay::setting::Setting;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("expected the folder of a run with --record references")?;
    let opened = open_references(Path::new(&folder))?;
    for fault in &opened.faults {
        eprintln!("warning: {fault}");
    }
    let recording = opened.recording;
    println!("{} references of records, database of {} bytes", recording.references, recording.layout.database_bytes());

    let recorded = Setting::recorded(&recording.conditions.cluster, recording.conditions.tile_order);
    let sizes = [2, 4, 8, 16, 32].map(|denominator| MemorySize::Share { numerator: 1, denominator });
    let settings = sizes.map(|local_memory| Setting { local_memory, ..recorded });
    let rows = evaluate(&recording, &settings, &Evaluation::default(), |_| ())?;
    println!("{:<10}{:>18}{:>18}", "memory", "record accesses", "record misses");
    for (size, row) in sizes.iter().zip(&rows) {
        println!("{:<10}{:>18}{:>18}", size.to_string(), row.counts.record_accesses, row.counts.misses);
    }
    Ok(())
}
