//! The bus process; `marti run` starts it.

use std::process::ExitCode;

fn main() -> ExitCode {
    match marti::processes::bus::run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
