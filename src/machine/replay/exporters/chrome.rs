//! A simulated bus as Chrome trace events, which ui.perfetto.dev and chrome://tracing open.
//!
//! A process for each node, with its tiles as slices and, within, the times for which it waited for the bus; a process
//! for the bus, with who had it when, and its utilisation as a counter. The format counts in microseconds: one of these
//! stands for one cycle.
//!
//! Format: *Trace Event Format* (Duffy, Sinclair, Shimizu).

use std::cell::RefCell;
use std::fmt;
use std::io::{self, Write};

use crate::replay::contention::work::Step;
use crate::replay::contention::{Cycle, Hold, Observer, Phase, Request};
use ground::ids::{ClusterId, NodeId, TileId};

/// Writes events as they happen. A reference to it is the simulation's observer; the work of the nodes tells it its
/// [`Step`]s.
pub struct ChromeTrace<W>(RefCell<Events<W>>);

struct Events<W> {
    out: W,
    /// What went wrong first; nothing is written after it.
    outcome: io::Result<()>,
    first: bool,
    /// The process of the cluster's bus; its nodes' follow.
    bus: u32,
    /// One after all processes.
    next: u32,
    utilisation: Utilisation,
}

/// Each process has one thread.
const THREAD: u32 = 1;

impl<W: Write> ChromeTrace<W> {
    /// Utilisation is counted in windows of so many cycles, at least 1.
    pub fn new(out: W, window_cycles: Cycle) -> Self {
        let utilisation = Utilisation { window: window_cycles.max(1), begins: 0, busy: 0, now: 0 };
        let mut events = Events { out, outcome: Ok(()), first: true, bus: 1, next: 1, utilisation };
        let version = env!("CARGO_PKG_VERSION");
        events.outcome = write!(events.out, r#"{{"displayTimeUnit":"ms","otherData":{{"program":"marti {version}","#)
            .and_then(|()| {
                let time = "a microsecond stands for a cycle, of processors and bus alike";
                write!(events.out, r#""time":"{time}","utilisation window":"{window_cycles} cycles"}},"traceEvents":["#)
            });
        Self(RefCell::new(events))
    }

    /// What follows is the simulation of this cluster, from cycle 0 on.
    pub fn cluster(&self, cluster: ClusterId, nodes: u16) {
        let events = &mut *self.0.borrow_mut();
        events.close_cluster();
        events.bus = events.next;
        events.next += 1 + u32::from(nodes);
        events.process(events.bus, format_args!("{cluster} bus"), "granted to");
        for node in 0..nodes {
            events.process(events.node(NodeId(node)), format_args!("{cluster} {}", NodeId(node)), "tiles and stalls");
        }
    }

    /// Of a node of the cluster.
    pub fn step(&self, step: Step) {
        let events = &mut *self.0.borrow_mut();
        let (phase, node, TileId(tile), now) = match step {
            Step::TileBegins { node, tile, now } => ("B", node, tile, now),
            Step::TileEnds { node, tile, now } => ("E", node, tile, now),
            Step::Lacks { .. } => return,
        };
        let process = events.node(node);
        events.write(format_args!(
            r#""ph":"{phase}","pid":{process},"tid":{THREAD},"ts":{now},"cat":"tile","name":"tile {tile}""#
        ));
    }

    /// Ends the file.
    ///
    /// # Errors
    /// What went wrong at any time.
    pub fn finish(self) -> io::Result<W> {
        let mut events = self.0.into_inner();
        events.close_cluster();
        events.outcome?;
        events.out.write_all(b"\n]}\n")?;
        Ok(events.out)
    }
}

impl<W: Write> Observer for &ChromeTrace<W> {
    fn granted(&mut self, request: &Request, hold: Hold) {
        let events = &mut *self.0.borrow_mut();
        let Request { node: NodeId(node), kind, bytes, requested } = *request;
        let (bus, ts, cycles) = (events.bus, hold.from, hold.until - hold.from);
        let phase = match hold.phase {
            Phase::Whole => "whole",
            Phase::Address => "address",
            Phase::Data => "data",
        };
        events.write(format_args!(
            r#""ph":"X","pid":{bus},"tid":{THREAD},"ts":{ts},"dur":{cycles},"cat":"bus","name":"{kind} of node {node}","args":{{"bytes":{bytes},"phase":"{phase}","requested":{requested}}}"#,
            kind = kind.name(),
        ));
        events.hold(hold.from, hold.until);
    }

    fn completed(&mut self, request: &Request, now: Cycle) {
        let events = &mut *self.0.borrow_mut();
        let Request { node, kind, bytes, requested } = *request;
        let (process, cycles) = (events.node(node), now - requested);
        events.write(format_args!(
            r#""ph":"X","pid":{process},"tid":{THREAD},"ts":{requested},"dur":{cycles},"cat":"stall","name":"{kind}","args":{{"bytes":{bytes}}}"#,
            kind = kind.name(),
        ));
    }

    fn finished(&mut self, _node: NodeId, now: Cycle) {
        let events = &mut *self.0.borrow_mut();
        events.utilisation.now = events.utilisation.now.max(now);
    }
}

impl<W: Write> Events<W> {
    fn node(&self, node: NodeId) -> u32 {
        self.bus + 1 + u32::from(node.0)
    }

    fn process(&mut self, process: u32, name: fmt::Arguments, thread: &str) {
        let mut name_it = |what: &str, name: fmt::Arguments| {
            self.write(format_args!(
                r#""ph":"M","pid":{process},"tid":{THREAD},"name":"{what}","args":{{"name":"{name}"}}"#
            ));
        };
        name_it("process_name", name);
        name_it("thread_name", format_args!("{thread}"));
        self.write(format_args!(
            r#""ph":"M","pid":{process},"name":"process_sort_index","args":{{"sort_index":{process}}}"#
        ));
    }

    /// Writes an event, given what is between its braces.
    fn write(&mut self, fields: fmt::Arguments) {
        if self.outcome.is_ok() {
            let comma = if std::mem::take(&mut self.first) { "" } else { "," };
            self.outcome = write!(self.out, "{comma}\n{{{fields}}}");
        }
    }

    /// The bus is held, later than ever before.
    fn hold(&mut self, from: Cycle, until: Cycle) {
        self.count_to(from);
        let mut from = from;
        while from < until {
            let end = until.min(self.utilisation.begins + self.utilisation.window);
            self.utilisation.busy += end - from;
            self.count_to(end);
            from = end;
        }
    }

    /// Time has come to `now`: writes the windows that ended by then. Of idle ones that follow one another, the first.
    fn count_to(&mut self, now: Cycle) {
        let Utilisation { window, begins, busy, .. } = self.utilisation;
        self.utilisation.now = self.utilisation.now.max(now);
        if now < begins + window {
            return;
        }
        self.counter(begins, busy as f64 / window as f64);
        let begins = begins + window;
        let current = now - now % window;
        if begins < current {
            self.counter(begins, 0.0);
        }
        self.utilisation.begins = current;
        self.utilisation.busy = 0;
    }

    fn counter(&mut self, ts: Cycle, share: f64) {
        let bus = self.bus;
        self.write(format_args!(r#""ph":"C","pid":{bus},"ts":{ts},"name":"utilisation","args":{{"share":{share}}}"#));
    }

    /// The last window is as long as there is something in it; then the bus is free.
    fn close_cluster(&mut self) {
        self.count_to(self.utilisation.now);
        let Utilisation { begins, busy, now, .. } = self.utilisation;
        if now > begins {
            self.counter(begins, busy as f64 / (now - begins) as f64);
        }
        if now > 0 {
            self.counter(now, 0.0);
        }
        (self.utilisation.begins, self.utilisation.busy, self.utilisation.now) = (0, 0, 0);
    }
}

/// How much of a window the bus was held.
struct Utilisation {
    /// Cycles.
    window: Cycle,
    /// The current window.
    begins: Cycle,
    /// Of these, so far.
    busy: Cycle,
    /// The last time that was heard of.
    now: Cycle,
}
