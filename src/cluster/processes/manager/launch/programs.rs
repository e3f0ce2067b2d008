//! What is started for a process: this very program with the role as its command, or a host's launcher.

use std::env::{self, consts};
use std::io;
use std::path::{Path, PathBuf};

use crate::processes::manager::process::ProcessId;
use crate::topology::host::Host;

/// A command, and the name under which it appears in lists of processes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Invocation {
    /// The program, and its arguments.
    pub(super) command: Vec<String>,
    /// Of the program itself; `None` for a launcher.
    pub(super) name: Option<&'static str>,
}

/// Where this program is.
#[derive(Clone, Debug)]
pub(in crate::processes::manager) struct Programs {
    this: PathBuf,
}

impl Programs {
    /// # Errors
    /// The system does not say where it is.
    pub(in crate::processes::manager) fn of_this_process() -> io::Result<Self> {
        Ok(Self { this: env::current_exe()? })
    }

    /// A launcher takes one path: that of the program of the role's own name, which is in the folder of `marti`.
    pub(super) fn invocation(&self, process: ProcessId, host: &Host) -> Invocation {
        let folder = host.programs.as_deref().map_or(self.this.parent().unwrap_or(Path::new("")), Path::new);
        let in_folder =
            |name: &str| folder.join(format!("{name}{}", consts::EXE_SUFFIX)).to_string_lossy().into_owned();
        if let Some(command) = host.command(&in_folder(process.program())) {
            return Invocation { command, name: None };
        }
        let marti = match host.programs {
            Some(_) => in_folder("marti"),
            None => self.this.to_string_lossy().into_owned(),
        };
        Invocation { command: vec![marti, process.role.kind().to_string()], name: Some(process.program()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::hello::Role;
    use crate::topology::host::Launch;
    use ground::ids::NodeId;

    #[test]
    fn this_program_plays_every_role_and_launchers_get_a_path() {
        let programs = Programs { this: "/opt/marti/marti-7".into() };
        let node = ProcessId::first(Role::Node(NodeId(3)));
        let command = |host: &Host| programs.invocation(node, host).command;
        let mut host = Host::here(1);
        assert_eq!(command(&host), ["/opt/marti/marti-7", "node"]);
        assert_eq!(programs.invocation(node, &host).name, Some("marti-node"));
        host.programs = Some("/usr/bin".to_owned());
        assert_eq!(command(&host), ["/usr/bin/marti", "node"]);
        host.launch = Launch::Command(["ssh", "{host}", "exec {program}"].map(str::to_owned).to_vec());
        assert_eq!(command(&host)[2], "exec /usr/bin/marti-node");
        assert_eq!(programs.invocation(node, &host).name, None);
    }
}
