//! A cluster as the manager sees it: a bus, a master, and the nodes that share them. When one of the two servers dies,
//! all of the cluster is ended, and starts again under a new epoch: bus, memory and nodes know nothing of the former one.

use std::net::SocketAddr;

use super::ending::Cause;
use super::process::{Command, Process, ProcessId, Stage};
use super::state::{Action, FAILURES_MAX, Phase, State};
use crate::ids::{ClusterId, Epoch, NodeId};
use crate::protocol::control::MasterCommand;
use crate::protocol::hello::Role;

/// A node is set aside after so many processes of it left without a tile done in between. More than [`FAILURES_MAX`]: an
/// operator may ask one process after the other to go.
const DEPARTURES_MAX: u32 = 20;

#[derive(Debug)]
pub(super) struct Cluster {
    pub(super) id: ClusterId,
    /// Of its bus and its master.
    pub(super) epoch: Epoch,
    pub(super) bus: Option<SocketAddr>,
    pub(super) master: Option<SocketAddr>,
    /// The bus has the database.
    pub(super) uploaded: bool,
    /// How many more tiles its master can take.
    pub(super) wanted: u32,
    /// Since the last tile done.
    pub(super) failures: u32,
    pub(super) set_aside: bool,
    /// Its processes are being ended.
    falling: bool,
}

/// A node's place, which processes hold one after the other.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    /// Of the process that holds it, or held it last.
    pub(super) epoch: Epoch,
    /// Since the last tile done.
    pub(super) failures: u32,
    /// Processes that left as they were asked to, since the last tile done.
    pub(super) departures: u32,
    pub(super) set_aside: bool,
}

impl Cluster {
    pub(super) fn new(id: ClusterId) -> Self {
        Self {
            id,
            epoch: Epoch(0),
            bus: None,
            master: None,
            uploaded: false,
            wanted: 0,
            failures: 0,
            set_aside: false,
            falling: false,
        }
    }

    /// Where bus and master listen, once tiles can be traced there.
    pub(super) fn servers(&self) -> Option<(SocketAddr, SocketAddr)> {
        if self.uploaded && !self.falling { self.bus.zip(self.master) } else { None }
    }

    fn bus_process(&self) -> ProcessId {
        ProcessId { role: Role::Bus(self.id), epoch: self.epoch }
    }

    pub(super) fn master_process(&self) -> ProcessId {
        ProcessId { role: Role::Master(self.id), epoch: self.epoch }
    }
}

impl State {
    pub(super) fn cluster(&mut self, id: ClusterId) -> &mut Cluster {
        &mut self.clusters[usize::from(id.0)]
    }

    /// The nodes of a cluster.
    fn members(&self, cluster: ClusterId) -> impl Iterator<Item = NodeId> + use<> {
        let first = self.plan.cluster.first_node(cluster).0;
        (first..first + self.plan.cluster.nodes).map(NodeId)
    }

    /// The nodes of a cluster that can do tiles, now or when their place is taken again.
    pub(super) fn available(&self, cluster: ClusterId) -> Vec<NodeId> {
        if self.clusters[usize::from(cluster.0)].set_aside {
            return Vec::new();
        }
        self.members(cluster).filter(|node| !self.places[usize::from(node.0)].set_aside).collect()
    }

    /// Nodes of all clusters that can do tiles.
    pub(super) fn all_available(&self) -> Vec<NodeId> {
        self.plan.cluster.ids().flat_map(|cluster| self.available(cluster)).collect()
    }

    pub(super) fn start_cluster(&mut self, id: ClusterId) {
        let epoch = self.cluster(id).epoch;
        self.spawn(ProcessId { role: Role::Bus(id), epoch });
        self.spawn(ProcessId { role: Role::Master(id), epoch });
        for node in self.available(id) {
            let epoch = self.places[usize::from(node.0)].epoch;
            self.spawn(ProcessId { role: Role::Node(node), epoch });
        }
    }

    pub(super) fn bus_listens(&mut self, id: ProcessId, cluster: ClusterId, address: SocketAddr) {
        self.enter(id, Stage::Serving);
        self.cluster(cluster).bus = Some(address);
        self.actions.push(Action::Upload(id, address));
        let master = self.cluster(cluster).master_process();
        self.configure_master(master, cluster);
    }

    pub(super) fn master_listens(&mut self, id: ProcessId, cluster: ClusterId, address: SocketAddr) {
        self.enter(id, Stage::Serving);
        self.cluster(cluster).master = Some(address);
        // It would keep tiles for nodes that do not come.
        let is_aside = |node: &NodeId| self.places[usize::from(node.0)].set_aside;
        let aside: Vec<_> = self.members(cluster).filter(is_aside).collect();
        aside.into_iter().for_each(|node| self.tell_master(cluster, MasterCommand::NodeSetAside { node }));
        self.configure_nodes();
    }

    pub(super) fn uploaded(&mut self, id: ProcessId) {
        if let Role::Bus(cluster) = id.role
            && self.cluster(cluster).bus_process() == id
        {
            self.cluster(cluster).uploaded = true;
            self.configure_nodes();
        }
    }

    /// Once it is connected and the bus listens.
    pub(super) fn configure_master(&mut self, id: ProcessId, cluster: ClusterId) {
        if let Some(bus) = self.cluster(cluster).bus {
            self.tell(id, Command::Master(self.plan.configure_master(cluster, bus)));
        }
    }

