//! A database as it comes from a bus, of any bytes: so many records a section, how they are padded, then the image. A node with a small
//! memory traces it unseen and must end; one with all of it checks it first, and what passes is traced by every kernel.
//! An octree that leaves something out passes, so that the images need not be the same.
#![no_main]

use std::sync::Arc;

use ground::ids::Address;
use libfuzzer_sys::fuzz_target;
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::local_memory::{Geometry, LocalMemory};
use machine::hardware::replacement::Lru;
use machine::hardware::specification::{LocalMemory as Settings, MemorySize, Replacement};
use marti_fuzz::{IMAGE, images, view_of};
use trace::database::strides::Strides;
use trace::database::verify::Verified;
use trace::database::{Database, Header, Layout, Normalisation, Section};
use trace::picture::{AovSet, Rect};
use trace::scene::{Camera, UpAxis};
use trace::tracer::{TileTracer, View};

/// Traces as a node with 1 KiB does: what it reads is checked record by record, as it comes.
fn unseen(header: &Header, bytes: &[u8], view: &View) {
    let mut cluster = ClusterMemory::new(&header.layout);
    cluster.store(Address(0), bytes).expect("the whole of it");
    let settings = Settings { size: MemorySize::Bytes(1 << 10), line: 64, ways: None, replacement: Replacement::Lru };
    let Ok(geometry) = Geometry::new(&settings, &header.layout) else { return };
    let mut memory = LocalMemory::<Lru, _>::new(geometry, &header.layout, 1, &cluster);
    let mut tracer = TileTracer::new(header, view, true);
    let whole = Rect { x: 0, y: 0, width: IMAGE.width(), height: IMAGE.height() };
    let _ = tracer.trace(&mut memory, whole, AovSet::default());
}

fuzz_target!(|data: &[u8]| {
    let Some((counts, data)) = data.split_at_checked(Section::COUNT + 2) else { return };
    let records = std::array::from_fn(|section| u64::from(counts[section]));
    // Triangles and polygons, by so many words.
    let padding = 4 * u32::from(counts[Section::COUNT + 1] % 112);
    let mut strides = Strides::CONTENT.bytes();
    [Section::Triangles, Section::Polygons].into_iter().for_each(|section| strides[section as usize] += padding);
    let layout = Layout::padded(records, Strides::new(strides).expect("at most 496 bytes")).expect("small");
    let header = Header {
        layout,
        normalisation: Normalisation::new(None),
        max_depth: u32::from(counts[Section::COUNT]),
        scene_primitives: 1,
        has_sheets: false,
    };
    let mut bytes = data.to_vec();
    bytes.resize(header.layout.database_bytes() as usize, 0);
    let view = view_of(Camera::framing(None, UpAxis::Y, 1.0, 45.0));
    unseen(&header, &bytes, &view);
    let words = bytes.chunks_exact(4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]])).collect();
    if let Ok(database) = Verified::new(Database { header, words: Arc::new(words) }) {
        images(&database, &view);
    }
});
