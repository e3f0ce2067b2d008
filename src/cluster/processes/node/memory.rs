//! Which memory a node has: all of the database, or a local memory that is filled over the bus.

use std::sync::Mutex;
use std::thread;

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

/// Makes the memory that a topology asks for and gives it to `serve`. Of a whole database each of so many threads gets its own view;
/// a local memory is served by this thread alone.
///
/// # Errors
/// The bus is lost, the database does not fit into this host's memory or is not sound, the size does not
/// fit the database.
pub fn with(
    configuration: &NodeConfiguration,
    process: (NodeId, Epoch),
    threads: u16,
    mut bus: BusLines,
    serve: impl Fn(&mut dyn TileMemory) + Sync,
) -> Result<(), MemoryStartError> {
    let NodeConfiguration { header, view, local_memory, .. } = configuration;
    if local_memory.size == MemorySize::All {
        let database = whole_database::pull(header, &mut bus)?;
        let (bvh, bus) = (Bvh8::build(&database), Mutex::new(bus));
        let serve = || serve(&mut WholeDatabase::new(&bvh, &database, view, Simd::best(), &bus));
        thread::scope(|scope| {
            for thread in 1..threads {
                // Fewer threads give the same image.
                if let Err(error) = thread::Builder::new().name("tracer".to_owned()).spawn_scoped(scope, serve) {
                    tracing::warn!("{thread} of {threads} threads trace: the system has no more: {error}");
                    break;
                }
            }
            serve();
        });
        return Ok(());
    }
    let references = References::new(configuration, process)?;
    with_policy!(local_memory.replacement, Policy => {
        let memory = SimulatedMemory::<Policy>::new(configuration, bus, references);
        serve(&mut memory?);
    });
    Ok(())
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
