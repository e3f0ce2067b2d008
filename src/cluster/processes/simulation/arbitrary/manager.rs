//! A sequence of events for a manager whose processes report anything. After each of them is checked:
//!
//! - it answers an event with a bounded number of actions, and what waits in it is bounded by its image and its clusters;
//! - what it tells can be encoded, and goes to processes that are connected;
//! - a process is started where none is, of a higher epoch;
//! - when its deadline has passed and was looked at, the next one is later;
//! - it does nothing more after its end.

use std::collections::{BTreeMap, HashMap};
use std::net::SocketAddr;
use std::time::Duration;

use super::super::dice::Dice;
use super::super::hostile::{Forge, Subvertible};
use super::super::test_scene::TestScene;
use crate::processes::bus::control::Control;
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::processes::manager::simulated::{self, Scenario, SimulatedManager};
use crate::processes::manager::state::{Action, Event};
use crate::processes::{display, master, node};
use crate::protocol::control::{
    BusCommand, BusReport, DisplayCommand, DisplayReport, DisplayTotals, Holdings, MasterCommand, MasterReport,
    NodeCommand, NodeReport, Share, TileGrant,
};
use crate::protocol::frame;
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;
use crate::topology::{Deadlines, Run};
use ground::ids::Epoch;
use machine::hardware::specification::MemorySize;
use machine::hardware::totals::{BusTotals, MasterTotals};
use machine::tile_order::{Assignment, TileOrder};

const PAUSE_MAX: Duration = Duration::from_secs(8);
/// Grants that are remembered, to be reported as done.
const GRANTS_MAX: usize = 32;
/// Attempts at a tile, and checks of it, that are out or wait at a time.
const OF_A_TILE_MAX: usize = 4;
/// For an event, and for each process or tile.
const ACTIONS_MAX: usize = 16;
const ACTIONS_EACH: usize = 4;

struct Course {
    manager: SimulatedManager,
    forge: Forge,
    scenario: Scenario,
    now: Duration,
    /// Those that are not confirmed dead, in the order in which they were started.
    processes: Vec<(ProcessId, Stage)>,
    killed: Vec<ProcessId>,
    /// Asked for their last report.
    finishing: Vec<ProcessId>,
    epochs: HashMap<Role, Epoch>,
    uploads: Vec<ProcessId>,
    granted: Vec<(ProcessId, TileGrant)>,
    question: u32,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    Started,
    Connected,
    HungUp,
}

/// # Panics
/// The manager breaks a promise.
pub fn manager(bytes: &[u8]) {
    let mut dice = Dice::Bytes(bytes.iter().copied().collect());
    let scenario = scenario(&mut dice);
    let nodes = scenario.clusters * scenario.nodes;
    let TestScene { database, view, tiling } = TestScene::spheres(scenario.tiles);
    let (manager, actions) =
        SimulatedManager::start(&scenario, simulated::RUN, &database.database().header, (view, tiling));
    let mut course = Course {
        manager,
        forge: Forge::new(dice, nodes, scenario.tiles),
        scenario,
        now: Duration::ZERO,
        processes: Vec::new(),
        killed: Vec::new(),
        finishing: Vec::new(),
        epochs: HashMap::new(),
        uploads: Vec::new(),
        granted: Vec::new(),
        question: 0,
    };
    course.act(actions);
    if course.forge.dice.chance(80) {
        course.set_up();
    }
    while !course.forge.dice.is_spent() && course.manager.end().is_none() {
        course.now += course.forge.dice.between(Duration::ZERO, PAUSE_MAX) / 64;
        if course.forge.dice.chance(20) {
            course.wait();
        } else if let Some(event) = course.event() {
            course.happen(event);
        }
    }
    course.wait();
}

fn scenario(dice: &mut Dice) -> Scenario {
    let deadlines = Deadlines {
        startup: Duration::from_secs(10),
        join: Duration::from_secs(600),
        heartbeat: Duration::from_secs(60),
        tile: Duration::from_secs(20),
    };
    Scenario {
        clusters: 1 + dice.below(2) as u16,
        nodes: 1 + dice.below(3) as u16,
        tiles: 1 + dice.below(8) as u32,
        memory: MemorySize::All,
        run: Run {
            order: TileOrder::Scanline,
            assignment: *dice.choose(&[Assignment::OnDemand, Assignment::Interleaved]),
            seed: 1,
            verify: *dice.choose(&[0.0, 0.5, 1.0]),
            threads: 1,
            deadlines,
        },
    }
}

