//! `marti-display`: the frame buffer and the image files. `marti run` starts it, or it joins one.

use std::process::ExitCode;

use clap::Parser;
use marti::cli::program::{self, JoinArguments};
use marti::processes::display;
use marti::protocol::hello::Role;

/// The frame buffer and the image files. `marti run` starts it; by itself it joins a run.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    program::enter(|| Ok(Arguments::parse().join.play("marti-display", Role::Display, display::run)))
}
