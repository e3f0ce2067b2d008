//! The manager of a run, and the only command that a person types.

use std::process::ExitCode;

use clap::Parser;
use program::cli::{Arguments, entry};

fn main() -> ExitCode {
    entry::enter(|| Arguments::parse().carry_out().map(|()| ExitCode::SUCCESS))
}
