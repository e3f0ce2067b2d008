//! The node process; `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use marti::cli::program::{self, JoinArguments};
use marti::ids::NodeId;
use marti::processes::node;
use marti::protocol::hello::Role;

/// A processing node. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    program::enter(|| Ok(Arguments::parse().join.play("marti-node", Role::Node(NodeId(0)), node::run)))
}
