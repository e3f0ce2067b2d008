//! What can be put through other machines: a trace whose records have a place in an image.

use crate::hardware::local_memory::{Geometry, GeometryError};
use crate::hardware::references::RecordNumbers;
use crate::hardware::specification::{LocalMemory, Processor};
use crate::recording::references::Recording;
use crate::replay::contention::ReadCycles;
use crate::replay::importers::{Imported, LINE_BYTES_MAX, TableLines};
use crate::replay::{Lines, RecordLines, Trace};
use crate::tile_order;
use crate::tile_order::TileOrder;
use ground::ids::TileId;
use trace::database::{Layout, Section};
use trace::picture::Tiling;

/// A trace, and what simulations must know besides.
pub trait Subject: Trace {
    type Lines: Lines;

    /// Where records lie, for lines of so many bytes.
    fn lines(&self, line_bytes: u32) -> Self::Lines;

    /// A memory that is asked for, resolved for all that this trace references.
    ///
    /// # Errors
    /// It cannot be made.
    fn geometry(&self, memory: &LocalMemory) -> Result<Geometry, GeometryError>;

    /// The kind of record that this is, below the length of the following two.
    fn kind(&self, record: u32) -> usize;

    /// By kind: 32-bit words of a record.
    fn record_words(&self) -> Vec<u32>;

    /// By kind: what this processor spends on a record that it reads.
    fn read_cycles(&self, processor: &Processor) -> Vec<u32>;

    /// Of a tile of the trace.
    fn pixels(&self, tile: u32) -> u32;

    /// The tiles in an order of handing out, as indices into those of the trace; `None` for one that it does not have.
    fn ordered(&self, order: TileOrder) -> Vec<Option<u32>>;

    /// Seeds random replacement.
    fn seed(&self) -> u64;

    /// The trace, if it has something else than reads.
    fn with_writes(&self) -> Option<&Imported> {
        None
    }
}

/// A trace of the records of a database.
pub trait DatabaseTrace: Trace {
    fn source(&self) -> TraceSource<'_>;
}

/// The database and the image that a trace is of.
#[derive(Clone, Copy, Debug)]
pub struct TraceSource<'a> {
    pub layout: &'a Layout,
    pub numbers: &'a RecordNumbers,
    pub tiling: Tiling,
    /// Of random replacement and random order.
    pub seed: u64,
}

impl DatabaseTrace for Recording {
    #[inline(always)]
    fn source(&self) -> TraceSource<'_> {
        let Self { layout, numbers, tiling, conditions, .. } = self;
        TraceSource { layout, numbers, tiling: *tiling, seed: conditions.seed }
    }
}

/// Kinds are sections.
impl<T: DatabaseTrace> Subject for T {
    type Lines = RecordLines;

    fn lines(&self, line_bytes: u32) -> RecordLines {
        RecordLines::new(self.source().layout, line_bytes)
    }

    fn geometry(&self, memory: &LocalMemory) -> Result<Geometry, GeometryError> {
        Geometry::new(memory, self.source().layout)
    }

    #[inline(always)]
    fn kind(&self, record: u32) -> usize {
        self.source().numbers.place(record).0 as usize
    }

    fn record_words(&self) -> Vec<u32> {
        self.source().layout.strides().bytes().map(|bytes| bytes / 4).to_vec()
    }

    fn read_cycles(&self, processor: &Processor) -> Vec<u32> {
        let cycles = ReadCycles::new(processor);
        Section::ALL.map(|section| cycles.of(section)).to_vec()
    }

    fn pixels(&self, tile: u32) -> u32 {
        let rect = self.source().tiling.rect(self.tiles()[tile as usize].tile);
        rect.map_or(0, |rect| rect.width * rect.height)
    }

    fn ordered(&self, order: TileOrder) -> Vec<Option<u32>> {
        let mut places = vec![None; self.source().tiling.tile_count() as usize];
        for (i, tile) in (0..).zip(self.tiles()).filter(|(_, tile)| tile.accepted) {
            places[tile.tile.0 as usize] = Some(i);
        }
        let order = tile_order::tiles(order, self.source().tiling, self.source().seed);
        order.into_iter().map(|TileId(tile)| places[tile as usize]).collect()
    }

    fn seed(&self) -> u64 {
        self.source().seed
    }
}

/// One stream of one node. Nothing is known of what was read but its size: a read costs its access.
impl Subject for Imported {
    type Lines = TableLines;

    fn lines(&self, line_bytes: u32) -> TableLines {
        self.lines(line_bytes)
    }

    fn geometry(&self, memory: &LocalMemory) -> Result<Geometry, GeometryError> {
        if !self.is_of_objects() {
            Geometry::check_line(memory.line, LINE_BYTES_MAX)?;
        }
        Geometry::of_lines(memory, self.lines(memory.line).count())
    }

    #[inline(always)]
    fn kind(&self, record: u32) -> usize {
        self.kind(record)
    }

    fn record_words(&self) -> Vec<u32> {
        self.record_words().to_vec()
    }

    fn read_cycles(&self, processor: &Processor) -> Vec<u32> {
        vec![processor.local_access; self.record_words().len()]
    }

    fn pixels(&self, _tile: u32) -> u32 {
        0
    }

    fn ordered(&self, _order: TileOrder) -> Vec<Option<u32>> {
        vec![Some(0)]
    }

    fn seed(&self) -> u64 {
        1
    }

    fn with_writes(&self) -> Option<&Imported> {
        let notes = self.notes();
        (notes.writes + notes.copy_backs + notes.invalidations > 0).then_some(self)
    }
}
