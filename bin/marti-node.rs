//! The node process; `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use cluster::processes::node;
use cluster::protocol::hello::Role;
use ground::ids::NodeId;
use program::cli::entry::{self, JoinArguments};

/// A processing node. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    entry::enter(|| Ok(entry::parse::<Arguments>().join.play("marti-node", Role::Node(NodeId(0)), node::run)))
}
