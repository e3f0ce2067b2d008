//! The bounds of every queue, looked at after every event.

use super::roles::Process;
use super::schedule::Schedule;
use crate::processes::driver::UNREAD_MAX;
use crate::processes::manager::simulated::Queues;
use crate::protocol::work::{jobs_per_node, tiles_per_node};

/// Incidents that the manager keeps, as its log says.
const INCIDENTS_MAX: usize = 1000;
/// Results of one tile that are compared, as the verification says.
const RESULTS_MAX: usize = 256;
/// Messages to a server that is waited for: what an honest process owes it at most.
const OWED_MAX: usize = 1000;

/// Processes of an earlier run whose tiles are in the frame: each has one at least.
const FRAME_BEFORE_MAX: usize = 200;

type Size = (&'static str, usize, usize);

/// The first of the manager's queues that is too long.
pub(super) fn of_manager(queues: &Queues, schedule: &Schedule) -> Option<String> {
    let (clusters, nodes) = (usize::from(schedule.scenario.clusters), usize::from(schedule.scenario.nodes));
    let (tiles, a_node) = (schedule.tiles() as usize, tiles_per_node(1) as usize);
    let processes = 1 + clusters * (2 + nodes);
    let sizes = [
        ("attempts with masters", queues.out, a_node * clusters * nodes),
        ("tiles wanted", queues.wanted as usize, a_node * clusters * nodes),
        ("attempts with one master, and tiles that it wants", queues.of_cluster as usize, a_node * nodes),
        // Of a tile that is done again one more, if a display compared it meanwhile.
        ("checks that wait", queues.checks, 2 * tiles),
        ("tiles to be compared", queues.compared.0, tiles),
        ("results of one tile", queues.compared.1, RESULTS_MAX),
        ("processes", queues.processes, processes),
        ("incidents", queues.incidents, INCIDENTS_MAX),
    ];
    excess(&sizes).map(|excess| format!("the manager has {excess}"))
}

/// The first queue of an honest process that is too long, of so many processes started so far.
pub(super) fn of_process(process: &Process, schedule: &Schedule, started: usize) -> Option<String> {
    let nodes = usize::from(schedule.scenario.nodes);
    let [to_clients, to_servers] = process.unread_most();
    let messages = [("messages to a client", to_clients, UNREAD_MAX), ("messages to a server", to_servers, OWED_MAX)];
    let own = match process {
        Process::Master(master) => {
            let [waiting, lost, peers] = master.machine.sizes();
            vec![
                ("tiles", master.machine.tiles(), tiles_per_node(1) as usize * nodes),
                ("requests that wait", waiting, jobs_per_node(1) * nodes),
                ("lost attempts", lost, jobs_per_node(1) * started),
                ("connections", peers, started),
            ]
        }
        Process::Display(display) => {
            let [peers, producers, condemned] = display.machine.sizes();
            vec![
                ("connections", peers, 2 * started),
                // Those of an earlier run included.
                ("processes in the frame", producers, started + FRAME_BEFORE_MAX),
                ("condemned processes", condemned, 2 * started + FRAME_BEFORE_MAX),
            ]
        }
        Process::Node(node) => vec![("tiles", node.machine.tiles(), jobs_per_node(1))],
        Process::Bus(bus) => vec![("clients", bus.worker.clients(), nodes + 2)],
    };
    excess(&messages).or_else(|| excess(&own)).map(|excess| format!("{} has {excess}", process.child().id))
}

fn excess(sizes: &[Size]) -> Option<String> {
    let (what, size, most) = sizes.iter().find(|(_, size, most)| size > most)?;
    Some(format!("{size} {what}, of {most} at most"))
}
