//! Faults on purpose: what is to happen to which process of a run, and when (docs/chaos.md).
//!
//! Pure: a [`FaultSchedule`] is what a person wrote, the [`Planner`] says which of its faults are due. The manager carries them
//! out, and its state does not know of them.

mod longest_wait;
mod parser;
mod planner;
mod schedule;

use std::fmt;
use std::time::Duration;

pub use longest_wait::LongestWait;
pub use parser::ParseError;
pub use planner::{Planner, Progress};
pub use schedule::{Cast, FaultSchedule, NoSuchSlot};

use ground::ids::{ClusterId, NodeId};

/// What happens to `on`, and when: a [`Target`] as written, a [`ProcessSlot`] once it is known how many there are.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Fault<On = ProcessSlot> {
    pub deed: Deed,
    pub on: On,
    pub when: When,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Deed {
    /// By SIGKILL.
    Kill,
    /// By SIGSTOP; SIGCONT follows after so long.
    Stop(Seconds),
    /// All its connections stop passing bytes on, for so long.
    Cut(Seconds),
    /// From then on one bit of every tile is wrong.
    Corrupt,
}

/// A process of the topology, whichever one it is at the time.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum ProcessSlot {
    Bus(ClusterId),
    Master(ClusterId),
    Node(NodeId),
    Display,
}

/// Any process of a kind, or a certain one.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Target {
    pub kind: Kind,
    /// Of a bus and a master the cluster, of a node the node; `None`: the seed chooses.
    pub number: Option<u16>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    Bus,
    Master,
    Node,
    Display,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum When {
    /// Once so many tiles of a hundred are done.
    Done(Percent),
    /// So long after the first tile was handed out.
    After(Seconds),
}

/// A share of the tiles in thousandths of a percent, below 100%.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Percent(u32);

/// In thousandths, at most an hour.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Seconds(u32);

impl Percent {
    /// Exclusive, thousandths.
    const LIMIT: u32 = 100_000;

    /// Whether so many of all tiles are that share.
    fn is_reached(self, done: u32, all: u32) -> bool {
        u64::from(done) * u64::from(Self::LIMIT) >= u64::from(self.0) * u64::from(all)
    }
}

impl Seconds {
    /// Thousandths.
    const MAX: u32 = 3_600_000;

    pub fn duration(self) -> Duration {
        Duration::from_millis(u64::from(self.0))
    }
}

impl ProcessSlot {
    fn kind(self) -> Kind {
        match self {
            Self::Bus(_) => Kind::Bus,
            Self::Master(_) => Kind::Master,
            Self::Node(_) => Kind::Node,
            Self::Display => Kind::Display,
        }
    }
}

impl From<ProcessSlot> for Target {
    fn from(slot: ProcessSlot) -> Self {
        let number = match slot {
            ProcessSlot::Bus(cluster) | ProcessSlot::Master(cluster) => Some(cluster.0),
            ProcessSlot::Node(node) => Some(node.0),
            ProcessSlot::Display => None,
        };
        Self { kind: slot.kind(), number }
    }
}

impl From<Fault> for Fault<Target> {
    fn from(Fault { deed, on, when }: Fault) -> Self {
        Self { deed, on: on.into(), when }
    }
}

/// As it is written in a schedule.
impl fmt::Display for Fault<Target> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verb = match self.deed {
            Deed::Kill => "kill",
            Deed::Stop(_) => "stop",
            Deed::Cut(_) => "cut",
            Deed::Corrupt => "corrupt",
        };
        write!(f, "{verb} {}@{}", self.on, self.when)?;
        match self.deed {
            Deed::Stop(time) | Deed::Cut(time) => write!(f, " for {time}"),
            Deed::Kill | Deed::Corrupt => Ok(()),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Fault::<Target>::from(*self).fmt(f)
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind.fmt(f)?;
        self.number.map_or(Ok(()), |number| write!(f, " {number}"))
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bus => "bus",
            Self::Master => "master",
            Self::Node => "node",
            Self::Display => "display",
        })
    }
}

impl fmt::Display for When {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Done(Percent(thousandths)) => write!(f, "{}%", f64::from(*thousandths) / 1e3),
            Self::After(time) => time.fmt(f),
        }
    }
}

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Thousandths have a shortest decimal, which reads back as the same.
        write!(f, "{}s", f64::from(self.0) / 1e3)
    }
}
