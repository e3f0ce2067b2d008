//! The topology that a recording of references carries.

use std::path::Path;

use super::Topology;
use machine::recording::references::{Conditions, OpenError, Opened, Recording};
use trace::scene::source::Source;

/// Opens the recording in a folder: that of the run, or its `recording`.
///
/// # Errors
/// As [`Recording::open`]'s.
pub fn open_references(folder: &Path) -> Result<Opened, OpenError> {
    Recording::open(folder, |text| {
        let source = Source::from_bytes("references.json, topology", text.as_bytes());
        let topology = Topology::from_source(&source, &[]).map_err(|error| error.to_string())?;
        Ok(topology.conditions())
    })
}

impl Topology {
    /// What a replay of a run needs of it.
    pub fn conditions(&self) -> Conditions {
        Conditions { cluster: self.cluster, tile_order: self.run.order, seed: self.run.seed }
    }
}
