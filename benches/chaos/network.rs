//! Three hosts on one machine: network namespaces on a bridge, whose links are cut and healed.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::undisturbed::quiet;

const PORT: u16 = 4242;

/// Removed when it is dropped.
pub(crate) struct Network {
    prefix: String,
    pub(crate) keys: PathBuf,
}

/// How the processes of a run are spread over the hosts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spread {
    /// Nodes of each host; the third's join by themselves.
    pub(crate) nodes: [u32; 3],
    /// The cluster whose bus and master are on the second host.
    pub(crate) cluster: u32,
    pub(crate) display_on_second: bool,
}

/// A host's link is down from when so much of a run's tiles are in its journal, for so long.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkCut {
    /// 2 or 3: the first is the manager's.
    pub(crate) host: u32,
    pub(crate) percent: u32,
    pub(crate) time: Duration,
}

impl Network {
    pub(crate) fn new(folder: &Path) -> Self {
        let network = Self { prefix: format!("chaos{}", std::process::id()), keys: folder.join("keys") };
        let mut keys = quiet(Command::new(env!("CARGO_BIN_EXE_marti")));
        assert!(keys.args(["keys", "new"]).arg(&network.keys).status().is_ok_and(|status| status.success()), "keys");
        // Host 0 is the switch.
        for host in 0..4 {
            ip(&format!("netns add {}", network.namespace(host)));
        }
        let switch = network.namespace(0);
        ip(&format!("-n {switch} link add bridge type bridge"));
        ip(&format!("-n {switch} link set bridge up"));
        for host in 1..4 {
            let namespace = network.namespace(host);
            ip(&format!("-n {namespace} link set lo up"));
            ip(&format!("-n {switch} link add port{host} type veth peer name eth0 netns {namespace}"));
            ip(&format!("-n {switch} link set port{host} master bridge up"));
            ip(&format!("-n {namespace} address add {}/24 dev eth0", address(host)));
            ip(&format!("-n {namespace} link set eth0 up"));
        }
        network
    }

    /// The topology's `host`.
    pub(crate) fn hosts(&self, spread: &Spread) -> String {
        let Spread { nodes, cluster, display_on_second } = spread;
        format!(
            "host=[{{name=\"first\", bind=\"{}\", port={PORT}, nodes={}}}, {{name=\"{}\", bind=\"{}\", \
             launch=[\"ip\", \"netns\", \"exec\", \"{{host}}\", \"{{program}}\"], shared_files=true, nodes={}, \
             clusters=[{cluster}], display={display_on_second}}}, {{name=\"third\", launch=\"external\", nodes={}}}]",
            address(1),
            nodes[0],
            self.namespace(2),
            address(2),
            nodes[1],
            nodes[2],
        )
    }

    /// A program on a host.
    pub(crate) fn on(&self, host: u32, program: &str) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.namespace(host), program]);
        command
    }

    /// Nodes on the third host that join, as many as have places there.
    pub(crate) fn joiners(&self, spread: &Spread) -> Joiners {
        let join = |_| {
            let mut command = quiet(self.on(3, env!("CARGO_BIN_EXE_marti-node")));
            command.args(["--join", &format!("{}:{PORT}", address(1)), "--patience", "120", "--keys"]).arg(&self.keys);
            command.stdin(Stdio::null()).spawn().expect("marti-node can be started")
        };
        Joiners((0..spread.nodes[2]).map(join).collect())
    }

    /// Cuts off and heals as told, watching the journal; returns how many cuts there were before `is_over`.
    pub(crate) fn disturb(
        &self,
        cuts: &[LinkCut],
        journal: &Path,
        journal_bytes: u64,
        is_over: impl Fn() -> bool,
    ) -> Disturbed {
        let mut waiting = cuts.to_vec();
        let mut down: Vec<(u32, Instant)> = Vec::new();
        let mut disturbed = Disturbed::default();
        let (mut bytes, mut since) = (0, None::<Instant>);
        while !is_over() {
            let now = Instant::now();
            let found = std::fs::metadata(journal).map_or(0, |metadata| metadata.len());
            if found != bytes {
                // Before the first cut nothing waits for a recovery.
                if let Some(since) = since.filter(|_| disturbed.cuts > 0) {
                    disturbed.longest_wait = disturbed.longest_wait.max(now - since);
                }
                (bytes, since) = (found, Some(now));
            }
            down.retain(|(host, until)| {
                let stays = now < *until;
                if !stays {
                    self.link(*host, "up");
                }
                stays
            });
            waiting.retain(|cut| {
                let is_due = bytes * 100 >= u64::from(cut.percent) * journal_bytes;
                if is_due {
                    self.link(cut.host, "down");
                    down.push((cut.host, now + cut.time));
                    disturbed.cuts += 1;
                }
                !is_due
            });
            sleep(Duration::from_millis(2));
        }
        down.iter().for_each(|(host, _)| self.link(*host, "up"));
        disturbed
    }

    fn link(&self, host: u32, state: &str) {
        ip(&format!("-n {} link set port{host} {state}", self.namespace(0)));
    }

    fn namespace(&self, host: u32) -> String {
        format!("{}-{host}", self.prefix)
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        for host in 0..4 {
            let _ = Command::new("ip").args(["netns", "del", &self.namespace(host)]).status();
        }
    }
}

/// What came of cuts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Disturbed {
    pub(crate) cuts: u64,
    /// Between two tiles in the journal, from the first cut on.
    pub(crate) longest_wait: Duration,
}

/// Killed when they are dropped: who began anew too late to hear of the end would join the next run.
pub(crate) struct Joiners(Vec<Child>);

impl Drop for Joiners {
    fn drop(&mut self) {
        for process in &mut self.0 {
            // It may have ended by itself.
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

fn address(host: u32) -> String {
    format!("10.97.0.{host}")
}

fn ip(arguments: &str) {
    let status = Command::new("ip").args(arguments.split(' ')).status().expect("ip of iproute2 can be started");
    assert!(status.success(), "ip {arguments}: --namespaces needs root, and a kernel with network namespaces");
}
