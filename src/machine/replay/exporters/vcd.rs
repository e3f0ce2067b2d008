//! A simulated bus as a Value Change Dump (IEEE 1364-2005, clause 18), which viewers of wave forms open.
//!
//! A nanosecond stands for a cycle. Of what changes more than once in a cycle, the last value is written. One file is one
//! cluster's bus.

use std::cell::RefCell;
use std::io::{self, Write};

use crate::hardware::transaction::Kind;
use crate::replay::contention::work::Step;
use crate::replay::contention::{Cycle, Hold, Observer, Request};
use ground::ids::{ClusterId, NodeId};

/// Writes changes as time goes on. A reference to it is the simulation's observer; the work of the nodes tells it its
/// [`Step`]s.
pub struct BusWaves<W>(RefCell<Waves<W>>);

struct Waves<W> {
    out: W,
    /// What went wrong first; nothing is written after it.
    outcome: io::Result<()>,
    now: Cycle,
    bus: Bus,
    written: Bus,
    /// By node, the address of what it lacks.
    lacks: Vec<u64>,
}

/// The values of a cycle.
#[derive(Clone, PartialEq, Eq)]
struct Bus {
    busy: bool,
    /// Who has the bus, and how many bytes it asked for.
    granted: Option<(u16, u32)>,
    /// Of a fetch that has the bus.
    address: Option<u64>,
    /// By node, whether it asked for the bus and was not granted it yet.
    waiting: Vec<bool>,
}

impl<W: Write> BusWaves<W> {
    pub fn new(mut out: W, cluster: ClusterId, nodes: u16) -> Self {
        let bus = Bus { busy: false, granted: None, address: None, waiting: vec![false; usize::from(nodes)] };
        let outcome = header(&mut out, cluster, nodes).and_then(|()| bus.write(&mut out, None));
        let outcome = outcome.and_then(|()| writeln!(out, "$end"));
        let lacks = vec![0; usize::from(nodes)];
        Self(RefCell::new(Waves { out, outcome, now: 0, written: bus.clone(), bus, lacks }))
    }

    /// Of a node.
    pub fn step(&self, step: Step) {
        if let Step::Lacks { node, address } = step {
            self.0.borrow_mut().lacks[usize::from(node.0)] = address;
        }
    }

    /// Ends the file.
    ///
    /// # Errors
    /// What went wrong at any time.
    pub fn finish(self) -> io::Result<W> {
        let mut waves = self.0.into_inner();
        waves.write();
        waves.outcome?;
        Ok(waves.out)
    }
}

impl<W: Write> Observer for &BusWaves<W> {
    fn requested(&mut self, request: &Request) {
        self.0.borrow_mut().at(request.requested).waiting[usize::from(request.node.0)] = true;
    }

    fn granted(&mut self, request: &Request, hold: Hold) {
        let waves = &mut *self.0.borrow_mut();
        let node = usize::from(request.node.0);
        let address = (request.kind == Kind::Fetch).then_some(waves.lacks[node]);
        let bus = waves.at(hold.from);
        bus.waiting[node] = false;
        bus.busy = true;
        bus.granted = Some((request.node.0, request.bytes));
        bus.address = address;
    }

    fn released(&mut self, _request: &Request, hold: Hold) {
        let waves = &mut *self.0.borrow_mut();
        let bus = waves.at(hold.until);
        (bus.busy, bus.granted, bus.address) = (false, None, None);
    }

    fn finished(&mut self, _node: NodeId, now: Cycle) {
        self.0.borrow_mut().at(now);
    }
}

impl<W: Write> Waves<W> {
    /// The values of this cycle, to be changed.
    fn at(&mut self, now: Cycle) -> &mut Bus {
        if now > self.now {
            self.write();
            self.now = now;
        }
        &mut self.bus
    }

    /// Writes what changed in the cycle.
    fn write(&mut self) {
        if self.outcome.is_ok() && self.bus != self.written {
            let time = if self.now > 0 { writeln!(self.out, "#{}", self.now) } else { Ok(()) };
            self.outcome = time.and_then(|()| self.bus.write(&mut self.out, Some(&self.written)));
            self.written.clone_from(&self.bus);
        }
    }
}

fn header(out: &mut impl Write, ClusterId(cluster): ClusterId, nodes: u16) -> io::Result<()> {
    writeln!(out, "$version marti {} $end", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "$comment 1 ns stands for 1 cycle, of processors and bus alike $end")?;
    writeln!(out, "$timescale 1 ns $end")?;
    writeln!(out, "$scope module cluster{cluster} $end")?;
    writeln!(out, "$var wire 1 b busy $end")?;
    writeln!(out, "$var wire 16 n node [15:0] $end")?;
    writeln!(out, "$var wire {nodes} w waiting [{}:0] $end", nodes.saturating_sub(1))?;
    writeln!(out, "$var wire 64 a address [63:0] $end")?;
    writeln!(out, "$var wire 32 c bytes [31:0] $end")?;
    writeln!(out, "$upscope $end\n$enddefinitions $end\n#0\n$dumpvars")
}

impl Bus {
    /// Writes what is not as it was.
    fn write(&self, out: &mut impl Write, before: Option<&Self>) -> io::Result<()> {
        let Self { busy, address, waiting, .. } = self;
        if before.is_none_or(|before| before.busy != *busy) {
            writeln!(out, "{}b", u8::from(*busy))?;
        }
        let mut vector = |name: char, now: Option<u64>, before: Option<Option<u64>>| match now {
            _ if before == Some(now) => Ok(()),
            Some(value) => writeln!(out, "b{value:b} {name}"),
            None => writeln!(out, "bx {name}"),
        };
        let node = |bus: &Self| bus.granted.map(|(node, _)| u64::from(node));
        let bytes = |bus: &Self| bus.granted.map(|(_, bytes)| u64::from(bytes));
        vector('n', node(self), before.map(node))?;
        vector('a', *address, before.map(|before| before.address))?;
        vector('c', bytes(self), before.map(bytes))?;
        if before.is_none_or(|before| before.waiting != *waiting) {
            let bits: String = waiting.iter().rev().map(|&waits| if waits { '1' } else { '0' }).collect();
            writeln!(out, "b{bits} w")?;
        }
        Ok(())
    }
}
