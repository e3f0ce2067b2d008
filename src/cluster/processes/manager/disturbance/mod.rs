//! Faults on purpose, as `marti run --chaos` asks for them, behind the back of the state: it learns of them as of
//! any accident.
//!
//! A connection of which one end may be cut off leads through a relay in this process from its beginning.

mod relay;

use std::collections::{HashMap, HashSet};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use tokio::time::Instant;

use self::relay::Relay;
use super::control_port::ControlPort;
use super::event::Event;
use super::launch::children::Children;
use super::process::{Command, ProcessId};
use crate::chaos::{Deed, Fault, LongestWait, Planner, ProcessSlot, Progress};
use crate::protocol::control::{MasterCommand, NodeCommand};
use crate::protocol::hello::Role;
use crate::report::Chaos;

pub(super) struct Disturbance {
    /// All faults, as a schedule.
    schedule: String,
    planner: Planner,
    carried_out: u64,
    wait: LongestWait,
    /// Who will be cut off at some time.
    fragile: HashSet<ProcessSlot>,
    /// Who is cut off, until then.
    cut: HashMap<ProcessSlot, Instant>,
    /// Where relays listen.
    interface: IpAddr,
    /// By who dials and whom.
    relays: HashMap<(Role, Role), Link>,
    /// Who is connected.
    processes: HashMap<ProcessSlot, Reachable>,
    /// Of relays that could not be started.
    troubles: Vec<String>,
}

struct Link {
    upstream: SocketAddr,
    relay: Relay,
}

struct Reachable {
    id: ProcessId,
    /// Of a node: it has what it works by.
    is_configured: bool,
}

impl Disturbance {
    /// None when there are no faults.
    pub(super) fn new(faults: Vec<Fault>, interface: IpAddr) -> Self {
        let cut = faults.iter().filter(|fault| matches!(fault.deed, Deed::Cut(_)));
        let texts: Vec<_> = faults.iter().map(ToString::to_string).collect();
        Self {
            schedule: texts.join("; "),
            fragile: cut.map(|fault| fault.on).collect(),
            planner: Planner::new(faults),
            carried_out: 0,
            wait: LongestWait::default(),
            cut: HashMap::new(),
            interface,
            relays: HashMap::new(),
            processes: HashMap::new(),
            troubles: Vec::new(),
        }
    }

    /// Every event, before it is handled.
    pub(super) fn observe(&mut self, event: &Event) {
        match event {
            Event::Connected(id) => {
                let reachable = Reachable { id: *id, is_configured: false };
                self.processes.extend(slot(id.role).map(|slot| (slot, reachable)));
            }
            Event::Exited(id, _) => self.processes.retain(|_, process| process.id != *id),
            _ => {}
        }
    }

    /// The address at which `dialler` is to find `server`.
    pub(super) fn route(&mut self, dialler: Role, server: Role, address: SocketAddr) -> SocketAddr {
        let ends = [slot(dialler), slot(server)];
        if !ends.iter().flatten().any(|slot| self.fragile.contains(slot)) {
            return address;
        }
        if let Some(link) = self.relays.get(&(dialler, server)).filter(|link| link.upstream == address) {
            return link.relay.address();
        }
        match Relay::start(self.interface, address) {
            Ok(relay) => {
                let cuts = ends.iter().flatten().filter_map(|slot| self.cut.get(slot));
                cuts.for_each(|until| relay.cut(*until));
                let through = relay.address();
                self.relays.insert((dialler, server), Link { upstream: address, relay });
                through
            }
            Err(error) => {
                self.troubles.push(format!("nothing between {dialler} and {server} can be cut: {error}"));
                address
            }
        }
    }

    /// [`Self::route`], for all addresses of a command.
    pub(super) fn reroute(&mut self, id: ProcessId, command: &mut Command) {
        let mut route = |server, address: &mut SocketAddr| *address = self.route(id.role, server, *address);
        match command {
            Command::Master(MasterCommand::Configure(configuration)) => {
                let Role::Master(cluster) = id.role else { return };
                route(Role::Bus(cluster), &mut configuration.bus);
            }
            Command::Node(NodeCommand::Display(display)) => route(Role::Display, display),
            Command::Node(NodeCommand::Configure(configuration)) => {
                route(Role::Master(configuration.cluster), &mut configuration.master);
                route(Role::Bus(configuration.cluster), &mut configuration.bus);
                route(Role::Display, &mut configuration.display);
                let process = slot(id.role).and_then(|slot| self.processes.get_mut(&slot));
                process.into_iter().for_each(|process| process.is_configured = true);
            }
            _ => {}
        }
    }

    /// Does what is due; returns what was done.
    pub(super) fn carry_out(
        &mut self,
        now: Duration,
        progress: Progress,
        children: &mut Children,
        port: &ControlPort,
    ) -> Vec<String> {
        self.wait.note(now, progress);
        let mut told = std::mem::take(&mut self.troubles);
        while let Some(fault) = self.due(progress, children) {
            let Some(id) = self.processes.get(&fault.on).map(|process| process.id) else { break };
            match self.inflict(fault, id, children, port) {
                Ok(what) => {
                    self.wait.disturbed(now);
                    self.carried_out += 1;
                    told.push(format!("{id} {what}"));
                }
                Err(why) => told.push(format!("`{fault}` is not possible: {why}")),
            }
        }
        told
    }

    fn due(&mut self, progress: Progress, children: &Children) -> Option<Fault> {
        let processes = &self.processes;
        self.planner.due(progress, |fault| {
            processes.get(&fault.on).is_some_and(|process| {
                children.is_alive(process.id) && (fault.deed != Deed::Corrupt || process.is_configured)
            })
        })
    }

