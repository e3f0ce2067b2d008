//! The processes themselves, on whichever host: started with what they must know, killed, confirmed dead.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use super::lifecycle::{self, Link, Log, Monitor, Order};
use super::programs::Programs;
use super::slots::JoinSlots;
use crate::keys::Identity;
use crate::processes::control_link::{ORPHAN_GRACE, patience};
use crate::processes::manager::control_port::Connections;
use crate::processes::manager::event::Event;
use crate::processes::manager::plan::host_of;
use crate::processes::manager::process::ProcessId;
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::{Role, RunToken};
use crate::topology::{Launch, Placement};

/// Signs of life within a heartbeat's deadline.
pub(in crate::processes::manager) const HEARTBEATS: u32 = 4;
/// Orders that a process was not given yet.
const ORDERS_MAX: usize = 8;
/// On top of what a process that cannot be seen any more has left to live by its own clock.
const CONFIRM_MARGIN: Duration = Duration::from_secs(1);

/// Starts and kills; each process has a task of its own that waits for its end and reports it.
pub(in crate::processes::manager) struct Children {
    pub(in crate::processes::manager) programs: Programs,
    pub(in crate::processes::manager) placement: Placement,
    /// The folder of their logs, which moves once.
    pub(in crate::processes::manager) logs: watch::Sender<PathBuf>,
    pub(in crate::processes::manager) token: RunToken,
    /// Of the roles that are started from here; empty: plain TCP.
    pub(in crate::processes::manager) identities: Vec<Identity>,
    /// Where processes of other machines reach the manager.
    pub(in crate::processes::manager) advertised: SocketAddr,
    /// Between two signs of life.
    pub(in crate::processes::manager) heartbeat: Duration,
    pub(in crate::processes::manager) slots: JoinSlots,
    pub(in crate::processes::manager) connections: Connections,
    pub(in crate::processes::manager) events: mpsc::Sender<Event>,
    pub(in crate::processes::manager) alive: HashMap<ProcessId, Handle>,
}

pub(in crate::processes::manager) struct Handle {
    /// Dropping it kills, too.
    orders: Option<mpsc::Sender<Order>>,
    link: watch::Sender<Link>,
}

impl Children {
    /// `manager` is where it finds us, if this host is its own.
    pub(in crate::processes::manager) fn spawn(&mut self, id: ProcessId, manager: SocketAddr) {
        let host = host_of(&self.placement, id.role);
        let log = Log { folder: self.logs.subscribe(), name: format!("{}.log", id.log_stem()) };
        let is_local = host.launch == Launch::Local;
        let bootstrap = Bootstrap {
            role: id.role,
            epoch: id.epoch,
            token: self.token_for(id),
            manager: if is_local { manager } else { self.advertised },
            identity: self.identities.iter().find(|identity| identity.kind == id.role.kind()).cloned(),
            bind: host.bind,
            advertise: host.advertise.clone(),
            // Its standard error is its log.
            log: None,
            heartbeat_milliseconds: u64::try_from(self.heartbeat.as_millis()).unwrap_or(u64::MAX),
        };
        let (monitor, handle) = self.monitor(id);
        self.alive.insert(id, handle);
        let events = self.events.clone();
        if host.launch == Launch::External {
            // It has come by keys of its own.
            self.slots.offer(id, &host.name, Bootstrap { identity: None, ..bootstrap });
            // An error means that the manager has ended, here and below.
            tokio::spawn(
                async move { drop(events.send(Event::Exited(id, lifecycle::watch_joined(monitor).await)).await) },
            );
            return;
        }
        let invocation = self.programs.invocation(id, host);
        tokio::spawn(async move {
            let how = match lifecycle::start(&invocation, &bootstrap, &log).await {
                Ok(child) if is_local => {
                    let mut monitor = monitor;
                    lifecycle::watch(child, &mut monitor, &log).await
                }
                Ok(child) => lifecycle::watch_elsewhere(child, monitor, &log).await,
                Err(error) => format!("could not be started by {}: {error}", invocation.command.join(" ")),
            };
            let _ = events.send(Event::Exited(id, how)).await;
        });
    }

    /// A server checks its peers' tokens, and needs the run's token for that. No process dials a node: it gets its own token
    /// only.
    fn token_for(&self, ProcessId { role, epoch }: ProcessId) -> RunToken {
        match role {
            Role::Node(_) => self.token.of(role, epoch),
            _ => self.token,
        }
    }

    fn monitor(&self, id: ProcessId) -> (Monitor, Handle) {
        let (given, orders) = mpsc::channel(ORDERS_MAX);
        let (told, link) = watch::channel(Link::Awaited);
        let (connections, slots) = (self.connections.clone(), self.slots.clone());
        let hang_up = Box::new(move || {
            connections.hang_up(id);
            slots.withdraw(id);
        });
        let patience = patience(self.heartbeat) + ORPHAN_GRACE + CONFIRM_MARGIN;
        (Monitor { orders, link, hang_up, patience }, Handle { orders: Some(given), link: told })
    }

    /// The process has dialled.
    pub(in crate::processes::manager) fn connected(&self, id: ProcessId) {
        self.slots.withdraw(id);
        self.tell(id, Link::Open);
    }

    /// Its control connection has ended.
    pub(in crate::processes::manager) fn disconnected(&self, id: ProcessId) {
        self.tell(id, Link::Closed);
    }

    fn tell(&self, id: ProcessId, link: Link) {
        if let Some(handle) = self.alive.get(&id) {
            handle.link.send_replace(link);
        }
    }

    /// By SIGKILL or, on another machine, by cutting it off; its death is reported as any other.
    pub(in crate::processes::manager) fn kill(&mut self, id: ProcessId) {
        if let Some(handle) = self.alive.get_mut(&id) {
            handle.orders = None;
        }
    }

    /// [`Self::kill`] for a reason that the state does not know of, as the rest of a sentence that begins with its name.
    pub(in crate::processes::manager) fn kill_because(&mut self, id: ProcessId, why: String) {
        if let Some(orders) = self.alive.get_mut(&id).and_then(|handle| handle.orders.take()) {
            // An error means that it has just ended, or dies without the reason.
            let _ = orders.try_send(Order::Die(why));
        }
    }

    /// Whether it was started and not killed; it may have ended by itself.
    pub(in crate::processes::manager) fn is_alive(&self, id: ProcessId) -> bool {
        self.alive.get(&id).is_some_and(|handle| handle.orders.is_some())
    }

    /// Whether the manager started it itself: signals reach it, and relays are within its reach.
    pub(in crate::processes::manager) fn is_local(&self, id: ProcessId) -> bool {
        host_of(&self.placement, id.role).launch == Launch::Local
    }

    /// By SIGSTOP; it goes on after so long.
    ///
    /// # Errors
    /// Why not: the process is not one of this host's, or has ended.
    pub(in crate::processes::manager) fn stop(&self, id: ProcessId, time: Duration) -> Result<(), String> {
        let orders = self.alive.get(&id).and_then(|handle| handle.orders.as_ref());
        let orders = orders.filter(|_| self.is_local(id)).ok_or("it is no process of this host")?;
        orders.try_send(Order::Stop(time)).map_err(|_| "it has ended, or stops already".to_owned())
    }

    /// Its death is reported.
    pub(in crate::processes::manager) fn reap(&mut self, id: ProcessId) {
        self.alive.remove(&id);
    }
}
