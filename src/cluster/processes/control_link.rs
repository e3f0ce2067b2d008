//! A child's end of its control connection.
//!
//! It has a thread and an event queue of its own, so that nothing that the process does can hold up its signs of life, and
//! so that the process ends when the manager is gone or silent, or when another of its threads is stuck, whatever the
//! others do: signs of life are signs of progress.

use std::net::IpAddr;
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, oneshot};
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

use super::bootstrap::{Child, StartError};
use super::event_queue::event_queue;
use crate::protocol::connection::{Connection, ConnectionError, Receiver, Sender, connect};
use crate::protocol::control;
use crate::protocol::frame::Message;
use crate::protocol::hello::Role;
use ground::pulse::Watch;
use ground::telemetry;

/// For the manager to answer the first hello.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);
/// From the end of the control connection to that of the process, for closing files.
pub const ORPHAN_GRACE: Duration = Duration::from_millis(700);
/// For the manager to take note of the last report and hang up.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(1);
const QUEUE_MAX: usize = 256;
/// Signs of life that the manager owes before it counts as gone: those of two of its own deadlines.
const HEARTBEATS: u32 = 8;
const PATIENCE_MIN: Duration = Duration::from_secs(2);
/// How often the other threads are looked at, and how many looks find a thread stuck that is so: 20 s. Below the 30 s after
/// which nodes give a display up that acknowledges nothing: whichever is stuck, it alone is replaced.
const LOOK_PERIOD: Duration = Duration::from_secs(1);
const LOOKS_MAX: u32 = 20;

/// How long a process waits for a sign of life of its manager that comes every so often. Nothing that this process
/// does counts when the time and [`ORPHAN_GRACE`] have passed: it is dead.
pub fn patience(period: Duration) -> Duration {
    (period * HEARTBEATS).max(PATIENCE_MIN)
}

/// Commands from the manager, reports to it. Heartbeats go out by themselves.
#[derive(Debug)]
pub struct ControlLink<Command, Report> {
    /// Ends (`None`) when the manager is gone: the process must end then, and is ended if it does not.
    pub commands: mpsc::Receiver<Command>,
    pub reports: mpsc::Sender<Report>,
    /// The interface at which the manager reaches this host: where a server of this process listens.
    pub interface: IpAddr,
    closing: oneshot::Sender<()>,
    thread: JoinHandle<()>,
}

impl<Command: control::Command, Report: control::Report> ControlLink<Command, Report> {
    /// Dials the manager and starts to send heartbeats.
    ///
    /// # Errors
    /// The manager does not answer within 5 s, or refuses this process; the system has no thread or no descriptor left.
    pub fn open(child: &Child) -> Result<Self, StartError> {
        let (command_sender, commands) = mpsc::channel(QUEUE_MAX);
        let (reports, report_receiver) = mpsc::channel(QUEUE_MAX);
        let (connected, connection) = sync_channel(1);
        let (closing, close) = oneshot::channel();
        let (child, manager, introduction) = (child.clone(), child.bootstrap.manager, child.introduction());
        let period = Duration::from_millis(child.bootstrap.heartbeat_milliseconds.max(1));
        let thread = thread::Builder::new().name("control".to_owned()).spawn(move || {
            let runtime = match event_queue() {
                Ok(runtime) => runtime,
                Err(error) => return drop(connected.send(Err(StartError::System(error)))),
            };
            let must_end = runtime.block_on(async {
                if let Role::Node(_) = child.bootstrap.role {
                    tokio::spawn(heed_sigterm(child.clone()));
                }
                let connection = match connect(Role::Manager, manager, &introduction, CONNECT_DEADLINE).await {
                    Ok(connection) => connection,
                    Err(error) => {
                        drop(connected.send(Err(StartError::Manager(error))));
                        return false;
                    }
                };
                drop(connected.send(Ok(connection.local_address().ip())));
                child.tell(true);
                let watch = Watch::new(child.pulse.clone(), LOOKS_MAX);
                let must_end = converse(connection, command_sender, report_receiver, close, watch, period).await;
                child.tell(false);
                must_end
            });
            if must_end {
                child.end_at_once();
            }
        });
        let thread = thread.map_err(StartError::Thread)?;
        // The thread answers in any case, within the deadline for connecting.
        let interface = connection.recv().map_err(|error| StartError::Thread(std::io::Error::other(error)))??;
        Ok(Self { commands, reports, interface, closing, thread })
    }

    /// Sends what was reported so far, waits until the manager hangs up (1 s at most), and lets this
    /// process go. What is reported later, through clones of [`Self::reports`], is not sent.
    pub fn close(self) {
        drop(self.closing);
        // A panic of that thread is in the log.
        let _ = self.thread.join();
    }
}

/// A node leaves in order, and whatever becomes of its run meanwhile, it is to go; the others end at once.
async fn heed_sigterm(child: Child) {
    // Without a handler it ends at once, too.
    let Ok(mut terminate) = signal(SignalKind::terminate()) else { return };
    while terminate.recv().await.is_some() {
        child.leave();
    }
}