    /// A server of the cluster has died.
    pub(super) fn server_exited(&mut self, cluster: ClusterId, how: String, was_expected: bool) {
        if self.cluster(cluster).falling {
            return self.rise(cluster);
        }
        if was_expected {
            return;
        }
        self.ledger.incident(self.now, how);
        if matches!(self.phase, Phase::Running) {
            self.fall(cluster);
        }
    }

    /// A bus that cannot write its recording, as a rule. While the run goes on another one takes its place; at the end of
    /// the run no process can write what is missing.
    pub(super) fn bus_failed(&mut self, id: ProcessId, why: &str) {
        match self.phase {
            Phase::Running => self.doom(id, format!("failed: {why}")),
            Phase::Ending(_) | Phase::Over(_) => self.fail(format!("{id} failed: {why}")),
        }
    }

    /// Ends what is left of a cluster.
    fn fall(&mut self, id: ClusterId) {
        let cluster = self.cluster(id);
        (cluster.bus, cluster.master, cluster.uploaded) = (None, None, false);
        (cluster.wanted, cluster.falling) = (0, true);
        cluster.failures += 1;
        let clusters = self.plan.cluster;
        let belongs = |process: &&Process| match process.id.role {
            Role::Bus(cluster) | Role::Master(cluster) => cluster == id,
            Role::Node(node) => clusters.of(node) == id,
            Role::Manager | Role::Display => false,
        };
        let members: Vec<_> = self.table.iter().filter(belongs).map(|process| process.id).collect();
        members.into_iter().for_each(|member| self.dismiss(member));
        self.rise(id);
    }

    /// Starts a cluster again once all of its former processes are confirmed dead.
    pub(super) fn rise(&mut self, id: ClusterId) {
        let clusters = self.plan.cluster;
        let is_left = self.table.iter().any(|process| match process.id.role {
            Role::Bus(cluster) | Role::Master(cluster) => cluster == id,
            Role::Node(node) => clusters.of(node) == id,
            Role::Manager | Role::Display => false,
        });
        if is_left || !self.cluster(id).falling || !matches!(self.phase, Phase::Running) {
            return;
        }
        self.queue.lose_cluster(id);
        let cluster = self.cluster(id);
        cluster.falling = false;
        if cluster.failures < FAILURES_MAX {
            cluster.epoch.0 += 1;
            for node in self.members(id) {
                self.places[usize::from(node.0)].epoch.0 += 1;
            }
            return self.start_cluster(id);
        }
        cluster.set_aside = true;
        self.ledger
            .incident(self.now, format!("{id} is set aside: it failed {FAILURES_MAX} times without a tile done"));
        self.members(id).for_each(|node| self.queue.set_aside(node));
        self.end_without_nodes();
    }

    /// A node's process is dead; `left`: as it was asked to.
    pub(super) fn node_exited(&mut self, (node, epoch): (NodeId, Epoch), how: String, was_expected: bool, left: bool) {
        let id = self.plan.cluster.of(node);
        if self.cluster(id).falling {
            return self.rise(id);
        }
        self.tell_master(id, MasterCommand::NodeLost { node, epoch });
        // Why a process was condemned is reported already.
        if !was_expected && !self.verification.is_condemned(self.producer(node, epoch)) {
            self.ledger.incident(self.now, how);
        }
        if matches!(self.phase, Phase::Running) {
            self.replace(node, !left);
        }
    }

    /// Another process takes a node's place, unless too many have failed there in a row.
    fn replace(&mut self, node: NodeId, failed: bool) {
        let Some(place) = self.places.get_mut(usize::from(node.0)) else { return };
        if place.set_aside {
            return;
        }
        place.failures += u32::from(failed);
        place.departures += u32::from(!failed);
        let Place { failures, departures, .. } = *place;
        if failures >= FAILURES_MAX {
            return self.set_aside(node, &format!("it failed {FAILURES_MAX} times without a tile done"));
        }
        if departures >= DEPARTURES_MAX {
            return self.set_aside(node, &format!("it left {DEPARTURES_MAX} times without a tile done"));
        }
        place.epoch.0 += 1;
        let epoch = place.epoch;
        self.spawn(ProcessId { role: Role::Node(node), epoch });
    }

    /// A node gets no more tiles in this run.
    pub(super) fn set_aside(&mut self, node: NodeId, why: &str) {
        let Some(place) = self.places.get_mut(usize::from(node.0)) else { return };
        if std::mem::replace(&mut place.set_aside, true) {
            return;
        }
        self.ledger.incident(self.now, format!("{node} is set aside: {why}"));
        self.queue.set_aside(node);
        self.tell_master(self.plan.cluster.of(node), MasterCommand::NodeSetAside { node });
        self.end_without_nodes();
    }

    fn end_without_nodes(&mut self) {
        if self.all_available().is_empty() && matches!(self.phase, Phase::Running) {
            self.end(Cause::NoNodes);
        }
    }

    /// A master that does not serve yet has handed nothing out: there is nothing to tell it.
    pub(super) fn tell_master(&mut self, cluster: ClusterId, command: MasterCommand) {
        let id = self.cluster(cluster).master_process();
        if self.table.get_mut(id).is_some_and(|master| master.stage == Stage::Serving) {
            self.tell(id, Command::Master(command));
        }
    }
}
