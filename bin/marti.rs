//! The manager of a run, and the only command that a person types.

use std::process::ExitCode;

use clap::Parser;
use marti::cli::{Arguments, program};

fn main() -> ExitCode {
    program::enter(|| Arguments::parse().carry_out().map(|()| ExitCode::SUCCESS))
}
