//! `marti-display`: the frame buffer and the image files. `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use cluster::processes::display;
use cluster::protocol::hello::Role;
use program::cli::entry::{self, JoinArguments};

/// The frame buffer and the image files. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    entry::enter(|| Ok(entry::parse::<Arguments>().join.play("marti-display", Role::Display, display::run)))
}
