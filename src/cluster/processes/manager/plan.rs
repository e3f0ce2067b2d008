//! What is to be rendered, by whom, and where to: all that processes are configured with.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use crate::keys::RoleKind;
use crate::protocol::control::{
    BusCommand, BusConfiguration, DisplayCommand, DisplayConfiguration, MasterCommand, MasterConfiguration,
    NodeCommand, NodeConfiguration,
};
use crate::protocol::hello::Role;
use crate::protocol::mac::MacKey;
use crate::topology::{Host, Launch, Placement, Run};
use ground::ids::{ClusterId, Epoch, RunId};
use machine::hardware::specification::Cluster;
use machine::recording::bus_log;
use trace::database::Header;
use trace::picture::{AovSet, Tiling};
use trace::tracer::View;
use trace::tracer::octree::Octree;

#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) cluster: Cluster,
    pub(super) placement: Placement,
    pub(super) octree: Octree,
    pub(super) run: Run,
    pub(super) id: RunId,
    /// For masters and displays: see [`crate::protocol::mac`].
    pub(super) key: MacKey,
    pub(super) header: Header,
    pub(super) view: View,
    pub(super) tiling: Tiling,
    pub(super) aov: AovSet,
    pub(super) exr: bool,
    pub(super) record_references: bool,
    /// The file of the display's journal.
    pub(super) journal: PathBuf,
    /// Whether an earlier run's tiles are taken over.
    pub(super) resume: bool,
    /// Of scene and image settings.
    pub(super) fingerprint: [u8; 32],
    /// The image file.
    pub(super) image: PathBuf,
    /// The folder of the recording.
    pub(super) recording: PathBuf,
}

/// Where the servers listen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Addresses {
    pub(super) bus: SocketAddr,
    pub(super) master: SocketAddr,
    pub(super) display: SocketAddr,
}

/// The host of a process.
pub(super) fn host_of(placement: &Placement, role: Role) -> &Host {
    match role {
        Role::Manager => placement.of_manager(),
        Role::Bus(cluster) | Role::Master(cluster) => placement.of_cluster(cluster),
        Role::Node(node) => placement.of_node(node),
        Role::Display => placement.of_display(),
    }
}

/// Whether the manager starts any process of this kind; the others join.
pub(super) fn starts(placement: &Placement, cluster: &Cluster, kind: RoleKind) -> bool {
    let here = |host: &Host| host.launch != Launch::External;
    match kind {
        RoleKind::Manager => false,
        RoleKind::Bus | RoleKind::Master => cluster.ids().any(|cluster| here(placement.of_cluster(cluster))),
        RoleKind::Display => here(placement.of_display()),
        RoleKind::Node => placement.hosts().iter().any(|host| host.nodes > 0 && here(host)),
    }
}

impl Plan {
    /// How long a process may take from its start to its connection: longer where somebody else starts it.
    pub(super) fn connect_deadline(&self, role: Role) -> Duration {
        match host_of(&self.placement, role).launch {
            Launch::External => self.run.deadlines.join,
            Launch::Local | Launch::Command(_) => self.run.deadlines.startup,
        }
    }

    pub(super) fn configure_bus(&self, cluster: ClusterId, epoch: Epoch) -> BusCommand {
        BusCommand::Configure(BusConfiguration {
            cluster,
            arbiter: self.cluster.bus.arbiter,
            layout: self.header.layout.clone(),
            recording: bus_log::folder_of(&self.recording, cluster, epoch),
        })
    }

    pub(super) fn configure_master(&self, cluster: ClusterId, bus: SocketAddr) -> MasterCommand {
        MasterCommand::Configure(MasterConfiguration {
            bus,
            first_node: self.cluster.first_node(cluster),
            nodes: self.cluster.nodes,
            threads: self.run.threads,
            assignment: self.run.assignment,
            tile_deadline_milliseconds: u64::try_from(self.run.deadlines.tile.as_millis()).unwrap_or(u64::MAX),
            key: self.key,
        })
    }

    pub(super) fn configure_node(&self, cluster: ClusterId, addresses: Addresses) -> NodeCommand {
        NodeCommand::Configure(Box::new(NodeConfiguration {
            cluster,
            master: addresses.master,
            bus: addresses.bus,
            display: addresses.display,
            header: self.header.clone(),
            view: self.view.clone(),
            tiling: self.tiling,
            aov: self.aov,
            octree: self.octree,
            local_memory: self.cluster.local_memory,
            threads: self.run.threads,
            seed: self.run.seed,
            references: self.record_references.then(|| self.recording.clone()),
        }))
    }

    pub(super) fn configure_display(&self, epoch: Epoch) -> DisplayCommand {
        DisplayCommand::Configure(DisplayConfiguration {
            tiling: self.tiling,
            aov: self.aov,
            journal: self.journal.clone(),
            resume: self.resume || epoch > Epoch(0),
            fingerprint: self.fingerprint,
            key: self.key,
            image: self.image.clone(),
            exr: self.exr,
        })
    }
}
