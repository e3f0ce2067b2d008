//! What stands beside every figure: all that was chosen where the paper leaves it open.

use std::fmt;

use serde::Serialize;

use crate::topology::{Assignment, Octree, Replacement, TileOrder};

/// How a figure came about.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Setting {
    pub scene: String,
    #[serde(flatten)]
    pub octree: Octree,
    pub database_bytes: u64,
    pub line_bytes: u32,
    /// Lines a set; `None`: fully associative.
    pub ways: Option<u32>,
    pub replacement: Replacement,
    pub order: TileOrder,
    pub assignment: Assignment,
}

/// The octree of a setting.
pub fn octree(octree: Octree) -> String {
    let Octree { leaf_size, max_depth, mailbox } = octree;
    format!("leaves of {leaf_size}, depth {max_depth}{}", if mailbox { "" } else { ", no mailbox" })
}

impl fmt::Display for Setting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, line_bytes, replacement, order, assignment, .. } = self;
        let ways = self.ways.map_or_else(|| "fully associative".to_owned(), |ways| format!("{ways} ways"));
        let assignment = match assignment {
            Assignment::OnDemand => "on demand",
            Assignment::Interleaved => "interleaved",
        };
        write!(
            out,
            "{scene}, {}; lines of {line_bytes}, {ways}, {replacement}; tiles in {order} order, {assignment}",
            octree(self.octree)
        )
    }
}