impl Course {
    /// All processes connect, and the servers serve.
    fn set_up(&mut self) {
        let address = SocketAddr::from(([127, 0, 0, 1], 1));
        let ids: Vec<_> = self.processes.iter().map(|(id, _)| *id).collect();
        for &id in &ids {
            self.enter(id, Stage::Connected);
            self.happen(Event::Connected(id));
        }
        for id in ids {
            let reports = match id.role {
                Role::Bus(_) => vec![Report::Bus(BusReport::Listening(address))],
                Role::Master(_) => {
                    [MasterReport::Listening(address), MasterReport::TilesWanted(8)].map(Report::Master).into()
                }
                Role::Display => {
                    let restored = DisplayReport::Restored(Holdings::default());
                    [restored, DisplayReport::Listening(address)].map(Report::Display).into()
                }
                Role::Node(_) | Role::Manager => Vec::new(),
            };
            reports.into_iter().for_each(|report| self.happen(Event::Report(id, report)));
        }
        while let Some(bus) = self.uploads.pop() {
            self.happen(Event::Uploaded(bus));
        }
    }

    /// Until the next deadline, if the run goes on.
    fn wait(&mut self) {
        let Some(deadline) = self.manager.next_deadline() else {
            assert!(self.manager.end().is_some(), "it waits for nothing, and is not over");
            let event = Event::Refused("a stranger".to_owned());
            assert!(self.manager.handle(self.now, event).is_empty(), "it goes on after its end");
            return;
        };
        self.now = self.now.max(deadline);
        self.happen(Event::Tick);
        let next = self.manager.next_deadline();
        assert!(next.is_none_or(|next| next > self.now), "no progress: {next:?} at {:?}", self.now);
    }

    fn happen(&mut self, event: Event) {
        let actions = self.manager.handle(self.now, event);
        let each = self.processes.len() + self.scenario.tiles as usize;
        assert!(actions.len() <= ACTIONS_MAX + ACTIONS_EACH * each, "{} actions: {actions:?}", actions.len());
        let (queues, tiles_max) = (self.manager.queues(), OF_A_TILE_MAX * self.scenario.tiles as usize);
        assert!(queues.out <= tiles_max && queues.checks <= tiles_max, "{queues:?}");
        self.act(actions);
        assert_eq!(queues.processes, self.processes.len());
    }

    fn act(&mut self, actions: Vec<Action>) {
        for action in actions {
            match action {
                Action::Begin => {}
                Action::Spawn(id) => {
                    assert!(self.processes.iter().all(|(other, _)| other.role != id.role), "{id} has a place already");
                    let before = self.epochs.insert(id.role, id.epoch);
                    assert!(before.is_none_or(|before| before < id.epoch), "{id} comes again");
                    self.processes.push((id, Stage::Started));
                }
                Action::Tell(id, command) => self.tell(id, command),
                Action::HangUp(id) => self.enter(id, Stage::HungUp),
                Action::Kill(id) => {
                    assert!(self.processes.iter().any(|(process, _)| *process == id), "{id} is dead already");
                    self.killed.push(id);
                }
                Action::Upload(bus, _) => self.uploads.push(bus),
            }
        }
    }

    fn tell(&mut self, id: ProcessId, command: Command) {
        assert!(self.processes.contains(&(id, Stage::Connected)), "{id} is not connected");
        match &command {
            Command::Bus(command) => frame::encode(command, &[]),
            Command::Master(command) => frame::encode(command, &[]),
            Command::Node(command) => frame::encode(command, &[]),
            Command::Display(command) => frame::encode(command, &[]),
        }
        .expect("a command that can be sent");
        match command {
            Command::Bus(BusCommand::Finish { .. })
            | Command::Master(MasterCommand::Finish)
            | Command::Node(NodeCommand::Finish)
            | Command::Display(DisplayCommand::Finish) => self.finishing.push(id),
            Command::Display(DisplayCommand::TellHoldings { question }) => self.question = question,
            Command::Master(MasterCommand::Tiles(grants)) => {
                self.granted.extend(grants.into_iter().map(|grant| (id, grant)));
                let surplus = self.granted.len().saturating_sub(GRANTS_MAX);
                self.granted.drain(..surplus);
            }
            _ => {}
        }
    }

    fn enter(&mut self, id: ProcessId, stage: Stage) {
        self.processes.iter_mut().filter(|(process, _)| *process == id).for_each(|(_, of)| *of = stage);
    }

    fn any(&mut self, is_suitable: impl Fn(Stage) -> bool) -> Option<ProcessId> {
        let suitable = self.processes.iter().filter(|(_, stage)| is_suitable(*stage));
        let ids: Vec<_> = suitable.map(|(id, _)| *id).collect();
        (!ids.is_empty()).then(|| *self.forge.dice.choose(&ids))
    }

