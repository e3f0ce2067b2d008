//! `marti-master`: one cluster's job queue. `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use cluster::processes::master;
use cluster::protocol::hello::Role;
use ground::ids::ClusterId;
use program::cli::entry::{self, JoinArguments};

/// One cluster's job queue. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    entry::enter(|| Ok(entry::parse::<Arguments>().join.play("marti-master", Role::Master(ClusterId(0)), master::run)))
}
