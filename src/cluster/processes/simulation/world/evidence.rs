//! What hostile and corrupt processes did, and what honest ones counted: the invariants ask.

use super::*;

impl World<'_> {
    /// Attempts whose pixels hostile nodes made up, finite and under their own permit.
    pub(super) fn made_up(&self) -> HashSet<(Producer, TileId, Attempt)> {
        let hostile = self.processes.iter().flatten().filter(|process| process.is_hostile());
        let all = hostile.flat_map(|process| {
            let by = self.producer(process.child().id);
            process.plausible().map(move |(tile, attempt)| (by, tile, attempt))
        });
        all.collect()
    }

    /// Whether pixels of an attempt were made up so that only `verify` can find it.
    pub(in super::super) fn is_made_up(&self, by: Producer, tile: TileId, attempt: Attempt) -> bool {
        self.made_up_before.contains(&(by, tile, attempt)) || self.made_up().contains(&(by, tile, attempt))
    }

    /// Nodes of which a process became corrupt.
    pub(in super::super) fn corrupted_nodes(&self) -> usize {
        let before = self.made_up_before.iter().map(|(by, ..)| by.node);
        self.corrupted.iter().map(|by| by.node).chain(before).collect::<HashSet<_>>().len()
    }

    pub(super) fn producer(&self, id: ProcessId) -> Producer {
        let node = if let Role::Node(node) = id.role { node } else { NodeId(u16::MAX) };
        Producer { run: self.run, node, epoch: id.epoch }
    }

    /// What a node counted of a tile that its honest master reports done, if it is honest; one that is not, and whose counts
    /// cannot be, is to be named.
    pub(super) fn reported_done(&mut self, event: &Event) -> Option<(NodeId, Counts)> {
        let &Event::Report(master, Report::Master(MasterReport::Done { node, epoch, ref done })) = event else {
            return None;
        };
        if self.process(master)?.is_hostile() {
            return None;
        }
        let id = ProcessId { role: Role::Node(node), epoch };
        let Process::Node(host) = self.process(id)? else { return None };
        if host.hostile.is_none() {
            return Some((node, host.worker.counted.get(&(done.tile, done.attempt)).cloned()?));
        }
        if self.manager.is_running() && (done.trace.rays[0] != 1 || done.trace.primitive_tests > 1 << 40) {
            self.forgeries.insert((master, self.producer(id)));
        }
        None
    }

    /// A forgery that reaches an honest process is to be named.
    pub(super) fn note_forgery(&mut self, to: Actor, wire: Wire, parcel: &Parcel) {
        let Parcel::Message(Message::Frame(frame)) = parcel else { return };
        let by = self.processes.get(self.network.peer(to, wire).0).and_then(Option::as_ref);
        let (Some(by), Some(process)) = (by.filter(|by| by.is_hostile()), &self.processes[to.0]) else { return };
        let Role::Node(_) = by.child().id.role else { return };
        if self.manager.is_running() && !process.is_hostile() && process.reads(wire) {
            let producer = self.producer(by.child().id);
            if forgery::is_forged(process, producer, frame) {
                self.forgeries.insert((process.child().id, producer));
                if let Some(Interrupt::Forgery(after)) = self.schedule.interrupt {
                    self.interrupt(after);
                }
            }
        }
    }

    pub(super) fn check_bounds(&mut self, actor: Actor) {
        let Some(process) = &self.processes[actor.0] else { return };
        if process.is_hostile() {
            return;
        }
        if let Process::Master(master) = process {
            let tiles = master.machine.tiles().div_ceil(usize::from(self.schedule.scenario.nodes));
            self.tiles_a_node = self.tiles_a_node.max(tiles);
        }
        if let Some(excess) = bounds::of_process(process, self.schedule, self.processes.len()) {
            self.excess.get_or_insert(excess);
        }
    }
}
