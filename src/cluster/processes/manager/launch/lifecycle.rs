//! From a process's start until it is certainly dead, wherever it runs.

use std::fs::File;
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use nix::errno::Errno;
use nix::libc::O_NOFOLLOW;
use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::{Signal, kill, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::Pid;
use tokio::io::AsyncWriteExt;
use tokio::process::{Child, Command};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until, timeout};

use crate::protocol::control::Bootstrap;
use crate::protocol::frame;

use super::programs::Invocation;

/// Its environment may ask `marti` to join another manager: that is not for its children.
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

/// What ends the watch over a process, and how long its end may take.
pub(super) struct Monitor {
    /// Its end kills.
    pub(super) orders: mpsc::Receiver<Order>,
    pub(super) link: watch::Receiver<Link>,
    /// Ends the control connection, or the permission to open one.
    pub(super) hang_up: Box<dyn Fn() + Send>,
    /// From hanging up until a process that cannot be seen is dead by its own clock.
    pub(super) patience: Duration,
}

impl Monitor {
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

/// Where the log of a process is. Its folder moves when the run begins.
#[derive(Clone, Debug)]
pub(super) struct Log {
    pub(super) folder: watch::Receiver<PathBuf>,
    /// Of the file.
    pub(super) name: String,
}

impl Log {
    fn path(&self) -> PathBuf {
        self.folder.borrow().join(&self.name)
    }

    fn open(&self) -> io::Result<File> {
        let options = File::options().create(true).append(true).custom_flags(O_NOFOLLOW).open(self.path());
        options.map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", self.path().display())))
    }
}

/// A program that was started, and the process group that it leads. Dropping it kills them all.
#[derive(Debug)]
pub(super) struct Started {
    child: Child,
    group: Pid,
}

/// Starts a program of this machine, or a launcher of another one's, which hands its standard input on. It leads a
/// process group, so that a Ctrl-C in the terminal reaches the manager alone, and all that it starts ends with it. What it
/// prints, its log above all, is appended to the log's file.
pub(super) async fn start(invocation: &Invocation, bootstrap: &Bootstrap, log: &Log) -> io::Result<Started> {
    let (program, arguments) = invocation.command.split_first().ok_or_else(|| io::Error::other("an empty command"))?;
    let mut command = Command::new(program);
    command
        .args(arguments)
        .env_remove(JOIN_VARIABLE)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(log.open()?)
        .process_group(0)
        .kill_on_drop(true);
    if let Some(name) = invocation.name {
        command.arg0(name);
    } else {
        // Processes of ours end by themselves when the manager is killed; a launcher does not notice.
        // SAFETY: between fork and exec only one system call is made, which allocates nothing.
        unsafe { command.pre_exec(|| Ok(set_pdeathsig(Signal::SIGTERM)?)) };
    }
    let mut child = command.spawn()?;
    let group = child.id().and_then(|pid| i32::try_from(pid).ok()).map(Pid::from_raw);
    let group = group.ok_or_else(|| io::Error::other("it ended while it was started"))?;
    if let Some(mut stdin) = child.stdin.take() {
        let frame = frame::encode(bootstrap, &[]).map_err(io::Error::other)?;
        // A child that does not read it has ended; its status says more. The frame fits the pipe's buffer.
        let _ = stdin.write_all(&frame).await;
    }
    Ok(Started { child, group })
}

impl Started {
    /// Until the leader of the group has ended, and the others with it. May be cancelled.
    async fn ended(&mut self) -> io::Result<ExitStatus> {
        let mut deaths = signal(SignalKind::child())?;
        // The leader is looked at, and not taken off the system's table yet: until then its number, which is the group's,
        // is given to no other process.
        let look = WaitPidFlag::WEXITED | WaitPidFlag::WNOWAIT | WaitPidFlag::WNOHANG;
        loop {
            match waitid(Id::Pid(self.group), look) {
                Ok(WaitStatus::StillAlive) => {
                    deaths.recv().await;
                }
                Err(Errno::EINTR) => {}
                // An error: the leader is off the table, and its own status says more.
                _ => break,
            }
        }
        self.kill();
        self.child.wait().await
    }

    /// All of the group. An error means that it has just ended.
    fn kill(&self) {
        if self.child.id().is_some() {
            let _ = killpg(self.group, Signal::SIGKILL);
        }
    }

