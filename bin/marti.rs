//! All of marti: the commands that a person types, and the processes that they start.

use std::process::ExitCode;

use program::cli::{Arguments, entry};

fn main() -> ExitCode {
    entry::enter(|| entry::parse::<Arguments>().carry_out())
}
