//! The clusters: each a bus, a master, and the nodes that share them. When one of the two servers dies, all of the cluster
//! is ended, and starts again under a new epoch: bus, memory and nodes know nothing of the former one.

use std::net::SocketAddr;

use super::super::event::Action;
use super::super::plan::Addresses;
use super::super::process::{Command, Process, ProcessId, Stage};
use super::process_table::seconds;
use super::supervision::{Exit, FAILURES_MAX, Supervision};
use super::tiles::JobQueue;
use crate::protocol::control::MasterCommand;
use crate::protocol::hello::Role;
use crate::protocol::work::tiles_per_node;
use ground::ids::{ClusterId, Epoch, NodeId};
use machine::hardware::specification;

/// A node is set aside after so many processes of it left without a tile done in between. More than [`FAILURES_MAX`]: an
/// operator may ask one process after the other to go.
const DEPARTURES_MAX: u32 = 20;

/// Tiles that a node may do before one that its master has.
const SILENT_TILES: u32 = 10;

#[derive(Debug)]
pub(crate) struct Clusters {
    specification: specification::Cluster,
    /// By cluster id.
    clusters: Vec<Cluster>,
    /// By node id.
    slots: Vec<NodeSlot>,
}

#[derive(Debug)]
pub(crate) struct Cluster {
    pub(crate) id: ClusterId,
    /// Of its bus and its master.
    epoch: Epoch,
    bus: Option<SocketAddr>,
    master: Option<SocketAddr>,
    /// The bus has the database.
    uploaded: bool,
    /// How many more tiles its master can take.
    pub(crate) wanted: u32,
    /// Since the last tile done.
    failures: u32,
    /// Whatever its nodes' slots say.
    set_aside: bool,
    /// Its processes are being ended, to be started again.
    stopping: bool,
}

/// What processes of a node hold one after the other.
#[derive(Clone, Copy, Debug, Default)]
struct NodeSlot {
    /// Of the process that holds it, or held it last.
    epoch: Epoch,
    /// Since the last tile done.
    failures: u32,
    /// Processes that left as they were asked to, since the last tile done.
    departures: u32,
    set_aside: bool,
}

impl Cluster {
    fn new(id: ClusterId) -> Self {
        Self {
            id,
            epoch: Epoch(0),
            bus: None,
            master: None,
            uploaded: false,
            wanted: 0,
            failures: 0,
            set_aside: false,
            stopping: false,
        }
    }

    /// Where bus and master listen, once tiles can be traced there.
    pub(crate) fn servers(&self) -> Option<(SocketAddr, SocketAddr)> {
        if self.uploaded && !self.stopping { self.bus.zip(self.master) } else { None }
    }

    fn bus_process(&self) -> ProcessId {
        ProcessId { role: Role::Bus(self.id), epoch: self.epoch }
    }

    fn master_process(&self) -> ProcessId {
        ProcessId { role: Role::Master(self.id), epoch: self.epoch }
    }
}

