//! The processes of a run as commands: `marti run` starts them, or they join one. `bin/marti-bus` and its like begin them under their own names.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::Failure;
use super::entry::{self, JoinArguments};
use cluster::processes::{bus, display, master, node};
use cluster::protocol::hello::Role;
use cluster::topology::value::Threads;
use ground::ids::{ClusterId, NodeId};

/// Processing node: traces tiles. It is started by `marti run`, or joins a run
#[derive(Debug, Args)]
pub struct NodeArguments {
    /// Trace with so many threads, where this node has the whole database [default: cluster.threads of the topology]
    #[arg(long, value_name = "N", env = "MARTI_THREADS", help_heading = "Joining a run")]
    threads: Option<Threads>,
    #[command(flatten)]
    join: JoinArguments,
}

impl NodeArguments {
    pub(super) fn play(&self) -> ExitCode {
        // A process that `marti run` starts inherits the environment; its threads are those of the topology.
        let threads = self.threads.filter(|_| self.join.joins()).map(|threads| threads.0);
        self.join.play("marti-node", Role::Node(NodeId(0)), |child| node::run(child, threads))
    }
}

/// Job queue of one cluster. It is started by `marti run`, or joins a run
#[derive(Debug, Args)]
pub struct MasterArguments {
    #[command(flatten)]
    join: JoinArguments,
}

impl MasterArguments {
    pub(super) fn play(&self) -> ExitCode {
        self.join.play("marti-master", Role::Master(ClusterId(0)), master::run)
    }
}

/// Frame buffer and image files. It is started by `marti run`, or joins a run
#[derive(Debug, Args)]
pub struct DisplayArguments {
    #[command(flatten)]
    join: JoinArguments,
}

impl DisplayArguments {
    pub(super) fn play(&self) -> ExitCode {
        self.join.play("marti-display", Role::Display, display::run)
    }
}

/// Cluster memory and bus of one cluster. It is started by `marti run`, joins a run, or serves the memory of a recording
#[derive(Debug, Args)]
pub struct BusArguments {
    /// Serve a memory with the layout and arbiter of this recording; ends when its loader leaves
    #[arg(long, value_name = "DIR", conflicts_with = "join")]
    recording: Option<PathBuf>,
    /// Address to listen at, of this host alone; the one it got is printed
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", requires = "recording")]
    bind: SocketAddr,
    /// Folder for this bus' own recording, its log, and bus.token, the file with its secret
    #[arg(long, short, value_name = "DIR", default_value = "out/bus", requires = "recording")]
    out: PathBuf,
    #[command(flatten)]
    join: JoinArguments,
}

impl BusArguments {
    pub(super) fn play(&self) -> Result<ExitCode, Failure> {
        const PROGRAM: &str = "marti-bus";
        let Self { recording, bind, out, join } = self;
        let Some(recording) = recording.clone() else {
            return Ok(join.play(PROGRAM, Role::Bus(ClusterId(0)), bus::run));
        };
        entry::name_process(PROGRAM);
        let served = bus::serve_alone(&bus::Alone { recording, bind: *bind, out: out.clone() });
        served.map(|_| ExitCode::SUCCESS).map_err(|error| Failure::failed(error.to_string()))
    }
}