/// Whether the process must end at once: the manager went first, or a thread is stuck.
async fn converse<Command: control::Command, Report: control::Report>(
    connection: Connection,
    commands: mpsc::Sender<Command>,
    reports: mpsc::Receiver<Report>,
    close: oneshot::Receiver<()>,
    watch: Watch,
    period: Duration,
) -> bool {
    let (sender, mut receiver) = connection.split::<Report, Command>();
    let mut farewell = std::pin::pin!(report(sender, reports, close, watch, period));
    let (orphaned, is_heard) = tokio::select! {
        biased;
        told = &mut farewell => match told {
            // Everything is said: what else comes does not matter, the end does.
            Ok(last) => {
                drop(timeout(FAREWELL_DEADLINE, drain(&mut receiver)).await);
                return last == Last::Stuck;
            }
            Err(error) => (error.to_string(), false),
        },
        why = forward(&mut receiver, &commands, patience(period)) => (why, true),
    };
    drop(commands);
    // The manager hangs up as soon as it has the last word, which may be before this process closes the link.
    if is_heard && let Ok(Ok(last)) = timeout(ORPHAN_GRACE, farewell).await {
        return last == Last::Stuck;
    }
    tracing::error!("the manager is gone: {orphaned}");
    if !is_heard {
        sleep(ORPHAN_GRACE).await;
    }
    true
}

/// Why nothing more is reported.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Last {
    /// The process has closed the link.
    Closed,
    /// A thread of it is stuck.
    Stuck,
}

/// Heartbeats and reports until the process closes the link, or is found stuck.
async fn report<Report: control::Report>(
    mut sender: Sender<Report>,
    mut reports: mpsc::Receiver<Report>,
    mut close: oneshot::Receiver<()>,
    mut watch: Watch,
    period: Duration,
) -> Result<Last, ConnectionError> {
    let mut beat = interval(period);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut look = interval(LOOK_PERIOD);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let last = loop {
        tokio::select! {
            biased;
            _ = beat.tick() => sender.send(&Report::HEARTBEAT).await?,
            _ = look.tick() => if let Some(thread) = watch.look() {
                let time = LOOK_PERIOD * LOOKS_MAX;
                let why = format!("its thread {thread} is stuck: no step and no processor time in {} s", time.as_secs());
                tracing::error!("{why}");
                sender.send(&Report::incident(why)).await?;
                break Last::Stuck;
            },
            report = reports.recv() => match report {
                Some(report) => sender.send(&report).await?,
                None => break Last::Closed,
            },
            // What is in the queue is still received, then the queue ends.
            _ = &mut close, if !reports.is_closed() => reports.close(),
        }
    };
    for lost in telemetry::lost() {
        sender.send(&Report::incident(lost)).await?;
    }
    sender.finish().await;
    Ok(last)
}

/// Commands until the manager is gone, and why it is.
async fn forward<Command: control::Command>(
    receiver: &mut Receiver<Command>,
    commands: &mpsc::Sender<Command>,
    patience: Duration,
) -> String {
    loop {
        match receiver.receive_within(patience).await {
            Ok(Some(command)) if command.is_heartbeat() => {}
            // An error means that the process does not listen any more: it is about to close.
            Ok(Some(command)) => drop(commands.send(command).await),
            Ok(None) => return "it closed the connection".to_owned(),
            Err(error) => return error.to_string(),
        }
    }
}

async fn drain<Command: Message>(receiver: &mut Receiver<Command>) {
    while let Ok(Some(_)) = receiver.receive().await {}
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;
    use std::time::Instant;

    use super::*;
    use crate::protocol::connection::{Credentials, Listener};
    use crate::protocol::control::{Bootstrap, BusCommand, BusReport};
    use crate::protocol::hello::RunToken;
    use ground::ids::{ClusterId, Epoch};

    const PERIOD: Duration = Duration::from_millis(20);

    #[tokio::test]
    async fn signs_of_life_go_on_while_the_process_is_busy_and_its_last_words_arrive() {
        let credentials = Credentials::plain(RunToken::new([1; 32]));
        let mut manager =
            Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials.clone(), |_, _| Ok(())).await.expect("loopback");
        let bootstrap = Bootstrap {
            role: Role::Bus(ClusterId(0)),
            epoch: Epoch(0),
            token: credentials.token,
            manager: manager.address(),
            identity: None,
            bind: None,
            advertise: None,
            log: None,
            heartbeat_milliseconds: PERIOD.as_millis() as u64,
        };
        let busy = 20 * PERIOD;
        let process = thread::spawn(move || {
            let child = Child::new(bootstrap, false).expect("no keys");
            let mut link: ControlLink<BusCommand, BusReport> = ControlLink::open(&child).expect("welcome");
            let command = link.commands.blocking_recv();
            thread::sleep(busy);
            for i in 0..100 {
                link.reports.blocking_send(BusReport::Incident(i.to_string())).expect("open");
            }
            let late = link.reports.clone();
            let begin = Instant::now();
            link.close();
            assert!(begin.elapsed() < FAREWELL_DEADLINE, "the manager hangs up at once");
            assert!(late.blocking_send(BusReport::Heartbeat).is_err());
            command
        });
        let (_, connection) = manager.arrival().await.expect("well known");
        let (mut sender, mut receiver) = connection.split::<BusCommand, BusReport>();
        let finish = BusCommand::Finish { lost: Vec::new() };
        // A sign of life is for the link alone.
        sender.send(&BusCommand::Heartbeat).await.expect("awaited");
        sender.send(&finish).await.expect("awaited");
        let (mut heartbeats, mut incidents) = (0, Vec::new());
        while let Some(report) = receiver.receive_within(FAREWELL_DEADLINE).await.expect("whole frames") {
            match report {
                BusReport::Incident(incident) => incidents.push(incident),
                _ => heartbeats += 1,
            }
        }
        drop((sender, receiver));
        assert_eq!(process.join().expect("no panic"), Some(finish));
        assert_eq!(incidents, (0..100).map(|i| i.to_string()).collect::<Vec<_>>());
        // Half of what an idle machine would send.
        assert!(heartbeats >= 10, "{heartbeats} heartbeats");
    }
}
