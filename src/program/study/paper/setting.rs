//! A setting under which Table 1 is computed, the same for both scenes: all that the paper leaves open.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::study::figures::conditions::octree;
use crate::study::figures::ratio::Ratio;
use machine::replay::plan::setting::Assignment;
use trace::database::{Objects, RecordLayout};
use trace::scene::procedural::Board;
use trace::tracer::octree::Octree;

/// What the teapot is on, how the octree is built, and what a memory holds and counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    pub board: Board,
    pub octree: Octree,
    pub unit: Unit,
    pub assignment: Assignment,
}

/// What is copied into a local memory, and what is counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// Lines of records as this program has them.
    Lines { objects: Objects, bytes: u32, ratio: Ratio },
    /// Whole objects, as a model: a polygon has so many bytes, and octree nodes of four bytes are copied so many siblings at a time.
    /// Reads of leaf lists, surfaces, normals and materials are not counted.
    Whole { bytes: u32, siblings: u32 },
}

impl Setting {
    /// The layout of the database that is traced.
    pub fn layout(&self) -> RecordLayout {
        match self.unit {
            Unit::Lines { objects: Objects::Triangles, .. } => RecordLayout::DEFAULT,
            Unit::Lines { objects: Objects::Polygons, .. } | Unit::Whole { .. } => RecordLayout::POLYGONS,
        }
    }
}

impl Unit {
    /// The records that a memory is made of.
    pub fn records(&self) -> String {
        match self {
            Self::Lines { objects, bytes, .. } => format!("{} in lines of {bytes} bytes", objects.name()),
            Self::Whole { bytes, siblings: 1 } => format!("polygons of {bytes} bytes, octree nodes of 4"),
            Self::Whole { bytes, siblings } => {
                format!("polygons of {bytes} bytes, {siblings} octree nodes of 4 at once")
            }
        }
    }

    /// The ratio of Table 1.
    pub fn definition(&self) -> &'static str {
        match self {
            Self::Lines { ratio, .. } => ratio.name(),
            Self::Whole { .. } => "misses / accesses",
        }
    }
}

/// In one line.
impl fmt::Display for Setting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let board = match self.board {
            Board::Squares => "with board",
            Board::None => "without board",
        };
        let assignment = match self.assignment {
            Assignment::OnDemand => "on demand",
            Assignment::Interleaved | Assignment::Recorded => "interleaved",
        };
        write!(out, "{board}, {}, {}, tiles {assignment}", octree(self.octree), self.unit.records())
    }
}

/// As columns of JSON.
impl Serialize for Setting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Columns {
            board: Board,
            #[serde(flatten)]
            octree: Octree,
            records: String,
            definition: &'static str,
            assignment: Assignment,
        }
        let Self { board, octree, unit, assignment } = *self;
        Columns { board, octree, records: unit.records(), definition: unit.definition(), assignment }
            .serialize(serializer)
    }
}