    /// The leader alone.
    fn signal(&self, signal: Signal) {
        if self.child.id().is_some() {
            let _ = kill(self.group, signal);
        }
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Until a child has ended; how, as the rest of a sentence that begins with the process's name.
pub(super) async fn watch(mut child: Started, monitor: &mut Monitor, log: &Log) -> String {
    let told = |status: io::Result<ExitStatus>| {
        status.map_or_else(|error| error.to_string(), |status| describe(status, &log.path()))
    };
    let mut goes_on = None;
    let reason = loop {
        tokio::select! {
            status = child.ended() => return told(status),
            order = monitor.orders.recv() => match order {
                Some(Order::Stop(time)) => {
                    child.signal(Signal::SIGSTOP);
                    goes_on = goes_on.max(Some(Instant::now() + time));
                }
                Some(Order::Die(reason)) => break Some(reason),
                None => break None,
            },
            () = sleep_until(goes_on.unwrap_or_else(Instant::now)), if goes_on.is_some() => {
                child.signal(Signal::SIGCONT);
                goes_on = None;
            }
        }
    };
    child.kill();
    let status = child.ended().await;
    reason.unwrap_or_else(|| told(status))
}

/// [`watch()`] of a launcher, and of the process that it started elsewhere: that one ends by itself when its control
/// connection does.
pub(super) async fn watch_elsewhere(child: Started, mut monitor: Monitor, log: &Log) -> String {
    let how = watch(child, &mut monitor, log).await;
    monitor.confirm().await;
    how
}

/// Until a process that came by itself, or was awaited to, is gone.
pub(super) async fn watch_joined(mut monitor: Monitor) -> String {
    let why = loop {
        tokio::select! {
            _ = monitor.link.wait_for(|&link| link == Link::Closed) => break "closed its control connection".to_owned(),
            order = monitor.orders.recv() => match order {
                Some(Order::Stop(_)) => {}
                Some(Order::Die(reason)) => break reason,
                None => break "was cut off".to_owned(),
            },
        }
    };
    monitor.confirm().await;
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
    use crate::protocol::hello::{Role, RunToken};
    use ground::ids::{Epoch, NodeId};

    fn monitor(now: Link) -> (Monitor, mpsc::Sender<Order>, watch::Sender<Link>, Arc<AtomicBool>) {
        let (kill, orders) = mpsc::channel(1);
        let (told, link) = watch::channel(now);
        let hung_up = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&hung_up);
        let hang_up = Box::new(move || flag.store(true, Ordering::Relaxed));
        (Monitor { orders, link, hang_up, patience: Duration::from_millis(200) }, kill, told, hung_up)
    }

    #[tokio::test]
    async fn a_process_that_joined_is_dead_when_it_is_gone_or_long_cut_off() {
        let (one, _kill, told, _) = monitor(Link::Open);
        let life = tokio::spawn(watch_joined(one));
        told.send_replace(Link::Closed);
        assert_eq!(life.await.expect("no panic"), "closed its control connection");

        let (one, kill, _told, hung_up) = monitor(Link::Open);
        let begin = Instant::now();
        kill.try_send(Order::Die("was a nuisance".to_owned())).expect("awaited");
        assert_eq!(watch_joined(one).await, "was a nuisance");
        assert!(begin.elapsed() >= Duration::from_millis(200) && hung_up.load(Ordering::Relaxed));

        let (one, kill, _told, hung_up) = monitor(Link::Awaited);
        drop(kill);
        let begin = Instant::now();
        assert_eq!(watch_joined(one).await, "was cut off");
        assert!(begin.elapsed() < Duration::from_millis(100) && hung_up.load(Ordering::Relaxed), "nobody to wait for");
    }

    fn log(folder: &Path) -> Log {
        Log { folder: watch::channel(folder.to_owned()).1, name: "x.log".to_owned() }
    }

    async fn started(command: &[&str], log: &Log) -> Started {
        let bootstrap = Bootstrap {
            role: Role::Node(NodeId(0)),
            epoch: Epoch(0),
            token: RunToken::new([7; 32]),
            manager: ([127, 0, 0, 1], 1).into(),
            identity: None,
            bind: None,
            advertise: None,
            log: None,
            heartbeat_milliseconds: 250,
        };
        let command = command.iter().map(|word| (*word).to_owned()).collect();
        start(&Invocation { command, name: None }, &bootstrap, log).await.expect("every system has it")
    }

    /// Whether a process, by the number that it printed to the log, has ended.
    async fn has_ended(log: &Log) -> bool {
        let printed = std::fs::read_to_string(log.path()).expect("a log");
        let pid = Pid::from_raw(printed.trim().parse().expect("a number"));
        for _ in 0..200 {
            // A process that has ended, and whose parent has not waited for it yet, is a zombie.
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            if stat.is_empty() || stat.contains(") Z ") {
                return true;
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        let _ = kill(pid, Signal::SIGKILL);
        false
    }

    async fn printed(log: &Log) {
        while std::fs::read_to_string(log.path()).is_ok_and(|text| !text.ends_with('\n')) {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    const PRINTS_ITS_CHILD: &str = "sleep 300 & echo $! >&2;";

    #[tokio::test]
    async fn what_a_launcher_started_ends_when_the_launcher_is_killed() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = log(folder.path());
        let child = started(&["sh", "-c", &format!("{PRINTS_ITS_CHILD} wait")], &log).await;
        let (mut one, kill, _told, _) = monitor(Link::Awaited);
        printed(&log).await;
        kill.try_send(Order::Die("was in the way".to_owned())).expect("awaited");
        assert_eq!(watch(child, &mut one, &log).await, "was in the way");
        assert!(has_ended(&log).await);
    }

    #[tokio::test]
    async fn what_a_launcher_started_ends_with_the_launcher_and_with_the_manager() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = log(folder.path());
        let child = started(&["sh", "-c", &format!("{PRINTS_ITS_CHILD} exit 0")], &log).await;
        let (mut one, _kill, _told, _) = monitor(Link::Awaited);
        assert_eq!(watch(child, &mut one, &log).await, "ended by itself");
        assert!(has_ended(&log).await);

        std::fs::remove_file(log.path()).expect("there");
        let child = started(&["sh", "-c", &format!("{PRINTS_ITS_CHILD} wait")], &log).await;
        printed(&log).await;
        drop(child);
        assert!(has_ended(&log).await);
    }

    #[tokio::test]
    async fn a_process_elsewhere_outlives_its_launcher_until_its_connection_ends() {
        let (one, _kill, told, hung_up) = monitor(Link::Open);
        let folder = tempfile::tempdir().expect("a folder");
        let log = log(folder.path());
        let child = started(&["true"], &log).await;
        let life = tokio::spawn(async move { watch_elsewhere(child, one, &log).await });
        while !hung_up.load(Ordering::Relaxed) {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        assert!(!life.is_finished());
        told.send_replace(Link::Closed);
        assert_eq!(life.await.expect("no panic"), "ended by itself");
    }
}