impl Clusters {
    pub(super) fn new(specification: specification::Cluster) -> Self {
        Self {
            specification,
            clusters: specification.ids().map(Cluster::new).collect(),
            slots: vec![NodeSlot::default(); usize::from(specification.all_nodes())],
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Cluster> {
        self.clusters.iter()
    }

    fn cluster(&mut self, id: ClusterId) -> &mut Cluster {
        &mut self.clusters[usize::from(id.0)]
    }

    fn slot(&self, node: NodeId) -> &NodeSlot {
        &self.slots[usize::from(node.0)]
    }

    /// The nodes of a cluster.
    fn members(&self, cluster: ClusterId) -> impl Iterator<Item = NodeId> + use<> {
        let first = self.specification.first_node(cluster).0;
        (first..first + self.specification.nodes).map(NodeId)
    }

    /// Whether a process is one of a cluster's servers or nodes.
    fn is_part(&self, process: &Process, id: ClusterId) -> bool {
        match process.id.role {
            Role::Bus(cluster) | Role::Master(cluster) => cluster == id,
            Role::Node(node) => self.specification.of(node) == id,
            Role::Manager | Role::Display => false,
        }
    }

    /// The nodes of a cluster that can do tiles, now or when their slot is taken again.
    fn available(&self, cluster: ClusterId) -> Vec<NodeId> {
        if self.clusters[usize::from(cluster.0)].set_aside {
            return Vec::new();
        }
        self.members(cluster).filter(|&node| !self.slot(node).set_aside).collect()
    }

    /// Nodes of all clusters that can do tiles.
    pub(super) fn all_available(&self) -> Vec<NodeId> {
        self.specification.ids().flat_map(|cluster| self.available(cluster)).collect()
    }

    pub(super) fn start_all(&mut self, supervision: &mut Supervision) {
        self.specification.ids().for_each(|cluster| self.start(cluster, supervision));
    }

    fn start(&mut self, id: ClusterId, supervision: &mut Supervision) {
        let cluster = self.cluster(id);
        supervision.spawn(cluster.bus_process());
        supervision.spawn(cluster.master_process());
        for node in self.available(id) {
            supervision.spawn(ProcessId { role: Role::Node(node), epoch: self.slot(node).epoch });
        }
    }

    pub(super) fn bus_listens(
        &mut self,
        id: ProcessId,
        cluster: ClusterId,
        address: SocketAddr,
        supervision: &mut Supervision,
    ) {
        supervision.enter(id, Stage::Serving);
        let entry = self.cluster(cluster);
        entry.bus = Some(address);
        supervision.actions.push(Action::Upload(id, address));
        let master = entry.master_process();
        self.configure_master(master, cluster, supervision);
    }

    pub(super) fn master_listens(
        &mut self,
        id: ProcessId,
        cluster: ClusterId,
        address: SocketAddr,
        supervision: &mut Supervision,
    ) {
        supervision.enter(id, Stage::Serving);
        self.cluster(cluster).master = Some(address);
        // It would keep tiles for nodes that do not come.
        let aside: Vec<_> = self.members(cluster).filter(|&node| self.slot(node).set_aside).collect();
        for node in aside {
            self.tell_master(cluster, MasterCommand::NodeSetAside { node }, supervision);
        }
    }

    /// The bus has the database.
    pub(super) fn uploaded(&mut self, id: ProcessId) {
        if let Role::Bus(cluster) = id.role
            && self.cluster(cluster).bus_process() == id
        {
            self.cluster(cluster).uploaded = true;
        }
    }

    /// Once it is connected and the bus listens.
    pub(super) fn configure_master(&mut self, id: ProcessId, cluster: ClusterId, supervision: &mut Supervision) {
        if let Some(bus) = self.cluster(cluster).bus {
            supervision.tell(id, Command::Master(supervision.plan.configure_master(cluster, bus)));
        }
    }

    /// Nodes that are connected, once their servers are there.
    pub(super) fn configure_nodes(&mut self, display: SocketAddr, supervision: &mut Supervision) {
        for id in supervision.those(|process| process.stage == Stage::Connected) {
            let Role::Node(node) = id.role else { continue };
            let cluster = self.specification.of(node);
            let Some((bus, master)) = self.cluster(cluster).servers() else { continue };
            let addresses = Addresses { bus, master, display };
            supervision.tell(id, Command::Node(supervision.plan.configure_node(cluster, addresses)));
            supervision.enter(id, Stage::Serving);
        }
    }

    /// A master, which has `out` tiles, can take so many more. It is given [`tiles_per_node`] at most, whatever it asks for.
    pub(super) fn want(&mut self, cluster: ClusterId, tiles: u32, out: u32, threads: u16) {
        let room = (tiles_per_node(threads) * u32::from(self.specification.nodes)).saturating_sub(out);
        let wanted = &mut self.cluster(cluster).wanted;
        *wanted = wanted.saturating_add(tiles).min(room);
    }

    /// Whether there is such a node in a cluster.
    pub(super) fn has(&self, cluster: ClusterId, node: NodeId) -> bool {
        usize::from(node.0) < self.slots.len() && self.specification.of(node) == cluster
    }

    /// Kills masters that report nothing of a tile. A master asks for eight tiles per node and thread, each thread does one tile after the
    /// other within the tile deadline, or is reported as late, and may have to join first: no honest one is silent for so long.
    pub(super) fn kill_silent_masters(&self, queue: &JobQueue, supervision: &mut Supervision) {
        let deadlines = supervision.plan.run.deadlines;
        let longest = SILENT_TILES * deadlines.tile + deadlines.join;
        for cluster in &self.clusters {
            if let Some((tile, since)) = queue.oldest(cluster.id)
                && supervision.now.saturating_sub(since) > longest
            {
                let why = format!("reported nothing of {tile} for more than {}", seconds(longest));
                supervision.kill_unless_killed(cluster.master_process(), why);
            }
        }
    }

    /// Gives masters what they can take.
    pub(super) fn hand_out(&mut self, queue: &mut JobQueue, supervision: &mut Supervision) {
        for id in self.specification.ids() {
            let cluster = self.cluster(id);
            let wanted = cluster.wanted;
            if wanted == 0 || cluster.servers().is_none() {
                continue;
            }
            let available = self.available(id);
            // A master without nodes would give all of it back.
            if available.is_empty() {
                continue;
            }
            let grants = queue.grants(id, wanted, &available, supervision.now);
            if !grants.is_empty() {
                self.cluster(id).wanted -= grants.len() as u32;
                self.tell_master(id, MasterCommand::Tiles(grants), supervision);
            }
        }
    }

    /// A tile is done: what failed before is forgiven.
    pub(super) fn forgive(&mut self, cluster: ClusterId, node: NodeId) {
        self.cluster(cluster).failures = 0;
        if let Some(slot) = self.slots.get_mut(usize::from(node.0)) {
            (slot.failures, slot.departures) = (0, 0);
        }
    }

    /// A server of the cluster has died.
    pub(super) fn server_exited(
        &mut self,
        cluster: ClusterId,
        exit: Exit,
        is_running: bool,
        queue: &mut JobQueue,
        supervision: &mut Supervision,
    ) {
        let is_stopping = self.cluster(cluster).stopping;
        if !is_stopping {
            if exit.was_expected {
                return;
            }
            supervision.incident(exit.how);
        }
        if !is_running {
            return;
        }
        if !is_stopping {
            self.stop(cluster, supervision);
        }
        self.restart_stopped(cluster, queue, supervision);
    }

    /// Ends what is left of a cluster.
    fn stop(&mut self, id: ClusterId, supervision: &mut Supervision) {
        let cluster = self.cluster(id);
        (cluster.bus, cluster.master, cluster.uploaded) = (None, None, false);
        (cluster.wanted, cluster.stopping) = (0, true);
        cluster.failures += 1;
        for member in supervision.those(|process| self.is_part(process, id)) {
            supervision.dismiss(member);
        }
    }

    /// Starts a cluster again once all of its former processes are confirmed dead.
    fn restart_stopped(&mut self, id: ClusterId, queue: &mut JobQueue, supervision: &mut Supervision) {
        if supervision.table.iter().any(|process| self.is_part(process, id)) {
            return;
        }
        queue.lose_cluster(id);
        let cluster = self.cluster(id);
        cluster.stopping = false;
        if cluster.failures < FAILURES_MAX {
            cluster.epoch.0 += 1;
            for node in self.members(id) {
                self.slots[usize::from(node.0)].epoch.0 += 1;
            }
            return self.start(id, supervision);
        }
        cluster.set_aside = true;
        supervision.incident(format!("{id} is set aside: it failed {FAILURES_MAX} times without a tile done"));
        self.members(id).for_each(|node| queue.set_aside(node));
    }

    /// A node's process is dead.
    pub(super) fn node_exited(
        &mut self,
        node: NodeId,
        exit: Exit,
        is_running: bool,
        queue: &mut JobQueue,
        supervision: &mut Supervision,
    ) {
        let id = self.specification.of(node);
        if self.cluster(id).stopping {
            if is_running {
                self.restart_stopped(id, queue, supervision);
            }
            return;
        }
        self.tell_master(id, MasterCommand::NodeLost { node, epoch: exit.id.epoch }, supervision);
        if !exit.was_expected {
            supervision.incident(exit.how);
        }
        if is_running {
            self.replace(node, !exit.left, queue, supervision);
        }
    }

    /// Another process takes a node's slot, unless too many have failed there in a row.
    fn replace(&mut self, node: NodeId, failed: bool, queue: &mut JobQueue, supervision: &mut Supervision) {
        let Some(slot) = self.slots.get_mut(usize::from(node.0)).filter(|slot| !slot.set_aside) else { return };
        slot.failures += u32::from(failed);
        slot.departures += u32::from(!failed);
        let why = if slot.failures >= FAILURES_MAX {
            format!("it failed {FAILURES_MAX} times without a tile done")
        } else if slot.departures >= DEPARTURES_MAX {
            format!("it left {DEPARTURES_MAX} times without a tile done")
        } else {
            slot.epoch.0 += 1;
            return supervision.spawn(ProcessId { role: Role::Node(node), epoch: slot.epoch });
        };
        self.set_aside(node, &why, queue, supervision);
    }

    /// A node gets no more tiles in this run.
    pub(super) fn set_aside(&mut self, node: NodeId, why: &str, queue: &mut JobQueue, supervision: &mut Supervision) {
        let Some(slot) = self.slots.get_mut(usize::from(node.0)) else { return };
        if std::mem::replace(&mut slot.set_aside, true) {
            return;
        }
        supervision.incident(format!("{node} is set aside: {why}"));
        queue.set_aside(node);
        self.tell_master(self.specification.of(node), MasterCommand::NodeSetAside { node }, supervision);
    }

    /// A master that does not serve yet has handed nothing out: there is nothing to send it.
    fn tell_master(&mut self, cluster: ClusterId, command: MasterCommand, supervision: &mut Supervision) {
        let id = self.cluster(cluster).master_process();
        if supervision.table.get_mut(id).is_some_and(|master| master.stage == Stage::Serving) {
            supervision.tell(id, Command::Master(command));
        }
    }
}
