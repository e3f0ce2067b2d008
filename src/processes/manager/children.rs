//! The processes themselves, on whichever host: started with what they must know, killed, confirmed dead.

use std::collections::HashMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot, watch};

use super::control_port::Connections;
use super::executables::Executables;
use super::life::{self, Fate, Link};
use super::places::Places;
use super::plan::host_of;
use super::process::ProcessId;
use super::state::Event;
use crate::keys::Identity;
use crate::processes::control_link::{ORPHAN_GRACE, patience};
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::RunToken;
use crate::topology::{Launch, Placement};

/// Signs of life within a heartbeat's deadline.
pub(super) const HEARTBEATS: u32 = 4;
/// On top of what a process that cannot be seen any more has left to live by its own clock.
const CONFIRM_MARGIN: Duration = Duration::from_secs(1);

/// Starts and kills; each process has a task of its own that waits for its end and tells it.
pub(super) struct Children {
    pub(super) executables: Executables,
    pub(super) placement: Placement,
    pub(super) logs: PathBuf,
    pub(super) token: RunToken,
    /// Of the roles that are started from here; empty: plain TCP.
    pub(super) identities: Vec<Identity>,
    /// Where processes of this machine reach the manager, and where others do.
    pub(super) manager: SocketAddr,
    pub(super) advertised: SocketAddr,
    /// Between two signs of life.
    pub(super) heartbeat: Duration,
    pub(super) places: Places,
    pub(super) connections: Connections,
    pub(super) events: mpsc::Sender<Event>,
    pub(super) alive: HashMap<ProcessId, Life>,
}

pub(super) struct Life {
    /// Dropping it kills, too.
    kill: Option<oneshot::Sender<String>>,
    link: watch::Sender<Link>,
}

impl Children {
    pub(super) fn spawn(&mut self, id: ProcessId) {
        let host = host_of(&self.placement, id.role);
        let log = self.logs.join(format!("{}.log", id.log_stem()));
        let is_local = host.launch == Launch::Local;
        let bootstrap = Bootstrap {
            role: id.role,
            epoch: id.epoch,
            token: self.token,
            manager: if is_local { self.manager } else { self.advertised },
            identity: self.identities.iter().find(|identity| identity.kind == id.role.kind()).cloned(),
            bind: host.bind,
            advertise: host.advertise.clone(),
            log: is_local.then(|| log.clone()),
            heartbeat_milliseconds: u64::try_from(self.heartbeat.as_millis()).unwrap_or(u64::MAX),
        };
        let (fate, life) = self.fate(id);
        self.alive.insert(id, life);
        let events = self.events.clone();
        if host.launch == Launch::External {
            // It has come by keys of its own.
            self.places.offer(id, &host.name, Bootstrap { identity: None, ..bootstrap });
            // An error means that the manager has ended, here and below.
            tokio::spawn(async move { drop(events.send(Event::Exited(id, life::watch_joined(fate).await)).await) });
            return;
        }
        let program = self.executables.path(id, host.programs.as_deref());
        let command = host.command(&program).unwrap_or_else(|| vec![program]);
        tokio::spawn(async move {
            let how = match life::start(&command, &bootstrap, &log).await {
                Ok(child) if is_local => {
                    let mut fate = fate;
                    life::watch(child, &mut fate, &log).await
                }
                Ok(child) => life::watch_elsewhere(child, fate, &log).await,
                Err(error) => format!("could not be started by {}: {error}", command.join(" ")),
            };
            let _ = events.send(Event::Exited(id, how)).await;
        });
    }

    fn fate(&self, id: ProcessId) -> (Fate, Life) {
        let (kill, killed) = oneshot::channel();
        let (told, link) = watch::channel(Link::Awaited);
        let (connections, places) = (self.connections.clone(), self.places.clone());
        let hang_up = Box::new(move || {
            connections.hang_up(id);
            places.withdraw(id);
        });
        let patience = patience(self.heartbeat) + ORPHAN_GRACE + CONFIRM_MARGIN;
        (Fate { killed, link, hang_up, patience }, Life { kill: Some(kill), link: told })
    }

    /// The process has dialled.
    pub(super) fn connected(&self, id: ProcessId) {
        self.places.withdraw(id);
        self.tell(id, Link::Open);
    }

    /// Its control connection has ended.
    pub(super) fn disconnected(&self, id: ProcessId) {
        self.tell(id, Link::Closed);
    }

    fn tell(&self, id: ProcessId, link: Link) {
        if let Some(life) = self.alive.get(&id) {
            life.link.send_replace(link);
        }
    }

    /// By SIGKILL or, on another machine, by cutting it off; its death is told as any other.
    pub(super) fn kill(&mut self, id: ProcessId) {
        if let Some(life) = self.alive.get_mut(&id) {
            life.kill = None;
        }
    }

    /// [`Self::kill`] for a reason that the state does not know of, as the rest of a sentence that begins with its name.
    pub(super) fn kill_because(&mut self, id: ProcessId, why: String) {
        if let Some(kill) = self.alive.get_mut(&id).and_then(|life| life.kill.take()) {
            // An error means that it has just ended.
            let _ = kill.send(why);
        }
    }

    /// Its death is told.
    pub(super) fn bury(&mut self, id: ProcessId) {
        self.alive.remove(&id);
    }
}
