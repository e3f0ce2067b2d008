//! Programs that are a role of `marti` under a name of their own: `marti-node` is `marti node`.

use std::io::ErrorKind;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use crate::outlet;

/// Becomes `marti ROLE` of this program's own folder, with this program's arguments. It returns where that fails only.
pub fn become_role(role: &str) -> ExitCode {
    let marti = match std::env::current_exe() {
        Ok(program) => program.with_file_name("marti"),
        Err(_) => PathBuf::from("marti"),
    };
    let mut command = Command::new(&marti);
    let error = command.arg0(format!("marti-{role}")).arg(role).args(std::env::args_os().skip(1)).exec();
    let expected = match error.kind() {
        ErrorKind::NotFound => "; the programs of marti belong in one folder",
        _ => "",
    };
    outlet::say(format_args!("error: {}: {error}{expected}", marti.display()));
    ExitCode::FAILURE
}
