//! All of marti: the commands that a person types, and the processes that they start.

use std::process::ExitCode;

use program::cli::{Arguments, entry};

const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (commit ", env!("MARTI_COMMIT"), ")");

fn main() -> ExitCode {
    entry::enter(|| entry::parse::<Arguments>(VERSION).carry_out())
}
