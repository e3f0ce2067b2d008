//! Turns what happens into events for the state, and does what it answers.

use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal::SIGHUP;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, watch};
use tokio::time::sleep_until;

use super::RunError;
use super::cause::Interrupt;
use super::control_port::ControlPort;
use super::disturbance::Disturbance;
use super::event::{Action, Event};
use super::folder::output_folder::OutputFolder;
use super::launch::children::{Children, HEARTBEATS};
use super::launch::programs::Programs;
use super::metrics;
use super::plan::Plan;
use super::process::ProcessId;
use super::reach;
use super::state::State;
use crate::chaos::{self, Fault};
use crate::keys::Identity;
use crate::processes::health;
use crate::processes::loader::Loader;
use crate::protocol::connection::Credentials;
use crate::protocol::hello::Role;
use crate::report::Chaos;
use ground::ids::ClusterId;
use ground::interruption::is_ignored;
use ground::progress::{Progress, Status};
use ground::telemetry;

/// Reports that were not looked at yet; processes wait then.
const EVENTS_MAX: usize = 1024;

/// What a run needs besides its plan.
pub(super) struct Run {
    pub(super) start: Instant,
    pub(super) programs: Programs,
    pub(super) credentials: Credentials,
    pub(super) identities: Vec<Identity>,
    /// Said loudly, and in the report.
    pub(super) warnings: Vec<String>,
    /// The database image.
    pub(super) words: Arc<Vec<u32>>,
    /// Where the manager listens.
    pub(super) listen: SocketAddr,
    /// No progress.
    pub(super) quiet: bool,
    pub(super) health: Option<SocketAddr>,
    pub(super) faults: Vec<Fault>,
}

fn status(state: &State) -> Status {
    let (tiles, missing) = (state.tiles.queue.total(), state.tiles.queue.missing());
    let end = if missing == 0 {
        state.tiles.ledger.last_tile.unwrap_or(state.supervision.now)
    } else {
        state.supervision.now
    };
    Status {
        tiles_done: tiles - missing,
        tiles,
        rays: state.tiles.ledger.rays(),
        elapsed: state.tiles.ledger.first_tile.map(|first| end.saturating_sub(first)),
    }
}

/// The state's hands.
struct Shell {
    start: Instant,
    port: ControlPort,
    children: Children,
    disturbance: Disturbance,
    events: mpsc::Sender<Event>,
    /// Of the database, for every bus that starts.
    words: Arc<Vec<u32>>,
    credentials: Credentials,
    upload_deadline: Duration,
}

impl Run {
    /// Runs until the state is over; gives it back, and what the faults came to if there were to be any.
    ///
    /// # Errors
    /// The system has no port or no signals.
    pub(super) async fn finish(
        self,
        plan: Plan,
        folder: &mut OutputFolder,
    ) -> Result<(State, Option<Chaos>), RunError> {
        let system = |what, error: std::io::Error| RunError::System { what, error: error.to_string() };
        let (sender, mut events) = mpsc::channel(EVENTS_MAX);
        let mut interrupt = signal(SignalKind::interrupt()).map_err(|error| system("signals", error))?;
        let mut terminate = signal(SignalKind::terminate()).map_err(|error| system("signals", error))?;
        let mut hang_up = hang_up().map_err(|error| system("signals", error))?;
        let heartbeat = plan.run.deadlines.heartbeat / HEARTBEATS;
        let port =
            ControlPort::bind(self.listen, self.credentials.clone(), &plan.placement, heartbeat, sender.clone()).await;
        let port = port.map_err(|error| system("port", io::Error::other(format!("{}: {error}", self.listen))))?;
        let first = plan.placement.of_manager();
        let advertised = reach::advertised(first, port.address()).await.map_err(|error| system("address", error))?;
        if plan.placement.has_joiners() {
            reach::say(advertised, self.quiet);
        }
        let health = match self.health {
            Some(address) => Some(health::serve(address).await?),
            None => None,
        };
        let mut shell = Shell::new(&self, &plan, heartbeat, port, advertised, (folder.logs(), sender));
        let (mut state, actions) = State::start(plan);
        for warning in &self.warnings {
            reach::warn(warning);
            state.supervision.incident(warning);
        }
        let mut progress = Progress::new(self.quiet, state.tiles.queue.total());
        shell.act(actions);
        while let Some(deadline) = state.next_deadline() {
            let deadline = tokio::time::Instant::from_std(shell.start + deadline);
            let event = tokio::select! {
                Some(()) = arrived(&mut interrupt) => Event::Signal(Interrupt::Sigint),
                Some(()) = arrived(&mut terminate) => Event::Signal(Interrupt::Sigterm),
                Some(()) = hung_up(&mut hang_up) => Event::Signal(Interrupt::Sighup),
                Some(event) = events.recv() => event,
                event = shell.port.arrival() => event,
                () = sleep_until(deadline) => {
                    progress.show(&status(&state));
                    if let Some(health) = &health {
                        health.send_replace(metrics::health(&state));
                    }
                    Event::Tick
                }
            };
            if !matches!(event, Event::Report(..) | Event::Tick) {
                tracing::info!("{event:?}");
            }
            shell.note(&event);
            shell.disturbance.observe(&event);
            let actions = state.handle(shell.start.elapsed(), event);
            let is_to_begin = actions.contains(&Action::Begin);
            shell.act(actions);
            if is_to_begin {
                let begun = folder.begin().map_err(|error| error.to_string());
                shell.children.logs.send_replace(folder.logs());
                let actions = state.handle(shell.start.elapsed(), Event::Begun(begun));
                shell.act(actions);
            }
            shell.disturb(&mut state);
        }
        shell.port.slots().close().await;
        progress.finish(&status(&state));
        let chaos = shell.disturbance.close().map(|(chaos, missed)| {
            missed.into_iter().for_each(|text| state.supervision.incident(format!("chaos: {text}")));
            chaos
        });
        telemetry::lost().into_iter().for_each(|lost| state.supervision.incident(lost));
        Ok((state, chaos))
    }
}

