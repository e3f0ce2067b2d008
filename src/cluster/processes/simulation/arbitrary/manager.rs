//! The course of events of a manager, beside processes that report anything, and what holds in it:
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
use super::super::mischief::{Corruptible, Invention};
use super::super::scenery::Scenery;
use crate::processes::bus::control::Control;
use crate::processes::manager::process::{Command, ProcessId, Report};
use crate::processes::manager::rehearsal::{Play, Rehearsal};
use crate::processes::manager::state::{Action, Event};
use crate::processes::{display, master, node};
use crate::protocol::control::{
    BusReport, DisplayCommand, DisplayReport, DisplayTotals, Holdings, MasterCommand, MasterReport, NodeReport, Share,
    TileGrant,
};
use crate::protocol::frame;
use crate::protocol::hello::Role;
use crate::protocol::work::TileDone;
use crate::topology::{Deadlines, Run};
use ground::ids::Epoch;
use machine::hardware::specification::MemorySize;
use machine::hardware::totals::BusTotals;
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
    manager: Rehearsal,
    invention: Invention,
    play: Play,
    now: Duration,
    /// Those that are not confirmed dead, in the order in which they were started.
    processes: Vec<(ProcessId, Stage)>,
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
    let play = play(&mut dice);
    let nodes = play.clusters * play.nodes;
    let Scenery { database, view, tiling } = Scenery::spheres(play.tiles);
    let (manager, actions) = Rehearsal::start(&play, &database.database().header, view, tiling);
    let mut course = Course {
        manager,
        invention: Invention { dice, nodes, tiles: play.tiles },
        play,
        now: Duration::ZERO,
        processes: Vec::new(),
        epochs: HashMap::new(),
        uploads: Vec::new(),
        granted: Vec::new(),
        question: 0,
    };
    course.act(actions);
    while !course.invention.dice.is_spent() && course.manager.end().is_none() {
        course.now += course.invention.dice.between(Duration::ZERO, PAUSE_MAX) / 64;
        if course.invention.dice.chance(20) {
            course.wait();
        } else if let Some(event) = course.event() {
            course.happen(event);
        }
    }
    course.wait();
}

fn play(dice: &mut Dice) -> Play {
    let deadlines = Deadlines {
        startup: Duration::from_secs(10),
        join: Duration::from_secs(600),
        heartbeat: Duration::from_secs(60),
        tile: Duration::from_secs(20),
    };
    Play {
        clusters: 1 + dice.below(2) as u16,
        nodes: 1 + dice.below(3) as u16,
        tiles: 1 + dice.below(8) as u32,
        memory: MemorySize::All,
        run: Run {
            order: TileOrder::Scanline,
            assignment: *dice.choose(&[Assignment::OnDemand, Assignment::Interleaved]),
            seed: 1,
            verify: *dice.choose(&[0.0, 0.5, 1.0]),
            deadlines,
        },
    }
}

