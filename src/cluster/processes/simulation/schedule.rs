//! What is simulated: a topology, and what goes wrong when. All of it from a seed.

use std::collections::BTreeSet;
use std::fmt;
use std::time::Duration;

use super::dice::{Dice, hash};
use super::hostile::{Forge, Manner};
use crate::processes::manager::process::ProcessId;
use crate::processes::manager::simulated::Scenario;
use crate::protocol::hello::Role;
use crate::topology::{Deadlines, Run};
use ground::ids::{ClusterId, NodeId};
use machine::hardware::specification::MemorySize;
use machine::tile_order::{Assignment, TileOrder};

#[derive(Clone, Debug)]
pub struct Schedule {
    pub seed: u64,
    pub(super) scenario: Scenario,
    pub(super) faults: Vec<Fault>,
    /// Roles whose every process is hostile.
    pub(super) hostile: Vec<Role>,
    /// If the run is interrupted, and resumed.
    pub(super) interrupt: Option<Interrupt>,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Interrupt {
    /// When so many tiles are done.
    Tiles(u32),
    /// So long after an honest process read the first forgery.
    Forgery(Duration),
    /// So long after the first condemnation.
    Condemned(Duration),
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Fault {
    /// Due when so many tiles are done, and so much later.
    pub(super) tiles: u32,
    pub(super) then: Duration,
    pub(super) role: Role,
    pub(super) kind: FaultKind,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FaultKind {
    Kill,
    Stop(Duration),
    /// Nothing reaches it, and nothing it says arrives.
    Cut(Duration),
    /// One of its connections is lost.
    Tear,
    /// Of a node: it is asked to go.
    Leave,
    /// Of a node: what it renders from now on is wrong.
    Corrupt,
}

/// Of the database, for nodes that do not hold all of it.
const PART: MemorySize = MemorySize::Share { numerator: 1, denominator: 4 };
/// So many faults at most.
const FAULTS_MAX: u64 = 7;

impl Schedule {
    pub fn random(seed: u64) -> Self {
        let mut dice = Dice::new(seed);
        let clusters = 1 + dice.below(3) as u16;
        let nodes = 1 + dice.below(9) as u16;
        let tiles = 20 + dice.below(181) as u32;
        let local_memory = [MemorySize::All, PART];
        let run = Run {
            order: *dice.choose(&[TileOrder::Scanline, TileOrder::Morton, TileOrder::Random]),
            assignment: *dice.choose(&[Assignment::OnDemand, Assignment::Interleaved]),
            seed,
            verify: *dice.choose(&[0.0, 0.1]),
            threads: 1,
            deadlines: Deadlines {
                startup: Duration::from_secs(10),
                join: Duration::from_secs(600),
                heartbeat: Duration::from_secs(*dice.choose(&[1, 2, 5])),
                tile: Duration::from_secs(*dice.choose(&[20, 60])),
            },
        };
        let scenario = Scenario { clusters, nodes, tiles, memory: *dice.choose(&local_memory), run };
        let count = dice.below(FAULTS_MAX + 1);
        let faults = (0..count).map(|_| Fault::random(&mut dice, &scenario)).collect();
        Self { seed, scenario, faults, hostile: Vec::new(), interrupt: None }
    }

    /// As [`Self::random`], with a hostile process or two beside the faults.
    pub fn hostile_of(seed: u64) -> Self {
        let mut schedule = Self::random(seed);
        let mut dice = Dice::new(!seed);
        for _ in 0..1 + dice.below(2) {
            let role = Fault::random(&mut dice, &schedule.scenario).role;
            if !schedule.hostile.contains(&role) {
                schedule.hostile.push(role);
            }
        }
        // Which of a node's pixels are wrong is another matter.
        schedule.faults.retain(|fault| fault.kind != FaultKind::Corrupt);
        schedule
    }

    /// A run that is interrupted and resumed. In the first one nodes are corrupt, or a process is hostile.
    pub fn resumed_of(seed: u64) -> Self {
        let mut dice = Dice::new(seed.rotate_left(32) ^ 0x5eed);
        let mut schedule = if dice.chance(50) { Self::hostile_of(seed) } else { Self::random(seed) };
        let scenario = &mut schedule.scenario;
        if schedule.hostile.is_empty() {
            scenario.run.verify = 0.02;
            scenario.nodes = scenario.nodes.max(4);
            let role = Role::Node(NodeId(dice.below(u64::from(scenario.clusters * scenario.nodes)) as u16));
            let tiles = dice.below(u64::from(scenario.tiles)) as u32;
            schedule.faults.retain(|_| dice.chance(30));
            schedule.faults.push(Fault { tiles, then: Duration::ZERO, role, kind: FaultKind::Corrupt });
        }
        schedule.interrupt = Some(match dice.below(4) {
            0 | 1 => Interrupt::Tiles(dice.below(u64::from(scenario.tiles)) as u32),
            2 => Interrupt::Forgery(dice.between(Duration::ZERO, Duration::from_millis(1))),
            _ => Interrupt::Condemned(dice.between(Duration::ZERO, Duration::from_millis(5))),
        });
        schedule
    }

    /// Whether processes of a role are hostile, or something happens to them.
    pub(super) fn troubles(&self, role: Role) -> bool {
        self.hostile.contains(&role) || self.faults.iter().any(|fault| fault.role == role)
    }

    /// The run that resumes this one: nothing goes wrong in it.
    pub(super) fn resuming(&self) -> Self {
        Self { seed: !self.seed, faults: Vec::new(), hostile: Vec::new(), interrupt: None, ..self.clone() }
    }

    /// What a process makes up, if it is hostile.
    pub(super) fn hostile(&self, id: ProcessId, number: u64) -> Option<Forge> {
        self.hostile.contains(&id.role).then(|| Forge {
            dice: Dice::new(hash(self.seed, number)),
            nodes: self.all_nodes(),
            tiles: self.scenario.tiles,
            manner: *Dice::new(hash(!self.seed, number)).choose(&[
                Manner::Plain,
                Manner::Plain,
                Manner::Flood,
                Manner::Unreading,
            ]),
            only: {
                let mut dice = Dice::new(hash(self.seed ^ 0x0a17, number));
                dice.chance(50).then(|| dice.below(4))
            },
            plausible: BTreeSet::new(),
        })
    }

    /// So many nodes at one master, and nothing goes wrong.
    pub fn large(nodes: u16, tiles: u32, counted: bool) -> Self {
        let mut schedule = Self::random(0);
        let memory = if counted { PART } else { MemorySize::All };
        let run = Run { assignment: Assignment::OnDemand, verify: 0.0, ..schedule.scenario.run };
        schedule.scenario = Scenario { clusters: 1, nodes, tiles, memory, run };
        schedule.faults.clear();
        schedule
    }

    pub fn tiles(&self) -> u32 {
        self.scenario.tiles
    }

    pub(super) fn all_nodes(&self) -> u16 {
        self.scenario.clusters * self.scenario.nodes
    }

    /// Nodes that become corrupt at some time.
    pub(super) fn corrupt_nodes(&self) -> usize {
        let mut nodes: Vec<_> = self.faults.iter().filter(|fault| fault.kind == FaultKind::Corrupt).collect();
        nodes.sort_unstable_by_key(|fault| fault.role.to_string());
        nodes.dedup_by_key(|fault| fault.role);
        nodes.len()
    }
}

impl Fault {
    fn random(dice: &mut Dice, scenario: &Scenario) -> Self {
        let clusters = u64::from(scenario.clusters);
        let node = Role::Node(NodeId(dice.below(clusters * u64::from(scenario.nodes)) as u16));
        let role = match dice.below(10) {
            0 | 1 => Role::Bus(ClusterId(dice.below(clusters) as u16)),
            2 | 3 => Role::Master(ClusterId(dice.below(clusters) as u16)),
            4 | 5 => Role::Display,
            _ => node,
        };
        let lasts = dice.between(Duration::from_millis(50), Duration::from_secs(8));
        let kind = match dice.below(10) {
            0..4 => FaultKind::Kill,
            4 | 5 => FaultKind::Stop(lasts),
            6 | 7 => FaultKind::Cut(lasts),
            8 if role == node && lasts.as_nanos().is_multiple_of(2) => FaultKind::Leave,
            8 => FaultKind::Tear,
            _ => FaultKind::Corrupt,
        };
        let role = if kind == FaultKind::Corrupt { node } else { role };
        // Some come before the first tile, some after the last one.
        let tiles = dice.below(u64::from(scenario.tiles) + 1) as u32;
        let most = if dice.chance(30) { Duration::from_secs(3) } else { Duration::from_millis(30) };
        Self { tiles, then: dice.between(Duration::ZERO, most), role, kind }
    }
}

impl FaultKind {
    pub fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::Stop(_) => "stop",
            Self::Cut(_) => "cut",
            Self::Tear => "tear",
            Self::Leave => "leave",
            Self::Corrupt => "corrupt",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}@{} tiles + {:?}", self.kind.name(), self.role, self.tiles, self.then)?;
        match self.kind {
            FaultKind::Stop(lasts) | FaultKind::Cut(lasts) => write!(f, " for {lasts:?}"),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Schedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Scenario { clusters, nodes, tiles, memory, run } = &self.scenario;
        write!(f, "seed {}: {clusters}x{nodes} nodes, {tiles} tiles, {:?}, ", self.seed, run.assignment)?;
        write!(f, "verify {}, memory {memory:?}, heartbeat {:?}", run.verify, run.deadlines.heartbeat)?;
        self.hostile.iter().try_for_each(|role| write!(f, "; hostile {role}"))?;
        self.faults.iter().try_for_each(|fault| write!(f, "; {fault}"))?;
        self.interrupt.map_or(Ok(()), |interrupt| write!(f, "; interrupted at {interrupt:?}"))
    }
}
