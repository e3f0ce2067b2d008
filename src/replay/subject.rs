//! What can be put through other machines: a trace whose records have a place in an image.

use super::{Lines, RecordLines, Trace};
use crate::database::Section;
use crate::ids::TileId;
use crate::machine::references::RecordNumbers;
use crate::recording::references::Recording;
use crate::tile_order;
use crate::topology::{Bus, Processor, TileOrder};

/// A trace, and what simulations must know besides.
pub trait Subject: Trace {
    type Lines: Lines;

    /// Where records lie, for lines of so many bytes.
    fn lines(&self, line_bytes: u32) -> Self::Lines;

    /// Of which shares are taken; a multiple of 256.
    fn image_bytes(&self) -> u64;

    /// By section: 32-bit words of its records, and their numbers.
    fn record_words(&self) -> Vec<(u32, std::ops::Range<u32>)>;

    /// The tiles in an order of handing out, as indices into those of the trace; `None` for one that it does not have.
    fn ordered(&self, order: TileOrder) -> Vec<Option<u32>>;

    /// Seeds random replacement.
    fn seed(&self) -> u64;

    /// The recorded cost model.
    fn costs(&self) -> (Processor, Bus);
}

impl Subject for Recording {
    type Lines = RecordLines;

    fn lines(&self, line_bytes: u32) -> RecordLines {
        RecordLines::new(&self.layout, line_bytes)
    }

    fn image_bytes(&self) -> u64 {
        self.layout.image_bytes()
    }

    fn record_words(&self) -> Vec<(u32, std::ops::Range<u32>)> {
        let numbers = RecordNumbers::new(&self.layout);
        Section::ALL.map(|section| (section.record_bytes() as u32 / 4, numbers.section(section))).to_vec()
    }

    fn ordered(&self, order: TileOrder) -> Vec<Option<u32>> {
        let mut places = vec![None; self.tiling.tile_count() as usize];
        for (i, tile) in (0..).zip(self.tiles()).filter(|(_, tile)| tile.accepted) {
            places[tile.tile.0 as usize] = Some(i);
        }
        let order = tile_order::tiles(order, self.tiling, self.topology.run.seed);
        order.into_iter().map(|TileId(tile)| places[tile as usize]).collect()
    }

    fn seed(&self) -> u64 {
        self.topology.run.seed
    }

    fn costs(&self) -> (Processor, Bus) {
        (self.topology.cluster.processor, self.topology.cluster.bus)
    }
}
