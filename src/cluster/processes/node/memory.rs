//! Which memory a node has: all of the database, or a local memory that is filled over the bus.

use super::bus_lines::BusLines;
use super::simulated_memory::{References, SimulatedMemory};
use super::tile_memory::TileMemory;
use super::whole_database::{self, PullError, WholeDatabase};
use crate::protocol::control::NodeConfiguration;
use ground::ids::{Epoch, NodeId};
use machine::hardware::local_memory::GeometryError;
use machine::hardware::replacement::with_policy;
use machine::hardware::specification::MemorySize;
use machine::recording::RecordingError;
use trace::tracer::bvh8::Bvh8;
use trace::tracer::simd::Simd;

/// Makes the memory that a topology asks for and gives it to `serve`.
///
/// # Errors
/// The bus is lost, the database does not fit into this host's memory or is not sound, the size does not
/// fit the database; or those of `serve`.
pub fn with<E: From<MemoryStartError>>(
    configuration: &NodeConfiguration,
    process: (NodeId, Epoch),
    mut bus: BusLines,
    serve: impl FnOnce(&mut dyn TileMemory) -> Result<(), E>,
) -> Result<(), E> {
    let NodeConfiguration { header, view, local_memory, .. } = configuration;
    if local_memory.size == MemorySize::All {
        let database = whole_database::pull(header, &mut bus).map_err(MemoryStartError::from)?;
        let bvh = Bvh8::build(&database);
        return serve(&mut WholeDatabase::new(&bvh, &database, view, Simd::best(), bus));
    }
    let references = References::new(configuration, process).map_err(MemoryStartError::from)?;
    with_policy!(local_memory.replacement, Policy => {
        let memory = SimulatedMemory::<Policy>::new(configuration, bus, references);
        serve(&mut memory.map_err(MemoryStartError::from)?)
    })
}

#[derive(Debug, thiserror::Error)]
pub enum MemoryStartError {
    #[error(transparent)]
    Pull(#[from] PullError),
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}
