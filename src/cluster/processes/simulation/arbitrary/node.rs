//! What a node may be given.

use std::sync::Arc;

use super::super::hostile::Forge;
use super::super::test_scene::TestScene;
use super::machine::{Arbitrary, TILES};
use crate::processes::driver::PeerId;
use crate::processes::node::state::{Answer, Incoming, Outgoing, State, Task};
use crate::processes::node::tiles::Traced;
use crate::protocol::control::{NodeCommand, NodeConfiguration, Packets};
use crate::protocol::hello::Role;
use crate::protocol::image::ImageReply;
use crate::protocol::work::{TileDone, WorkReply, jobs_per_node};
use ground::ids::{ClusterId, NodeId};
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use trace::picture::{AovSet, Pixels};
use trace::tracer::octree::Octree;
use trace::tracer::simd::Simd;

impl Arbitrary for State {
    /// To start and to trace.
    const TASKS_MAX: usize = 1 + jobs_per_node(1);

    fn begin() -> Self {
        Self::new(Role::Node(NodeId(0)))
    }

    fn command(forge: &mut Forge) -> NodeCommand {
        let [master, bus, display] = [(); 3].map(|()| ([127, 0, 0, 1], forge.dice.below(9) as u16).into());
        match forge.dice.below(16) {
            0 => NodeCommand::Finish,
            1 => NodeCommand::Corrupt,
            2..7 => NodeCommand::Display(display),
            _ => NodeCommand::Configure(Box::new(configuration([master, bus, display]))),
        }
    }

    fn message(forge: &mut Forge, peer: PeerId, sent: &[Outgoing]) -> Option<Incoming> {
        if let Role::Master(_) = peer.role {
            let (tile, attempt, permit) = (forge.tile(), forge.attempt(), forge.mac());
            return Some(Incoming::Work(WorkReply::Job { tile, attempt, permit }));
        }
        if forge.dice.chance(2) {
            return Some(Incoming::Image(ImageReply::Refused("no".to_owned())));
        }
        let (mut tile, mut attempt, receipt) = (forge.tile(), forge.attempt(), forge.mac());
        if forge.dice.chance(95) {
            let Some(Outgoing::Pixels { tile: sent, attempt: of, .. }) = sent.first() else { return None };
            (tile, attempt) = (*sent, *of);
        }
        Some(Incoming::Image(ImageReply::Acknowledged { tile, attempt, receipt }))
    }

    fn answer(forge: &mut Forge, task: Task) -> Answer {
        match task {
            _ if forge.dice.chance(5) => Answer::Failed("a failure".to_owned()),
            Task::Start(_) => {
                let packets = Packets { simd: Simd::Scalar, derived_bytes: forge.count() };
                Answer::Ready(forge.dice.chance(50).then_some(packets))
            }
            Task::Trace(job) => {
                let done = TileDone { tile: job.tile, attempt: job.attempt, ..*forge.done() };
                let pixels = Arc::new(Pixels { colour: vec![[0.5; 3]], ..Pixels::default() });
                Answer::Traced(Traced { done: Box::new(done), pixels, permit: job.permit })
            }
        }
    }
}

fn configuration([master, bus, display]: [std::net::SocketAddr; 3]) -> NodeConfiguration {
    let TestScene { database, view, tiling } = TestScene::spheres(TILES);
    NodeConfiguration {
        cluster: ClusterId(0),
        master,
        bus,
        display,
        header: database.database().header.clone(),
        view,
        tiling,
        aov: AovSet::default(),
        octree: Octree::DEFAULT,
        local_memory: LocalMemory { size: MemorySize::All, line: 64, ways: None, replacement: Replacement::Lru },
        threads: 1,
        seed: 1,
        references: None,
    }
}
