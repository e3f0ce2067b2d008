//! Recorded references as the work of nodes that share a bus: what they compute, and what they ask the bus for.

use std::collections::VecDeque;
use std::ops::Range;

use crate::hardware::local_memory::Geometry;
use crate::hardware::replacement::Replacement;
use crate::hardware::transaction::Kind;
use crate::hardware::transaction::{END_OF_JOB_BYTES, JOB_BYTES, PIXEL_BYTES};
use crate::replay::contention::{Burst, Cycle, Transaction, Workload};
use crate::replay::model::replayer::{Counters, Replayer, Sum};
use crate::replay::plan::setting::Setting;
use crate::replay::stream::subject::Subject;
use crate::replay::{Lines, Tally, TraceError};
use ground::ids::{NodeId, TileId};
use trace::tracer::RayKind;

/// Which tiles nodes take, as indices into those of the trace.
#[derive(Clone, Debug)]
pub enum Tiles {
    /// The next one goes to the node that asks for it.
    Shared(VecDeque<u32>),
    /// By node, by process: a node's own.
    Assigned(Vec<Vec<Vec<u32>>>),
}

/// What a node does, as simulated time comes to it, that the bus does not see.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Step {
    /// Before it asks for what belongs to the tile.
    TileBegins { node: NodeId, tile: TileId, now: Cycle },
    /// Before it asks for a record that it lacks: the first byte of the record's first line.
    Lacks { node: NodeId, address: u64 },
    /// After all that belongs to the tile but the message that it is done.
    TileEnds { node: NodeId, tile: TileId, now: Cycle },
}

/// Nodes with local memories, each taking tiles, reading what their rays read, and waiting for what is missing.
pub struct RecordedWork<'a, S: Subject, R, F> {
    subject: &'a S,
    lines: &'a S::Lines,
    tiles: Queue,
    nodes: Vec<Node<'a, S, R>>,
    line_bytes: u32,
    /// Told of each step.
    on_step: F,
}

enum Queue {
    Shared(VecDeque<u32>),
    /// By node, from its next tile on; whether a process begins with it.
    Assigned(Vec<VecDeque<(u32, bool)>>),
}

struct Node<'a, S: Subject, R> {
    memory: Replayer<'a, R, S::Lines>,
    tally: Cost<'a, S>,
    doing: Doing,
    tile: u32,
    /// Parts of the tile that were not read yet.
    parts: Range<u32>,
    /// Words of the current part, and how many of them are done.
    words: Vec<u32>,
    done: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Doing {
    Nothing,
    Tracing,
    /// The pixels are written; the end is to be reported.
    Ending,
}

impl<'a, S: Subject, R: Replacement, F: FnMut(Step)> RecordedWork<'a, S, R, F> {
    /// The setting's number of nodes with such memories; of assigned tiles there is a list per node. `on_step` gets
    /// each step.
    ///
    /// # Errors
    /// Memories of more slots than can be simulated.
    pub fn new(
        subject: &'a S,
        lines: &'a S::Lines,
        geometry: Geometry,
        tiles: Tiles,
        setting: &Setting,
        on_step: F,
    ) -> Result<Self, TraceError> {
        let node = |_| {
            Ok::<_, TraceError>(Node {
                memory: Replayer::new(lines, geometry, subject.seed())?,
                tally: Cost {
                    subject,
                    by_kind: subject.read_cycles(&setting.processor),
                    cycles: 0,
                    sum: Sum::new(subject),
                },
                doing: Doing::Nothing,
                tile: 0,
                parts: 0..0,
                words: Vec::new(),
                done: 0,
            })
        };
        let tiles = match tiles {
            Tiles::Shared(tiles) => Queue::Shared(tiles),
            Tiles::Assigned(nodes) => Queue::Assigned(nodes.into_iter().map(one_after_the_other).collect()),
        };
        let line_bytes = geometry.line_bytes;
        let nodes = (0..setting.nodes).map(node).collect::<Result<_, _>>()?;
        Ok(Self { subject, lines, tiles, nodes, line_bytes, on_step })
    }

    /// What all nodes counted in accepted tiles.
    pub fn totals(self) -> Counters {
        let mut totals = Counters::default();
        self.nodes.into_iter().for_each(|node| totals.add(&node.tally.sum.finish()));
        totals
    }

