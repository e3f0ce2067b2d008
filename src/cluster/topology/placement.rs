//! Which host holds which process: a function of the topology.

use super::Cluster;
use super::host::{Host, Launch};
use ground::ids::{ClusterId, NodeId};

/// At least one host; the first is the manager's own, and holds what no other claims.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placement {
    hosts: Vec<Host>,
    /// Of every node, by its id.
    nodes: Vec<usize>,
}

impl Placement {
    /// Nodes go to the hosts in the order of both, so that the nodes of a cluster stay together.
    pub fn new(hosts: &[Host], cluster: &Cluster) -> Self {
        let hosts = if hosts.is_empty() { vec![Host::here(cluster.all_nodes())] } else { hosts.to_vec() };
        let places = |(at, host): (usize, &Host)| std::iter::repeat_n(at, usize::from(host.nodes));
        Self { nodes: hosts.iter().enumerate().flat_map(places).collect(), hosts }
    }

    pub fn hosts(&self) -> &[Host] {
        &self.hosts
    }

    pub fn of_manager(&self) -> &Host {
        &self.hosts[0]
    }

    /// The host of a cluster's bus and master.
    pub fn of_cluster(&self, cluster: ClusterId) -> &Host {
        self.hosts.iter().find(|host| host.clusters.contains(&cluster.0)).unwrap_or(&self.hosts[0])
    }

    pub fn of_display(&self) -> &Host {
        self.hosts.iter().find(|host| host.display).unwrap_or(&self.hosts[0])
    }

    pub fn of_node(&self, node: NodeId) -> &Host {
        self.nodes.get(usize::from(node.0)).map_or(&self.hosts[0], |&at| &self.hosts[at])
    }

    /// Whether somebody else starts some of the processes.
    pub fn has_joiners(&self) -> bool {
        self.hosts.iter().any(|host| host.launch == Launch::External)
    }

    /// An address, or a host, at which other machines can knock: TLS is needed.
    pub fn open_address(&self) -> Option<String> {
        self.hosts.iter().find_map(Host::open_address)
    }

    /// The first host with nodes that do not write into the output folder.
    pub fn nodes_without_files(&self) -> Option<&Host> {
        self.hosts.iter().find(|host| host.nodes > 0 && !host.shares_files())
    }
}
