//! From a process's start until it is certainly dead, wherever it runs.

use std::fs::OpenOptions;
use std::io;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tokio::io::AsyncWriteExt;
use tokio::process::{Child, Command};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until, timeout};

use crate::codec;
use crate::protocol::control::Bootstrap;

/// Whoever calls `marti` may have told it to join somebody: that is not for its children.
const JOIN_VARIABLE: &str = "MARTI_JOIN";

/// The control connection of a process.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Link {
    Awaited,
    Open,
    Closed,
}

/// What is done to a process.
#[derive(Debug)]
pub(super) enum Order {
    /// By SIGSTOP, on this machine alone; it goes on after so long.
    Stop(Duration),
    /// For a reason that the manager's state does not know of.
    Die(String),
}

/// What a life ends by, and how long its end may take.
pub(super) struct Fate {
    /// Its end kills.
    pub(super) orders: mpsc::Receiver<Order>,
    pub(super) link: watch::Receiver<Link>,
    /// Ends the control connection, or the permission to open one.
    pub(super) hang_up: Box<dyn Fn() + Send>,
    /// From hanging up until a process that cannot be seen is dead by its own clock.
    pub(super) patience: Duration,
}

impl Fate {
    /// A process that ended its control connection, or was cut off for long enough, is dead; one that never had one
    /// gets none any more.
    async fn confirm(&mut self) {
        (self.hang_up)();
        if *self.link.borrow() == Link::Awaited {
            return;
        }
        if timeout(self.patience, self.link.wait_for(|&link| link == Link::Closed)).await.is_err() {
            tracing::warn!("a process on another machine did not end its connection, and is taken for dead");
        }
    }
}

/// Starts a program of this machine, or a launcher of another one's, which hands its standard input on. It has a
/// process group of its own, so that a Ctrl-C in the terminal reaches the manager alone.
pub(super) async fn start(command: &[String], bootstrap: &Bootstrap, log: &Path) -> io::Result<Child> {
    // What is printed before the log is open, or by an abort; all that is logged, on another machine.
    let printed = OpenOptions::new().create(true).append(true).open(log)?;
    let (program, arguments) = command.split_first().ok_or_else(|| io::Error::other("an empty command"))?;
    let mut child = Command::new(program)
        .args(arguments)
        .env_remove(JOIN_VARIABLE)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(printed)
        .process_group(0)
        .kill_on_drop(true)
        .spawn()?;
    if let Some(mut stdin) = child.stdin.take() {
        let frame = codec::encode(bootstrap, &[]).map_err(io::Error::other)?;
        // A child that does not read it has ended; its status says more. The frame fits the pipe's buffer.
        let _ = stdin.write_all(&frame).await;
    }
    Ok(child)
}

/// Until a child has ended; how, as the rest of a sentence that begins with the process's name.
pub(super) async fn watch(mut child: Child, fate: &mut Fate, log: &Path) -> String {
    let told =
        |status: io::Result<ExitStatus>| status.map_or_else(|error| error.to_string(), |status| describe(status, log));
    let mut goes_on = None;
    let reason = loop {
        tokio::select! {
            status = child.wait() => return told(status),
            order = fate.orders.recv() => match order {
                Some(Order::Stop(time)) => {
                    signal(&child, Signal::SIGSTOP);
                    goes_on = goes_on.max(Some(Instant::now() + time));
                }
                Some(Order::Die(reason)) => break Some(reason),
                None => break None,
            },
            () = sleep_until(goes_on.unwrap_or_else(Instant::now)), if goes_on.is_some() => {
                signal(&child, Signal::SIGCONT);
                goes_on = None;
            }
        }
    };
    // An error means that it has just ended.
    let _ = child.start_kill();
    let status = child.wait().await;
    reason.unwrap_or_else(|| told(status))
}

/// Its number is still its own: nobody has waited for it. An error means that it has just ended.
fn signal(child: &Child, signal: Signal) {
    if let Some(pid) = child.id().and_then(|pid| i32::try_from(pid).ok()) {
        let _ = kill(Pid::from_raw(pid), signal);
    }
}

/// [`watch()`] of a launcher, and of the process that it started elsewhere: that one ends by itself when its control
/// connection does.
pub(super) async fn watch_elsewhere(child: Child, mut fate: Fate, log: &Path) -> String {
    let how = watch(child, &mut fate, log).await;
    fate.confirm().await;
    how
}

/// Until a process that came by itself, or was awaited to, is gone.
pub(super) async fn watch_joined(mut fate: Fate) -> String {
    let why = loop {
        tokio::select! {
            _ = fate.link.wait_for(|&link| link == Link::Closed) => break "closed its control connection".to_owned(),
            order = fate.orders.recv() => match order {
                Some(Order::Stop(_)) => {}
                Some(Order::Die(reason)) => break reason,
                None => break "was cut off".to_owned(),
            },
        }
    };
    fate.confirm().await;
    why
}

fn describe(status: ExitStatus, log: &Path) -> String {
    if let Some(signal) = status.signal() {
        let name = Signal::try_from(signal).map_or("unknown", Signal::as_str);
        return format!("died of signal {signal} ({name})");
    }
    match status.code() {
        Some(0) => "ended by itself".to_owned(),
        Some(code) => format!("ended with exit code {code}, see {}", log.display()),
        None => "ended".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use tokio::time::Instant;

    use super::*;

    fn fate(now: Link) -> (Fate, mpsc::Sender<Order>, watch::Sender<Link>, Arc<AtomicBool>) {
        let (kill, orders) = mpsc::channel(1);
        let (told, link) = watch::channel(now);
        let hung_up = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&hung_up);
        let hang_up = Box::new(move || flag.store(true, Ordering::Relaxed));
        (Fate { orders, link, hang_up, patience: Duration::from_millis(200) }, kill, told, hung_up)
    }

    #[tokio::test]
    async fn a_process_that_joined_is_dead_when_it_is_gone_or_long_cut_off() {
        let (one, _kill, told, _) = fate(Link::Open);
        let life = tokio::spawn(watch_joined(one));
        told.send_replace(Link::Closed);
        assert_eq!(life.await.expect("no panic"), "closed its control connection");

        let (one, kill, _told, hung_up) = fate(Link::Open);
        let begin = Instant::now();
        kill.try_send(Order::Die("was a nuisance".to_owned())).expect("awaited");
        assert_eq!(watch_joined(one).await, "was a nuisance");
        assert!(begin.elapsed() >= Duration::from_millis(200) && hung_up.load(Ordering::Relaxed));

        let (one, kill, _told, hung_up) = fate(Link::Awaited);
        drop(kill);
        let begin = Instant::now();
        assert_eq!(watch_joined(one).await, "was cut off");
        assert!(begin.elapsed() < Duration::from_millis(100) && hung_up.load(Ordering::Relaxed), "nobody to wait for");
    }

    #[tokio::test]
    async fn a_process_elsewhere_outlives_its_launcher_until_its_connection_ends() {
        let (one, _kill, told, hung_up) = fate(Link::Open);
        let child = Command::new("true").spawn().expect("every system has it");
        let log = Path::new("unused");
        let life = tokio::spawn(async move { watch_elsewhere(child, one, log).await });
        while !hung_up.load(Ordering::Relaxed) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        assert!(!life.is_finished());
        told.send_replace(Link::Closed);
        assert_eq!(life.await.expect("no panic"), "ended by itself");
    }
}