async fn arrived(signal: &mut Signal) -> Option<()> {
    signal.recv().await
}

/// The end of the terminal, unless this process was started to outlive it (`nohup`).
fn hang_up() -> io::Result<Option<Signal>> {
    Ok(if is_ignored(SIGHUP)? { None } else { Some(signal(SignalKind::hangup())?) })
}

async fn hung_up(signal: &mut Option<Signal>) -> Option<()> {
    signal.as_mut()?.recv().await
}

impl Shell {
    fn new(
        run: &Run,
        plan: &Plan,
        heartbeat: Duration,
        port: ControlPort,
        advertised: SocketAddr,
        (logs, events): (PathBuf, mpsc::Sender<Event>),
    ) -> Self {
        let deadlines = plan.run.deadlines;
        let children = Children {
            programs: run.programs.clone(),
            logs: watch::Sender::new(logs),
            token: run.credentials.token,
            identities: run.identities.clone(),
            placement: plan.placement.clone(),
            advertised,
            heartbeat,
            slots: port.slots(),
            connections: port.connections(),
            events: events.clone(),
            alive: HashMap::new(),
        };
        Self {
            start: run.start,
            disturbance: Disturbance::new(run.faults.clone(), reach::from_here(port.address()).ip()),
            port,
            children,
            events,
            words: Arc::clone(&run.words),
            credentials: run.credentials.clone(),
            upload_deadline: deadlines.startup,
        }
    }

    fn act(&mut self, actions: Vec<Action>) {
        for action in actions {
            match action {
                Action::Spawn(id) => {
                    tracing::info!("{id} is started");
                    self.port.expect(id);
                    let manager = self.disturbance.route(id.role, Role::Manager, reach::from_here(self.port.address()));
                    self.children.spawn(id, manager);
                }
                Action::Tell(id, mut command) => {
                    if self.children.is_local(id) {
                        self.disturbance.reroute(id, &mut command);
                    }
                    let origin = self.port.origin(id);
                    if let Some(why) = origin.and_then(|origin| reach::unreachable(origin, &command)) {
                        self.children.kill_because(id, why);
                    } else if !self.port.tell(id, command) {
                        tracing::error!("{id} does not read what it is told, and is killed");
                        self.children.kill(id);
                    }
                }
                Action::HangUp(id) => self.port.hang_up(id),
                Action::Kill(id) => self.children.kill(id),
                // The answer is an event, and comes after all of these.
                Action::Begin => {}
                Action::Upload(bus, address) => {
                    let address = self.disturbance.route(Role::Manager, bus.role, address);
                    self.upload(bus, address);
                }
            }
        }
    }

    /// What the children must know of an event, before the state does.
    fn note(&mut self, event: &Event) {
        match event {
            Event::Connected(id) => self.children.connected(*id),
            Event::Disconnected(id, _) => self.children.disconnected(*id),
            Event::Exited(id, _) => self.children.reap(*id),
            _ => {}
        }
    }

    /// The faults that are due.
    fn disturb(&mut self, state: &mut State) {
        let Status { tiles_done, tiles, elapsed, .. } = status(state);
        let progress = chaos::Progress { tiles_done, tiles, elapsed };
        for text in self.disturbance.carry_out(state.supervision.now, progress, &mut self.children, &self.port) {
            state.supervision.incident(format!("chaos: {text}"));
        }
    }

    fn upload(&mut self, bus: ProcessId, address: SocketAddr) {
        let Role::Bus(cluster) = bus.role else { return };
        let refused = self.port.origin(bus).and_then(|origin| reach::tells_its_own(origin, address));
        let (events, deadline) = (self.events.clone(), self.upload_deadline);
        let (words, credentials) = (Arc::clone(&self.words), self.credentials.clone());
        tokio::spawn(async move {
            let image = bytemuck::cast_slice(&words);
            let loaded = match refused {
                Some(why) => Err(why),
                None => upload(cluster, address, &credentials, image, deadline).await,
            };
            let event = match loaded {
                Ok(()) => Event::Uploaded(bus),
                Err(why) => Event::UploadFailed(bus, why),
            };
            // An error means that the manager has ended.
            let _ = events.send(event).await;
        });
    }
}

/// `deadline` is for each piece.
async fn upload(
    cluster: ClusterId,
    bus: SocketAddr,
    credentials: &Credentials,
    image: &[u8],
    deadline: Duration,
) -> Result<(), String> {
    let mut loader = Loader::connect(cluster, bus, credentials, deadline).await?;
    loader.store_all(image).await?;
    loader.leave().await;
    Ok(())
}
