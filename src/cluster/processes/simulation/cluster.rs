//! A cluster that renders an image of any database, and nothing goes wrong: for programs.

use std::time::Duration;

use super::roles::Process;
use super::schedule::Schedule;
use super::test_scene::TestScene;
use super::world::World;
use crate::processes::manager::simulated::End;
use crate::report::{Bus, Node};
use machine::hardware::local_memory::{Geometry, GeometryError};
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use trace::database::verify::Verified;
use trace::image_file::FrameBuffer;
use trace::picture::{Sides, Tiling, TilingError};
use trace::tracer::View;

/// A bus, a master, nodes and a display, under a manager: the states that decide in a live run, in one process and in virtual
/// time. Each node has an LRU memory with lines of 64 bytes, and fetches over the bus what it lacks.
#[derive(Clone, Copy, Debug)]
pub struct Cluster {
    /// 1 to [`Self::NODES_MAX`].
    pub nodes: u16,
    /// Of each node.
    pub local_memory: MemorySize,
    /// The side of a tile, in pixels.
    pub tile: u32,
    /// Of everything that takes a random time.
    pub seed: u64,
}

/// An image, and what it took.
#[derive(Clone, Debug)]
pub struct Rendered {
    pub frame: FrameBuffer,
    /// By node id.
    pub nodes: Vec<Node>,
    pub bus: Option<Bus>,
    /// Of virtual time.
    pub took: Duration,
}

/// There is no whole image; why.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum Incomplete {
    #[error("a cluster of {0} nodes, expected 1 to {max}", max = Cluster::NODES_MAX)]
    Nodes(u16),
    #[error(transparent)]
    Tiles(#[from] TilingError),
    #[error("a local memory of {size}: {error}")]
    LocalMemory { size: MemorySize, error: GeometryError },
    #[error("the image is not complete: {0}")]
    Run(String),
}

impl Cluster {
    /// As many as a topology may have.
    pub const NODES_MAX: u16 = 256;

    /// Renders a view from the manager's first command to its last.
    ///
    /// # Errors
    /// There are no nodes, no such tiles, or the local memory is too small for the database.
    pub fn render(&self, database: &Verified, view: &View) -> Result<Rendered, Incomplete> {
        self.check(database)?;
        let (width, height) = (view.image.width(), view.image.height());
        let sides = Sides { width, height, tile_width: self.tile, tile_height: self.tile };
        let tiling = Tiling::try_from(sides)?;
        let mut schedule = Schedule::large(self.nodes, tiling.tile_count(), true);
        (schedule.seed, schedule.scenario.memory) = (self.seed, self.local_memory);
        let scene = TestScene { database: database.clone(), view: view.clone(), tiling };
        let mut world = World::new(&schedule, &scene, None, None);
        world.run();
        let (nodes, bus, took, end) =
            (world.manager.nodes(), world.manager.bus(), world.network.now, world.manager.end());
        let incidents: Vec<String> = world.manager.incidents().into_iter().map(|incident| incident.text).collect();
        let displays = world.processes.into_iter().rev().flatten();
        let mut images = displays.filter_map(|process| match process {
            Process::Display(display) => display.worker.finished,
            _ => None,
        });
        match (end, images.next()) {
            (Some(End::Complete), Some(image)) => Ok(Rendered { frame: image.frame, nodes, bus, took }),
            (end, _) => Err(Incomplete::Run(why(end, incidents))),
        }
    }

    fn check(&self, database: &Verified) -> Result<(), Incomplete> {
        if !(1..=Self::NODES_MAX).contains(&self.nodes) {
            return Err(Incomplete::Nodes(self.nodes));
        }
        let size = self.local_memory;
        let memory = LocalMemory { size, line: 64, ways: None, replacement: Replacement::Lru };
        let geometry = Geometry::new(&memory, &database.database().header.layout);
        geometry.map(|_| ()).map_err(|error| Incomplete::LocalMemory { size, error })
    }
}

/// Why a run ended without an image, and what happened before.
fn why(end: Option<End>, incidents: Vec<String>) -> String {
    let end = match end {
        Some(End::Complete) => "the display has no image".to_owned(),
        Some(End::TilesMissing) => "no node is left that renders".to_owned(),
        Some(End::Interrupted) => "the run was interrupted".to_owned(),
        Some(End::Failed(why)) => why,
        None => "the run did not end".to_owned(),
    };
    std::iter::once(end).chain(incidents).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::super::test_scene;
    use super::*;

    #[test]
    fn what_cannot_be_is_refused_with_what_was_expected() {
        let (database, view) = (test_scene::database(), test_scene::view(8));
        let good = Cluster { nodes: 2, local_memory: MemorySize::All, tile: 4, seed: 1 };
        let error = |cluster: Cluster| cluster.render(database, &view).expect_err("refused").to_string();
        for nodes in [0, 257, u16::MAX] {
            let expected = format!("a cluster of {nodes} nodes, expected 1 to 256");
            assert_eq!(error(Cluster { nodes, ..good }), expected);
        }
        assert_eq!(
            error(Cluster { local_memory: MemorySize::Bytes(1), ..good }),
            "a local memory of 1 B: 1 bytes are 0 lines of 64 bytes: expected at least 16 lines, 1024 bytes"
        );
        let error = error(Cluster { tile: 0, ..good });
        assert!(error.contains("expected sides from 1 to"), "{error}");
        good.render(database, &view).expect("a whole image");
    }
}
