//! A replacement policy of one's own, beside LRU, on the references of a scene:
//! `cargo run --release --example replacement_policy`.

use std::error::Error;

use marti::machine::local_memory::Geometry;
use marti::machine::replacement::{Lru, Replacement};
use marti::machine::specification::{self, LocalMemory, MemorySize};
use marti::picture::{Sides, Tiling};
use marti::replay::replayer::{Replayer, Sum};
use marti::replay::{Captured, RecordLines};
use marti::{ImageSettings, Octree, SceneSource, ViewChoices, build_database, view};

/// Not recently used with one bit per slot, as many processors have it instead of LRU: the victim is the first slot whose
/// bit is clear, and when all bits of a set would be set, the others are cleared.
struct OneBit {
    ways: u32,
    used: Vec<bool>,
}

impl OneBit {
    fn touch(&mut self, slot: u32) {
        let first = slot / self.ways * self.ways;
        let set = &mut self.used[first as usize..(first + self.ways) as usize];
        set[(slot - first) as usize] = true;
        if set.iter().all(|used| *used) {
            set.fill(false);
            set[(slot - first) as usize] = self.ways > 1;
        }
    }
}

impl Replacement for OneBit {
    fn new(sets: u32, ways: u32, _seed: u64) -> Self {
        Self { ways, used: vec![false; (sets * ways) as usize] }
    }

    fn hit(&mut self, slot: u32) {
        self.touch(slot);
    }

    fn victim(&mut self, set: u32) -> u32 {
        let first = set * self.ways;
        (first..first + self.ways).find(|slot| !self.used[*slot as usize]).unwrap_or(first)
    }

    fn fill(&mut self, slot: u32, _line: u32) {
        self.touch(slot);
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let scene = "teapot:6".parse::<SceneSource>()?.load()?;
    let settings = ImageSettings::new(128, 128, ImageSettings::DEPTH_DEFAULT, 0.0)?;
    let view = view(&scene, &ViewChoices::default(), |_| Ok(settings))?;
    let database = build_database(&scene, Octree::DEFAULT.into())?;
    let tiling = Tiling::try_from(Sides { width: 128, height: 128, tile_width: 8, tile_height: 8 })?;
    // Every record that a node reads, whatever its memory.
    let trace = Captured::capture(&database, &view, tiling, true, 1);

    let layout = &database.database().header.layout;
    let lines = RecordLines::new(layout, 64);
    println!("{:<10}{:>16}{:>16}", "share", "LRU misses", "one bit misses");
    for denominator in [2, 4, 8, 16, 32] {
        let size = MemorySize::Share { numerator: 1, denominator };
        let memory = LocalMemory { size, line: 64, ways: None, replacement: specification::Replacement::Lru };
        let geometry = Geometry::new(&memory, layout)?;
        let misses = [misses::<Lru>(&trace, &lines, geometry)?, misses::<OneBit>(&trace, &lines, geometry)?];
        println!("{:<10}{:>16}{:>16}", size.to_string(), misses[0], misses[1]);
    }
    Ok(())
}

fn misses<R: Replacement>(trace: &Captured, lines: &RecordLines, geometry: Geometry) -> Result<u64, Box<dyn Error>> {
    let (mut memory, mut sum) = (Replayer::<R, _>::new(lines, geometry, 1)?, Sum::new(trace));
    for tile in 0..trace.tiles.len() as u32 {
        memory.tile(trace, tile, &mut sum)?;
    }
    Ok(sum.finish().line_misses)
}