    fn event(&mut self) -> Option<Event> {
        Some(match self.forge.dice.below(32) {
            0..6 => {
                let id = self.any(|stage| stage == Stage::Started)?;
                self.enter(id, Stage::Connected);
                Event::Connected(id)
            }
            6 => {
                let id = self.any(|stage| stage == Stage::Connected).filter(|_| self.forge.dice.chance(10))?;
                self.enter(id, Stage::HungUp);
                Event::Disconnected(id, self.forge.dice.chance(50).then(|| "nonsense".to_owned()))
            }
            7 => {
                let id = match self.killed.pop() {
                    Some(id) => id,
                    None => self.any(|_| true).filter(|_| self.forge.dice.chance(10))?,
                };
                self.killed.retain(|killed| *killed != id);
                self.processes.retain(|(process, _)| *process != id);
                Event::Exited(id, "died".to_owned())
            }
            8..11 => {
                let bus = self.uploads.pop()?;
                match self.forge.dice.chance(90) {
                    true => Event::Uploaded(bus),
                    false => Event::UploadFailed(bus, "full".to_owned()),
                }
            }
            11 => Event::Refused("a stranger".to_owned()),
            12 if self.forge.dice.chance(1) => Event::Signal(crate::processes::manager::Interrupt::Sigint),
            _ => {
                let id = self.any(|stage| stage == Stage::Connected)?;
                Event::Report(id, self.report(id)?)
            }
        })
    }

    /// What a process reports that keeps to the conversation, mostly.
    fn report(&mut self, id: ProcessId) -> Option<Report> {
        let forge = &mut self.forge;
        let is_made_up = forge.dice.chance(10);
        let is_finishing = self.finishing.contains(&id);
        let address = SocketAddr::from(([127, 0, 0, 1], 1));
        Some(match id.role {
            Role::Manager => return None,
            Role::Bus(_) if is_made_up => Report::Bus(Control::forge_report(forge)),
            Role::Master(_) if is_made_up => Report::Master(master::state::State::forge_report(forge)),
            Role::Node(_) if is_made_up => Report::Node(node::state::State::forge_report(forge)),
            Role::Display if is_made_up => Report::Display(display::state::State::forge_report(forge)),
            Role::Bus(_) => Report::Bus(match forge.dice.below(4) {
                _ if is_finishing => BusReport::Finished(BusTotals::default()),
                0 => BusReport::Listening(address),
                _ => BusReport::Heartbeat,
            }),
            Role::Node(_) => Report::Node(if is_finishing { NodeReport::Finished } else { NodeReport::Heartbeat }),
            Role::Master(_) => Report::Master(match forge.dice.below(8) {
                0 => MasterReport::Listening(address),
                1 => MasterReport::TilesWanted(forge.dice.below(8) as u32),
                2 if is_finishing => MasterReport::Finished(MasterTotals::default()),
                _ => self.done(id)?,
            }),
            Role::Display => Report::Display(match forge.dice.below(8) {
                0 => DisplayReport::Listening(address),
                1 => DisplayReport::Restored(holdings(forge)),
                2..5 if is_finishing => DisplayReport::Finished(DisplayTotals {
                    sha256: String::new(),
                    tiles_done: self.scenario.tiles,
                    tiles_stale: 0,
                    wire_bytes: 0,
                    written: Vec::new(),
                }),
                _ => DisplayReport::Holdings { question: self.question, holdings: holdings(forge) },
            }),
        })
    }

    /// One of the tiles that a master has, by a node that may have traced it.
    fn done(&mut self, id: ProcessId) -> Option<MasterReport> {
        let place = self.granted.iter().position(|(master, _)| *master == id)?;
        let (_, TileGrant { tile, attempt, .. }) = self.granted.remove(place);
        let mut nodes = self.processes.iter().filter(|(process, _)| process.node().is_some());
        let count = nodes.clone().count() as u64;
        let (by, _) = nodes.nth(self.forge.dice.below(count) as usize)?;
        let mut done: Box<TileDone> = self.forge.done();
        (done.tile, done.attempt) = (tile, attempt);
        if self.forge.dice.chance(90) {
            done.trace.rays = [1, 0, 0, 0];
            (done.trace.primitive_tests, done.render_cpu_nanoseconds) = (1, 1);
        }
        Some(MasterReport::Done { node: by.node()?, epoch: by.epoch, done })
    }
}

fn holdings(forge: &mut Forge) -> Holdings {
    let is_whole = forge.dice.chance(80);
    let tiles = (0..forge.tiles).map(|_| is_whole || forge.dice.chance(50)).collect();
    let shares: BTreeMap<_, _> = (0..forge.dice.below(4))
        .map(|_| {
            let producer = forge.producer();
            (producer, Share { producer, tiles: 1, latest: forge.tile() })
        })
        .collect();
    Holdings { tiles, shares: shares.into_values().collect() }
}
