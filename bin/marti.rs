//! The manager of a run, and the only command that a person types.

use std::process::ExitCode;

use clap::Parser;
use marti::cli::Arguments;

fn main() -> ExitCode {
    match Arguments::parse().carry_out() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}
