//! The bus process; `marti run` starts it, or it joins one. With `--recording` it serves the image of a recording.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use cluster::processes::bus;
use cluster::protocol::hello::Role;
use ground::ids::ClusterId;
use program::cli::Failure;
use program::cli::entry::{self, JoinArguments};

/// The bus of a cluster. `marti run` starts it; by itself it joins a run, or serves a recording.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Serve a memory with the layout and arbiter of this recording; ends when its loader leaves
    #[arg(long, value_name = "DIR", conflicts_with = "join")]
    recording: Option<PathBuf>,
    /// Address to listen at, of this host alone; the one it got is printed
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", requires = "recording")]
    bind: SocketAddr,
    /// Folder for this bus' own recording, its log, and bus.token, the file with its secret
    #[arg(long, value_name = "DIR", default_value = "out/bus", requires = "recording")]
    out: PathBuf,
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    entry::enter(|| {
        let Arguments { recording, bind, out, join } = entry::parse::<Arguments>();
        let Some(recording) = recording else { return Ok(join.play("marti-bus", Role::Bus(ClusterId(0)), bus::run)) };
        let served = bus::serve_alone(&bus::Alone { recording, bind, out });
        served.map(|_| ExitCode::SUCCESS).map_err(|error| Failure::failed(error.to_string()))
    })
}
