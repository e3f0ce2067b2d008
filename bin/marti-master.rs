//! `marti-master`: one cluster's job queue. `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use marti::cli::program::{self, JoinArguments};
use marti::ids::ClusterId;
use marti::processes::master;
use marti::protocol::hello::Role;

/// One cluster's job queue. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    program::enter(|| Ok(Arguments::parse().join.play("marti-master", Role::Master(ClusterId(0)), master::run)))
}
