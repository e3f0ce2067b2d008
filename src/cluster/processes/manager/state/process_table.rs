//! All processes that are not known to be dead, and which of them keep the manager waiting for too long.

use std::time::Duration;

use super::super::process::{Process, ProcessId, Stage};
use crate::topology::Deadlines;

/// From the end of a control connection to that of its process.
const EXIT_DEADLINE: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
pub(crate) struct ProcessTable {
    processes: Vec<Process>,
}

impl ProcessTable {
    pub(crate) fn insert(&mut self, process: Process) {
        self.processes.push(process);
    }

    pub(crate) fn remove(&mut self, id: ProcessId) -> Option<Process> {
        let place = self.processes.iter().position(|process| process.id == id)?;
        Some(self.processes.swap_remove(place))
    }

    pub(crate) fn get_mut(&mut self, id: ProcessId) -> Option<&mut Process> {
        self.processes.iter_mut().find(|process| process.id == id)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Process> {
        self.processes.iter()
    }

    pub(crate) fn nodes(&self) -> impl Iterator<Item = &Process> {
        self.processes.iter().filter(|process| process.id.node().is_some())
    }

    /// For processes that are connected and wait, deadlines begin now.
    pub(crate) fn excuse_connected(&mut self, now: Duration) {
        let waiting = self.processes.iter_mut().filter(|process| process.stage == Stage::Connected);
        waiting.for_each(|process| process.since = now);
    }

    /// Who has missed a deadline, and which; each as the rest of a sentence that begins with its name.
    pub(crate) fn overdue(&self, now: Duration, deadlines: &Deadlines) -> Vec<(ProcessId, String)> {
        let alive = self.processes.iter().filter(|process| process.killed.is_none());
        alive.filter_map(|process| Some((process.id, overdue(process, now, deadlines)?))).collect()
    }
}

fn overdue(process: &Process, now: Duration, deadlines: &Deadlines) -> Option<String> {
    let late = |since: Duration, deadline: Duration| now.saturating_sub(since) > deadline;
    let is_server = process.id.node().is_none();
    if let Some(hung_up) = process.hung_up {
        return late(hung_up, EXIT_DEADLINE).then(|| "closed its control connection and did not end".to_owned());
    }
    let connect = process.connect_deadline.unwrap_or(deadlines.startup);
    match process.stage {
        Stage::Spawned if late(process.since, connect) => {
            return Some(format!("did not connect within {}", seconds(connect)));
        }
        // A master waits for its bus, which may have to join.
        Stage::Connected if is_server && late(process.since, connect) => {
            return Some(format!("did not listen within {}", seconds(connect)));
        }
        // One that was handed a tile is the master's to judge.
        Stage::Serving if !is_server && late(process.since, deadlines.tile) => {
            return Some(format!("took no tile within {}", seconds(deadlines.tile)));
        }
        _ => {}
    }
    let silent = process.stage >= Stage::Connected && late(process.last_sign, deadlines.heartbeat);
    silent.then(|| format!("was silent for more than {}", seconds(deadlines.heartbeat)))
}

pub(crate) fn seconds(duration: Duration) -> String {
    format!("{} s", duration.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::processes::manager::fixture;
    use crate::protocol::hello::Role;
    use ground::ids::{ClusterId, NodeId};

    /// Deadlines: startup 10 s, heartbeat 5 s, tile 60 s.
    fn overdue_at(second: u64, role: Role, stage: Stage, last_sign: u64, hung_up: Option<u64>) -> Option<String> {
        let mut table = ProcessTable::default();
        table.insert(Process {
            stage,
            last_sign: Duration::from_secs(last_sign),
            hung_up: hung_up.map(Duration::from_secs),
            ..Process::spawned(ProcessId::first(role), Duration::ZERO)
        });
        table.overdue(Duration::from_secs(second), &fixture::run().deadlines).pop().map(|(_, why)| why)
    }

    #[test]
    fn each_deadline_is_kept() {
        let node = Role::Node(NodeId(1));
        assert_eq!(overdue_at(10, Role::Bus(ClusterId(0)), Stage::Spawned, 0, None), None);
        assert_eq!(
            overdue_at(11, Role::Bus(ClusterId(0)), Stage::Spawned, 0, None).as_deref(),
            Some("did not connect within 10 s")
        );
        assert_eq!(
            overdue_at(11, Role::Bus(ClusterId(0)), Stage::Connected, 11, None).as_deref(),
            Some("did not listen within 10 s")
        );
        assert_eq!(overdue_at(11, node, Stage::Connected, 11, None), None, "it waits for the servers");
        assert_eq!(overdue_at(61, node, Stage::Serving, 61, None).as_deref(), Some("took no tile within 60 s"));
        assert_eq!(overdue_at(61, Role::Bus(ClusterId(0)), Stage::Serving, 61, None), None);
        assert_eq!(overdue_at(99, node, Stage::Working, 94, None), None);
        let silent = overdue_at(99, node, Stage::Working, 93, None);
        assert_eq!(silent.as_deref(), Some("was silent for more than 5 s"));
        assert_eq!(overdue_at(99, node, Stage::Finished, 0, Some(98)), None);
        let stays = overdue_at(99, node, Stage::Finished, 0, Some(97));
        assert_eq!(stays.as_deref(), Some("closed its control connection and did not end"));
    }
}
