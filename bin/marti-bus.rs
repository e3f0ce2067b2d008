//! `marti bus` under a name of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    ground::role_program::become_role("bus")
}
