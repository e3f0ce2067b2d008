//! A cluster that renders an image of any database, and nothing goes wrong: for programs.

use std::time::Duration;

use super::roles::Process;
use super::schedule::Schedule;
use super::test_scene::TestScene;
use super::world::World;
use crate::processes::manager::simulated::End;
use crate::report::{Bus, Node};
use machine::hardware::specification::MemorySize;
use trace::database::verify::Verified;
use trace::image_file::FrameBuffer;
use trace::picture::{Sides, Tiling};
use trace::tracer::View;

/// A bus, a master, nodes and a display, under a manager: the states that decide in a live run, in one process and in virtual
/// time. Each node has an LRU memory with lines of 64 bytes, and fetches over the bus what it lacks.
#[derive(Clone, Copy, Debug)]
pub struct Cluster {
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
#[derive(Clone, Debug, thiserror::Error)]
#[error("the image is not complete: {0}")]
pub struct Incomplete(pub String);

impl Cluster {
    /// Renders a view from the manager's first command to its last.
    ///
    /// # Errors
    /// There are no nodes, no such tiles, or the local memory is too small for the database.
    pub fn render(&self, database: &Verified, view: &View) -> Result<Rendered, Incomplete> {
        let (width, height) = (view.image.width(), view.image.height());
        let sides = Sides { width, height, tile_width: self.tile, tile_height: self.tile };
        let tiling = Tiling::try_from(sides).map_err(|error| Incomplete(error.to_string()))?;
        let mut schedule = Schedule::large(self.nodes, tiling.tile_count(), true);
        (schedule.seed, schedule.scenario.memory) = (self.seed, self.local_memory);
        let scene = TestScene { database: database.clone(), view: view.clone(), tiling };
        let mut world = World::new(&schedule, &scene, None, None);
        world.run();
        let (nodes, bus, took, end) =
            (world.manager.nodes(), world.manager.bus(), world.network.now, world.manager.end());
        let displays = world.processes.into_iter().rev().flatten();
        let mut images = displays.filter_map(|process| match process {
            Process::Display(display) => display.worker.finished,
            _ => None,
        });
        match (end, images.next()) {
            (Some(End::Complete), Some(image)) => Ok(Rendered { frame: image.frame, nodes, bus, took }),
            (end, _) => Err(Incomplete(format!("{end:?}"))),
        }
    }
}