    /// What happened to the process, as the rest of a sentence that begins with its name; or why nothing did.
    fn inflict(
        &mut self,
        fault: Fault,
        id: ProcessId,
        children: &mut Children,
        port: &ControlPort,
    ) -> Result<String, String> {
        match fault.deed {
            Deed::Kill => {
                children.kill(id);
                Ok("is killed".to_owned())
            }
            Deed::Stop(time) => {
                children.stop(id, time.duration())?;
                Ok(format!("is stopped for {time}"))
            }
            Deed::Cut(time) => {
                let ends = |(dialler, server): &(Role, Role)| [slot(*dialler), slot(*server)].contains(&Some(fault.on));
                let links: Vec<_> = self.relays.iter().filter(|(key, _)| ends(key)).collect();
                if links.is_empty() {
                    return Err("none of its connections can be cut".to_owned());
                }
                let until = Instant::now() + time.duration();
                links.iter().for_each(|(_, link)| link.relay.cut(until));
                let latest = self.cut.entry(fault.on).or_insert(until);
                *latest = until.max(*latest);
                Ok(format!("is cut off for {time}"))
            }
            Deed::Corrupt => {
                let told = port.tell(id, Command::Node(NodeCommand::Corrupt));
                told.then(|| "is corrupted".to_owned()).ok_or_else(|| "it cannot be told".to_owned())
            }
        }
    }

    /// For the report; with the faults that did not come to pass. `None` when none were asked for.
    pub(super) fn close(self) -> Option<(Chaos, Vec<String>)> {
        let missed = self.planner.waiting().iter().map(|fault| format!("`{fault}` did not come to pass")).collect();
        let chaos = Chaos {
            schedule: self.schedule,
            carried_out: self.carried_out,
            longest_wait_seconds: self.wait.longest().as_secs_f64(),
        };
        (!chaos.schedule.is_empty()).then_some((chaos, missed))
    }
}

/// `None` is the manager, where faults come from.
fn slot(role: Role) -> Option<ProcessSlot> {
    match role {
        Role::Manager => None,
        Role::Bus(cluster) => Some(ProcessSlot::Bus(cluster)),
        Role::Master(cluster) => Some(ProcessSlot::Master(cluster)),
        Role::Node(node) => Some(ProcessSlot::Node(node)),
        Role::Display => Some(ProcessSlot::Display),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chaos::{Cast, FaultSchedule};
    use ground::ids::{ClusterId, Epoch, NodeId};

    const NODE: Role = Role::Node(NodeId(0));
    const OTHER: Role = Role::Node(NodeId(1));
    const BUS: Role = Role::Bus(ClusterId(0));
    const MASTER: Role = Role::Master(ClusterId(0));

    fn disturbance(text: &str) -> Disturbance {
        let schedule: FaultSchedule = text.parse().expect("a schedule");
        let faults = schedule.faults(Cast { clusters: 1, nodes: 2 }).expect("of this cast");
        Disturbance::new(faults, [127, 0, 0, 1].into())
    }

    #[tokio::test]
    async fn only_what_will_be_cut_goes_through_relays() {
        let mut disturbance = disturbance("cut node 0@10% for 1s; kill bus@20%; kill node 1@20%");
        let (first, second) = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
        assert_eq!(disturbance.route(OTHER, BUS, first), first);
        assert_eq!(disturbance.route(Role::Manager, BUS, first), first);
        let relay = disturbance.route(NODE, BUS, first);
        assert_ne!(relay, first);
        assert_eq!(disturbance.route(NODE, BUS, first), relay, "its successor finds the same");
        assert_ne!(disturbance.route(NODE, MASTER, first), relay);
        assert_ne!(disturbance.route(NODE, BUS, second), relay, "a bus that was replaced");
        assert_eq!(disturbance.relays.len(), 2);
    }

    #[tokio::test]
    async fn a_server_that_will_be_cut_has_relays_in_both_directions() {
        let mut disturbance = disturbance("cut master 0@10% for 1s");
        let address = ([127, 0, 0, 1], 1).into();
        for (dialler, server) in [(NODE, MASTER), (MASTER, BUS), (MASTER, Role::Manager)] {
            assert_ne!(disturbance.route(dialler, server, address), address);
        }
        for (dialler, server) in [(NODE, BUS), (BUS, Role::Manager), (NODE, Role::Display)] {
            assert_eq!(disturbance.route(dialler, server, address), address);
        }
    }

    #[test]
    fn a_place_is_held_until_its_holder_is_dead() {
        let mut disturbance = disturbance("kill node 0@10%");
        let [first, second] = [0, 1].map(|epoch| ProcessId { role: NODE, epoch: Epoch(epoch) });
        disturbance.observe(&Event::Connected(first));
        disturbance.observe(&Event::Connected(second));
        disturbance.observe(&Event::Exited(first, "ended by itself".to_owned()));
        assert_eq!(disturbance.processes[&ProcessSlot::Node(NodeId(0))].id, second);
        disturbance.observe(&Event::Exited(second, "ended by itself".to_owned()));
        assert!(disturbance.processes.is_empty());
    }

    #[test]
    fn without_faults_there_is_nothing_to_tell() {
        assert!(Disturbance::new(Vec::new(), [127, 0, 0, 1].into()).close().is_none());
        let (chaos, missed) = disturbance("kill node@10%").close().expect("one fault");
        assert_eq!(missed, [format!("`{}` did not come to pass", chaos.schedule)]);
    }
}
