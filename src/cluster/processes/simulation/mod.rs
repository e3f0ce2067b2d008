//! A run without processes, sockets or a clock: the states of all processes, wired by a network that exists
//! in numbers only, and everything that can go wrong with it. One seed, one course of events.
//!
//! ```text
//! schedule (topology, faults) ─▶ world (the manager's shell) ─▶ network (delays, cuts, ends, timers)
//!                                  host: the driver of every other process ◀┘
//!                                  tracer, memory, files: its workers
//!                                  invariants: what must be true when it is over
//! ```

pub mod arbitrary;
mod bounds;
mod child;
mod cluster;
mod dice;
mod files;
mod forgery;
mod host;
mod hostile;
mod invariants;
mod memory;
mod network;
mod roles;
mod schedule;
mod simulated;
mod stopwatch;
pub(in crate::processes) mod test_scene;
mod tracer;
mod world;

#[cfg(test)]
mod tests;

use std::time::Duration;

pub use self::cluster::{Cluster, Incomplete, Rendered};
pub use self::schedule::{FaultKind, Schedule};
pub use self::stopwatch::Clock;
use self::test_scene::TestScene;
pub use self::world::Recovery;
use self::world::World;
pub use super::manager::simulated::End;

/// What came of a schedule.
#[derive(Clone, Debug)]
pub struct Outcome {
    pub end: Option<End>,
    /// Of virtual time.
    pub took: Duration,
    /// Events that the states were given.
    pub decisions: u64,
    /// What these took on the host; zero without a clock.
    pub deciding: Duration,
    pub reissued: u64,
    /// Tiles whose two results agreed, and those where they did not.
    pub compared: (u64, u64),
    pub recoveries: Vec<Recovery>,
    /// Most attempts that masters had, and most tiles one master had for each of its nodes.
    pub out_most: usize,
    pub tiles_a_node_most: usize,
    /// Most messages under way on one connection, those that were held up included.
    pub under_way_most: usize,
    /// Tiles of the finished image whose pixels are not what they should be.
    pub wrong_tiles: usize,
    /// Invariants that are broken, each with what shows it.
    pub broken: Vec<String>,
    /// The incidents of the report, for a look at what went on.
    pub incidents: Vec<String>,
}

/// Simulates a schedule to its end, and the run that resumes it if it is interrupted. `clock` measures what deciding costs.
pub fn simulate(schedule: &Schedule, clock: Option<Clock>) -> Outcome {
    let scene = TestScene::spheres(schedule.tiles());
    let mut world = World::new(schedule, &scene, clock, None);
    world.run();
    let first = outcome(schedule, &world);
    if !first.broken.is_empty() || first.end != Some(End::Interrupted) {
        return first;
    }
    let schedule = schedule.resuming();
    let mut resumed = World::new(&schedule, &scene, clock, Some(&world));
    resumed.run();
    let mut second = outcome(&schedule, &resumed);
    second.incidents.splice(0..0, first.incidents);
    Outcome { took: first.took + second.took, decisions: first.decisions + second.decisions, ..second }
}

fn outcome(schedule: &Schedule, world: &World) -> Outcome {
    Outcome {
        end: world.manager.end(),
        took: world.network.now,
        decisions: world.watch.events,
        deciding: world.watch.spent,
        reissued: world.manager.reissued(),
        compared: world.manager.compared(),
        out_most: world.most.out,
        tiles_a_node_most: world.tiles_a_node,
        under_way_most: world.network.longest,
        wrong_tiles: invariants::wrong_tiles(schedule, world).len(),
        broken: invariants::broken(schedule, world),
        incidents: incidents(world),
        recoveries: world.recoveries.clone(),
    }
}

fn incidents(world: &World) -> Vec<String> {
    let incidents = world.manager.incidents();
    incidents.into_iter().map(|incident| format!("{:9.3} {}", incident.seconds, incident.text)).collect()
}
