//! `[[host]]`: on which machines the processes run, and how they come to life there.

use std::net::{IpAddr, Ipv4Addr};

/// A machine, or any number of machines whose processes come by themselves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Host {
    /// Unique; in a launcher's command it stands for `{host}`.
    pub name: String,
    /// Where servers listen. `None`: at the interface by which they reach the manager.
    pub bind: Option<IpAddr>,
    /// Under which IP address or name others reach the servers; `None`: under the one that they listen at.
    pub advertise: Option<String>,
    /// Of the manager, for those who join; 0: any. Nothing to any host but the first.
    pub port: u16,
    pub launch: Launch,
    /// The folder of the programs; `None`: that of the manager's own.
    pub programs: Option<String>,
    /// Whether it sees the output folder, at the same path.
    pub shared_files: bool,
    /// Processing nodes, of all clusters.
    pub nodes: u16,
    /// Clusters whose bus and master run here.
    pub clusters: Vec<u16>,
    /// Whether the display runs here.
    pub display: bool,
}

/// How a process comes to life.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Launch {
    /// The manager starts it on its own machine.
    Local,
    /// The manager starts a command which starts it elsewhere and hands its standard input on; a template.
    Command(Vec<String>),
    /// Somebody else starts it; it joins.
    External,
}

impl Launch {
    pub const HOST: &str = "{host}";
    pub const PROGRAM: &str = "{program}";
}

impl Host {
    /// The machine of a topology that names none.
    pub(crate) fn here(nodes: u16) -> Self {
        Self {
            name: "localhost".to_owned(),
            bind: None,
            advertise: None,
            port: 0,
            launch: Launch::Local,
            programs: None,
            shared_files: false,
            nodes,
            clusters: Vec::new(),
            display: true,
        }
    }

    /// Where the manager listens, if this is its host.
    pub fn interface(&self) -> IpAddr {
        self.bind.unwrap_or(Ipv4Addr::LOCALHOST.into())
    }

    /// Whether it is another machine than the manager's, as far as can be told before its processes come.
    pub(super) fn is_elsewhere(&self) -> bool {
        match self.launch {
            Launch::Local => false,
            Launch::Command(_) => !self.bind.is_some_and(|bind| bind.is_loopback()),
            Launch::External => self.bind.is_some_and(|bind| !bind.is_loopback() && !bind.is_unspecified()),
        }
    }

    /// Whether a file that is written here under a path is the manager's file of that path.
    pub fn shares_files(&self) -> bool {
        let here = self.launch == Launch::Local || self.bind.is_some_and(|bind| bind.is_loopback());
        here || self.shared_files
    }

    /// What servers here are reached under, where the file tells.
    pub(super) fn advertised(&self) -> Option<String> {
        let bound = self.bind.filter(|bind| !bind.is_unspecified()).map(|bind| bind.to_string());
        let advertised = self.advertise.clone().or(bound);
        advertised.or_else(|| (self.launch == Launch::Local).then(|| self.interface().to_string()))
    }

    /// What it names at which others than this machine's processes can knock.
    pub(super) fn open_address(&self) -> Option<String> {
        let named = self.bind.map(|bind| bind.to_string()).into_iter().chain(self.advertise.clone());
        let mut open = named.filter(|address| !is_loopback(address));
        open.next().or_else(|| self.is_elsewhere().then(|| self.name.clone()))
    }

    /// The launcher's command with the host's name and the program's path in their places; `None` where there is none.
    pub fn command(&self, program: &str) -> Option<Vec<String>> {
        let Launch::Command(template) = &self.launch else { return None };
        let filled = |part: &String| part.replace(Launch::HOST, &self.name).replace(Launch::PROGRAM, program);
        Some(template.iter().map(filled).collect())
    }
}

/// Whether an IP address or a name is that of the machine that uses it.
pub fn is_loopback(address: &str) -> bool {
    address == "localhost" || address.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}
