//! The driver with a real clock and real connections: one loop, whatever the process.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

use super::connections::{Connections, Happening};
use super::{Action, Admission, ConnectionId, Event, Machine, PeerId};
use crate::processes::bootstrap::live;
use crate::processes::{Child, ControlLink, StartError};
use crate::protocol::connection::{Arrival, Connection, Listener, Peer};

/// Does the tasks of a state.
pub trait Worker<M: Machine> {
    /// Does a task that takes no time worth mentioning, and answers it if it has an answer; begins another.
    ///
    /// # Errors
    /// The task cannot be done: the process must end.
    fn begin(&mut self, task: M::Task) -> Result<Option<M::Answer>, String>;

    /// The next answer to a task that was begun. May be cancelled without losing one; pending where none is awaited.
    fn answer(&mut self) -> impl Future<Output = M::Answer>;

    /// Takes a connection that is not for the state, or gives it back.
    ///
    /// # Errors
    /// The peer cannot be served.
    fn take_over(&mut self, _peer: Peer, connection: Connection) -> Result<Option<Connection>, String> {
        Ok(Some(connection))
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    #[error(transparent)]
    Start(#[from] StartError),
    #[error("{0}")]
    System(#[from] std::io::Error),
    #[error("the manager is gone")]
    Orphaned,
    /// As it was reported to the manager.
    #[error("{0}")]
    Failed(String),
}

/// Lives a process' life, from its first command to its end. `wire_bytes` counts what goes over its connections, both
/// directions, without the manager's.
///
/// # Errors
/// The manager cannot be reached or is gone, or the state ends with an error.
pub fn run<M, W>(child: &Child, state: M, worker: W, wire_bytes: Arc<AtomicU64>) -> Result<(), ProcessError>
where
    M: Machine + 'static,
    M::Command: Send,
    M::Answer: Send,
    W: Worker<M>,
{
    live(child, async {
        let mut link = ControlLink::open(child)?;
        let driver = Driver::new(child, &link, worker, wire_bytes)?;
        let outcome = driver.drive(state, &mut link.commands).await;
        link.close();
        outcome
    })
}

struct Driver<'a, M: Machine, W> {
    child: &'a Child,
    interface: std::net::IpAddr,
    reports: mpsc::Sender<M::Report>,
    worker: W,
    start: Instant,
    terminate: Option<Signal>,
    listener: Option<Listener>,
    accepted: u64,
    connections: Connections<M>,
    happenings: mpsc::Receiver<Happening<M>>,
}

/// What the driver waits for.
enum Next<M: Machine> {
    Event(Event<M>),
    Happening(Happening<M>),
    Arrival(Arrival),
}

impl<'a, M: Machine + 'static, W: Worker<M>> Driver<'a, M, W>
where
    M::Command: Send,
    M::Answer: Send,
{
    fn new(
        child: &'a Child,
        link: &ControlLink<M::Command, M::Report>,
        worker: W,
        wire_bytes: Arc<AtomicU64>,
    ) -> Result<Self, ProcessError> {
        let (connections, happenings) = Connections::new(child.introduction(), wire_bytes);
        Ok(Self {
            child,
            interface: link.interface,
            reports: link.reports.clone(),
            worker,
            start: Instant::now(),
            terminate: if M::LEAVES { Some(signal(SignalKind::terminate())?) } else { None },
            listener: None,
            accepted: 0,
            connections,
            happenings,
        })
    }

    async fn drive(mut self, mut state: M, commands: &mut mpsc::Receiver<M::Command>) -> Result<(), ProcessError> {
        loop {
            let event = match self.next(&state, commands).await? {
                Next::Event(event) => Some(event),
                Next::Happening(happening) => self.connections.event(&state, happening),
                Next::Arrival(arrival) => self.arrived(&state, arrival),
            };
            let mut events = VecDeque::from_iter(event);
            while let Some(event) = events.pop_front() {
                for action in state.handle(self.start.elapsed(), event) {
                    if let Action::End(outcome) = action {
                        self.connections.finish(&mut self.happenings).await;
                        return outcome.map_err(ProcessError::Failed);
                    }
                    match self.act(action).await {
                        Some(Event::Failed(why)) => {
                            events.push_front(Event::Failed(why));
                            break;
                        }
                        event => events.extend(event),
                    }
                }
            }
        }
    }

    async fn next(&mut self, state: &M, commands: &mut mpsc::Receiver<M::Command>) -> Result<Next<M>, ProcessError> {
        let deadline = state.next_deadline().map(|deadline| self.start + deadline);
        Ok(tokio::select! {
            biased;
            command = commands.recv() => Next::Event(Event::Command(command.ok_or(ProcessError::Orphaned)?)),
            () = terminated(&mut self.terminate) => Next::Event(Event::Terminate),
            () = passed(deadline) => Next::Event(Event::Deadline),
            answer = self.worker.answer() => Next::Event(Event::Answer(answer)),
            Some(happening) = self.happenings.recv() => Next::Happening(happening),
            arrival = arrival(&mut self.listener) => Next::Arrival(arrival),
        })
    }

    /// What comes of it at once.
    async fn act(&mut self, action: Action<M>) -> Option<Event<M>> {
        match action {
            // An error means that the manager is gone: its commands end too.
            Action::Report(report) => drop(self.reports.send(report).await),
            Action::Listen(admission) => return Some(self.listen(admission).await),
            Action::Dial { id, role, address, pause } => self.connections.dial(id, role, address, pause),
            Action::Send(to, message) => return self.connections.send(to, message).await,
            Action::Close(id) => self.connections.close(id),
            Action::Task(task) => match self.worker.begin(task) {
                Ok(answer) => return answer.map(Event::Answer),
                Err(why) => return Some(Event::Failed(why)),
            },
            Action::End(_) => {}
        }
        None
    }

    async fn listen(&mut self, admission: Admission) -> Event<M> {
        let (interface, credentials) = (self.child.interface(self.interface), self.child.credentials());
        let listening = async {
            let listener = Listener::bind(interface, credentials, move |role, _| admission.check(role)).await?;
            let address = self.child.advertised(listener.address(), self.interface).await?;
            std::io::Result::Ok((listener, address))
        };
        match listening.await {
            Ok((listener, address)) => {
                self.listener = Some(listener);
                Event::Listening(address)
            }
            Err(error) => Event::Failed(format!("cannot listen: {error}")),
        }
    }

    fn arrived(&mut self, state: &M, arrival: Arrival) -> Option<Event<M>> {
        let (peer, connection) = match arrival {
            Ok(arrived) => arrived,
            Err(error) if error.is_of_this_process() => return Some(Event::Failed(error.to_string())),
            Err(refused) => return Some(Event::Refused(refused.to_string())),
        };
        match self.worker.take_over(peer, connection) {
            Ok(None) => None,
            Ok(Some(connection)) => {
                let id = ConnectionId::Accepted(self.accepted);
                self.accepted += 1;
                self.connections.open(state, id, peer.role, connection);
                Some(Event::Accepted(id, PeerId { role: peer.role, epoch: peer.epoch }))
            }
            Err(why) => Some(Event::Refused(why)),
        }
    }
}

/// Never where there is no such time.
async fn passed(time: Option<Instant>) {
    match time {
        Some(time) => sleep_until(time).await,
        None => std::future::pending().await,
    }
}

async fn terminated(signal: &mut Option<Signal>) {
    match signal {
        Some(signal) => drop(signal.recv().await),
        None => std::future::pending().await,
    }
}

async fn arrival(listener: &mut Option<Listener>) -> Arrival {
    match listener {
        Some(listener) => listener.arrival().await,
        None => std::future::pending().await,
    }
}

/// For a state that has no tasks.
#[derive(Debug)]
pub struct NoTasks;

impl<M: Machine<Task = std::convert::Infallible>> Worker<M> for NoTasks {
    fn begin(&mut self, task: M::Task) -> Result<Option<M::Answer>, String> {
        match task {}
    }

    async fn answer(&mut self) -> M::Answer {
        std::future::pending().await
    }
}