    /// The node's next tile, and whether its memory is a new process's.
    fn take(&mut self, node: NodeId) -> Option<(u32, bool)> {
        match &mut self.tiles {
            Queue::Shared(tiles) => tiles.pop_front().map(|tile| (tile, false)),
            Queue::Assigned(nodes) => nodes.get_mut(usize::from(node.0))?.pop_front(),
        }
    }

    fn begin(&mut self, id: NodeId, now: Cycle) -> Option<Burst> {
        let (tile, is_new) = self.take(id)?;
        let node = &mut self.nodes[usize::from(id.0)];
        if is_new {
            node.memory.clear();
        }
        node.parts = self.subject.tiles()[tile as usize].parts.clone();
        (node.tile, node.doing) = (tile, Doing::Tracing);
        node.words.clear();
        node.done = 0;
        node.tally.tile(tile);
        (self.on_step)(Step::TileBegins { node: id, tile: self.subject.tiles()[tile as usize].tile, now });
        Some(message(0, Kind::Job, JOB_BYTES))
    }

    /// Up to the next miss, or to the end of the tile.
    fn trace(&mut self, id: NodeId) -> Result<Burst, TraceError> {
        let node = &mut self.nodes[usize::from(id.0)];
        loop {
            let (done, missing) = node.memory.until_miss(&node.words[node.done..], &mut node.tally)?;
            node.done += done;
            if missing > 0 {
                let (first, _) = self.lines.of(node.words[node.done - 1]);
                let address = u64::from(first) * u64::from(self.line_bytes);
                (self.on_step)(Step::Lacks { node: id, address });
                let transaction = Transaction { kind: Kind::Fetch, bytes: missing * self.line_bytes };
                return Ok(Burst { compute_cycles: node.tally.take(), transaction: Some(transaction) });
            }
            let Some(part) = node.parts.next() else { break };
            self.subject.read(part, &mut node.words)?;
            node.done = 0;
        }
        node.doing = Doing::Ending;
        let pixels = self.subject.pixels(node.tile).saturating_mul(PIXEL_BYTES);
        Ok(message(node.tally.take(), Kind::Pixels, pixels))
    }

    fn end(&mut self, id: NodeId, now: Cycle) {
        let node = &mut self.nodes[usize::from(id.0)];
        node.doing = Doing::Nothing;
        (self.on_step)(Step::TileEnds { node: id, tile: self.subject.tiles()[node.tile as usize].tile, now });
    }
}

impl<S: Subject, R: Replacement, F: FnMut(Step)> Workload for RecordedWork<'_, S, R, F> {
    type Error = TraceError;

    fn next(&mut self, id: NodeId, now: Cycle) -> Result<Option<Burst>, TraceError> {
        match self.nodes[usize::from(id.0)].doing {
            Doing::Nothing => Ok(self.begin(id, now)),
            Doing::Tracing => self.trace(id).map(Some),
            Doing::Ending => {
                self.end(id, now);
                Ok(Some(message(0, Kind::Job, END_OF_JOB_BYTES)))
            }
        }
    }
}

fn message(compute_cycles: Cycle, kind: Kind, bytes: u32) -> Burst {
    Burst { compute_cycles, transaction: Some(Transaction { kind, bytes }) }
}

/// A node's tiles, of whichever process; true where one after the first begins.
fn one_after_the_other(processes: Vec<Vec<u32>>) -> VecDeque<(u32, bool)> {
    let process = |(epoch, tiles): (usize, Vec<u32>)| {
        tiles.into_iter().enumerate().map(move |(i, tile)| (tile, epoch > 0 && i == 0))
    };
    processes.into_iter().enumerate().flat_map(process).collect()
}

/// Cycles of what was read since they were taken last, beside the counts.
struct Cost<'a, S> {
    subject: &'a S,
    by_kind: Vec<u32>,
    cycles: Cycle,
    sum: Sum<'a, S>,
}

impl<S> Cost<'_, S> {
    fn take(&mut self) -> Cycle {
        std::mem::take(&mut self.cycles)
    }
}

impl<S: Subject> Tally for Cost<'_, S> {
    fn tile(&mut self, tile: u32) {
        self.sum.tile(tile);
    }

    fn ray(&mut self, _kind: RayKind) {}

    #[inline(always)]
    fn read(&mut self, record: u32, lines: u32, missing: u32) {
        self.cycles += Cycle::from(self.by_kind[self.subject.kind(record)]);
        self.sum.read(record, lines, missing);
    }
}