impl Course {
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
        let each = self.processes.len() + self.play.tiles as usize;
        assert!(actions.len() <= ACTIONS_MAX + ACTIONS_EACH * each, "{} actions: {actions:?}", actions.len());
        let (queues, tiles_max) = (self.manager.queues(), OF_A_TILE_MAX * self.play.tiles as usize);
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
        (!ids.is_empty()).then(|| *self.invention.dice.choose(&ids))
    }

    fn event(&mut self) -> Option<Event> {
        Some(match self.invention.dice.below(32) {
            0..6 => {
                let id = self.any(|stage| stage == Stage::Started)?;
                self.enter(id, Stage::Connected);
                Event::Connected(id)
            }
            6 => {
                let id = self.any(|stage| stage == Stage::Connected)?;
                self.enter(id, Stage::HungUp);
                Event::Disconnected(id, self.invention.dice.chance(50).then(|| "nonsense".to_owned()))
            }
            7 => {
                let id = self.any(|_| true)?;
                self.processes.retain(|(process, _)| *process != id);
                Event::Exited(id, "died".to_owned())
            }
            8..11 => {
                let bus = self.uploads.pop()?;
                match self.invention.dice.chance(90) {
                    true => Event::Uploaded(bus),
                    false => Event::UploadFailed(bus, "full".to_owned()),
                }
            }
            11 => Event::Refused("a stranger".to_owned()),
            12 if self.invention.dice.chance(5) => Event::Signal(crate::processes::manager::Interrupt::Sigint),
            _ => {
                let id = self.any(|stage| stage == Stage::Connected)?;
                Event::Report(id, self.report(id)?)
            }
        })
    }

    /// What a process reports that keeps to the conversation, mostly.
    fn report(&mut self, id: ProcessId) -> Option<Report> {
        let invention = &mut self.invention;
        let is_made_up = invention.dice.chance(25);
        let address = SocketAddr::from(([127, 0, 0, 1], 1));
        Some(match id.role {
            Role::Manager => return None,
            Role::Bus(_) if is_made_up => Report::Bus(Control::make_up_report(invention)),
            Role::Master(_) if is_made_up => Report::Master(master::state::State::make_up_report(invention)),
            Role::Node(_) if is_made_up => Report::Node(node::state::State::make_up_report(invention)),
            Role::Display if is_made_up => Report::Display(display::state::State::make_up_report(invention)),
            Role::Bus(_) => Report::Bus(match invention.dice.below(4) {
                0 => BusReport::Finished(BusTotals::default()),
                _ => BusReport::Listening(address),
            }),
            Role::Node(_) => Report::Node(match invention.dice.below(4) {
                0 => NodeReport::Finished,
                _ => NodeReport::Heartbeat,
            }),
            Role::Master(_) => Report::Master(match invention.dice.below(8) {
                0 => MasterReport::Listening(address),
                1 => MasterReport::TilesWanted(invention.dice.below(8) as u32),
                2 => MasterReport::Finished(Default::default()),
                _ => self.done(id)?,
            }),
            Role::Display => Report::Display(match invention.dice.below(8) {
                0 => DisplayReport::Listening(address),
                1 => DisplayReport::Restored(holdings(invention)),
                2 => DisplayReport::Finished(DisplayTotals {
                    sha256: String::new(),
                    tiles_done: self.play.tiles,
                    tiles_stale: 0,
                    wire_bytes: 0,
                    written: Vec::new(),
                }),
                _ => DisplayReport::Holdings { question: self.question, holdings: holdings(invention) },
            }),
        })
    }

    /// One of the tiles that a master has, by a node that may have traced it.
    fn done(&mut self, id: ProcessId) -> Option<MasterReport> {
        let place = self.granted.iter().position(|(master, _)| *master == id)?;
        let (_, TileGrant { tile, attempt, .. }) = self.granted.remove(place);
        let mut nodes = self.processes.iter().filter(|(process, _)| process.node().is_some());
        let count = nodes.clone().count() as u64;
        let (by, _) = nodes.nth(self.invention.dice.below(count) as usize)?;
        let mut done: Box<TileDone> = self.invention.done();
        (done.tile, done.attempt) = (tile, attempt);
        if self.invention.dice.chance(90) {
            done.trace.rays = [1, 0, 0, 0];
            (done.trace.primitive_tests, done.render_cpu_nanoseconds) = (1, 1);
        }
        Some(MasterReport::Done { node: by.node()?, epoch: by.epoch, done })
    }
}

fn holdings(invention: &mut Invention) -> Holdings {
    let is_whole = invention.dice.chance(80);
    let tiles = (0..invention.tiles).map(|_| is_whole || invention.dice.chance(50)).collect();
    let shares: BTreeMap<_, _> = (0..invention.dice.below(4))
        .map(|_| {
            let producer = invention.producer();
            (producer, Share { producer, tiles: 1, latest: invention.tile() })
        })
        .collect();
    Holdings { tiles, shares: shares.into_values().collect() }
}
