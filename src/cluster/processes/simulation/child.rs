//! What all processes have that the manager starts: a control connection, signs of life, an end.

use std::time::Duration;

use super::network::{Actor, MANAGER, Message, Network, Timer, Wire};
use crate::processes::manager::process::{ProcessId, Report};

/// From spawning a process until it dials the manager.
const START: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(60)];
/// For the manager, and for other servers, to answer the hello.
pub(super) const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// For the manager to hang up after the last report.
const HANG_UP_DEADLINE: Duration = Duration::from_secs(1);

pub(super) const EXIT_OK: &str = "ended by itself";
pub(super) const EXIT_ERROR: &str = "ended with exit code 1";

#[derive(Debug)]
pub(super) struct Child {
    pub(super) me: Actor,
    pub(super) id: ProcessId,
    heartbeat: Report,
    period: Duration,
    control: Option<Wire>,
    connected: bool,
    /// All is said; how it will end.
    closing: Option<&'static str>,
}

impl Child {
    pub(super) fn spawn(network: &mut Network, id: ProcessId, heartbeat: Report, period: Duration) -> Self {
        let me = network.add();
        let [least, most] = START;
        let after = network.dice.between(least, most);
        network.wake(me, after, Timer::Start);
        Self { me, id, heartbeat, period, control: None, connected: false, closing: None }
    }

    pub(super) fn is_control(&self, wire: Wire) -> bool {
        self.control == Some(wire)
    }

    pub(super) fn is_closing(&self) -> bool {
        self.closing.is_some()
    }

    pub(super) fn report(&self, network: &mut Network, report: Report) {
        if let Some(control) = self.control {
            network.send(self.me, control, Message::Report(report));
        }
    }

    /// Ends as a process does that has nothing more to say: it waits for the manager to hang up.
    pub(super) fn close(&mut self, network: &mut Network, how: &'static str) {
        if self.closing.is_none() {
            self.closing = Some(how);
            if let Some(control) = self.control {
                network.finish(self.me, control);
            }
            network.wake(self.me, HANG_UP_DEADLINE, Timer::HangUp);
        }
    }

    /// Whether it was a timer of what is here; others are the process's own.
    pub(super) fn timer(&mut self, network: &mut Network, timer: Timer) -> bool {
        match timer {
            Timer::Start => {
                self.control = Some(network.dial(self.me, self.id, Network::address(MANAGER), CONNECT_DEADLINE));
            }
            Timer::Heartbeat if self.closing.is_none() => {
                self.report(network, self.heartbeat.clone());
                network.wake(self.me, self.period, Timer::Heartbeat);
            }
            Timer::HangUp => network.exit(self.me, self.closing.unwrap_or(EXIT_ERROR)),
            Timer::Dialled(wire) if self.is_control(wire) && !self.connected => network.exit(self.me, EXIT_ERROR),
            Timer::Heartbeat => {}
            Timer::Dialled(_) if self.closing.is_some() => {}
            _ => return false,
        }
        true
    }

    /// The manager's answer to the hello.
    pub(super) fn welcomed(&mut self, network: &mut Network) {
        self.connected = true;
        self.timer(network, Timer::Heartbeat);
    }

    /// The manager has hung up.
    pub(super) fn orphaned(&self, network: &mut Network) {
        network.exit(self.me, self.closing.unwrap_or(EXIT_ERROR));
    }
}
