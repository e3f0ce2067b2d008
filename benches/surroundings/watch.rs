//! One process and its children, from the beginning to the end of the last: what is done to them, and that it took effect.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::disk::Disk;
use crate::kind::End;
use crate::memory_group::MemoryGroup;
use crate::namespaces::{Namespaces, Process, tool};
use crate::pipes::Pipes;
use crate::surroundings::{Deed, Limit, Surroundings, Targets, When};

/// A run that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(120);
/// For what the manager leaves behind: twice the deadline for heartbeats, the grace of an orphan, and a slow machine.
pub(crate) const ORPHAN_PATIENCE: Duration = Duration::from_secs(10);
/// For a signal to be seen in /proc.
const SIGNAL_PATIENCE: Duration = Duration::from_secs(1);
const STEP: Duration = Duration::from_millis(3);
/// Rust's programs and the system's say such things where a limit is met.
const REFUSALS: [&str; 12] = [
    "os error 11)",
    "os error 12)",
    "os error 23)",
    "os error 24)",
    "os error 27)",
    "os error 28)",
    "died of signal 6 ",
    "died of signal 11 ",
    "died of signal 24 ",
    "died of signal 25 ",
    "os error 7)",
    "memory allocation of",
];

/// What came of it.
pub(crate) struct Attempt {
    pub(crate) end: End,
    /// What was done when.
    pub(crate) done: Vec<String>,
    /// How it was seen from outside that it took effect; several things may have.
    pub(crate) confirmed: Vec<String>,
    /// The manager's death was our doing.
    pub(crate) killed: bool,
    pub(crate) faults: Vec<String>,
    /// On standard output and error, as far as they could be read.
    pub(crate) said: String,
    pub(crate) logs: String,
    pub(crate) keeps_errors: bool,
}

pub(crate) struct Watch<'a> {
    namespaces: &'a Namespaces,
    surroundings: &'a Surroundings,
    disk: Disk,
    manager: u32,
    start: Instant,
    /// Whom to let go on, and when.
    stopped: Vec<(Process, Option<Duration>)>,
    limits_shown: bool,
    streams_shown: Option<String>,
    /// Since when the manager is stopped for ever.
    abandoned: Option<Instant>,
    attempt: Attempt,
}

/// Runs `marti` in these surroundings. `journal` and its whole size say how far the run is; `name` is that of its streams.
pub(crate) fn attempt(
    namespaces: &Namespaces,
    surroundings: &Surroundings,
    arguments: &[String],
    (journal, journal_bytes): (&Path, u64),
    name: &str,
) -> Result<Attempt, String> {
    let disk = Disk::new(namespaces.room.join("disk"), surroundings)?;
    let group = surroundings.memory_bytes.map(MemoryGroup::new).transpose()?;

    let mut command = Command::new("sh");
    let mut pipes = Pipes::attach(&mut command, surroundings.streams, &namespaces.room, &disk.folder, name);
    let joins = group.as_ref().map(|group| format!("echo $$ >{}/cgroup.procs; ", group.folder.display()));
    let script = format!("{}exec \"$@\"{}", joins.unwrap_or_default(), pipes.closings());
    command.args(["-c", &script, "sh", "prlimit"]);
    command.args(surroundings.limits.iter().map(Limit::option)).arg(env!("CARGO_BIN_EXE_marti")).args(arguments);
    command.current_dir(&namespaces.room).env_remove("MARTI_LOG");
    if let Some(user) = surroundings.user {
        std::os::unix::process::CommandExt::uid(&mut command, user);
    }
    let mut manager = command.spawn().map_err(|error| format!("sh: {error}"))?;
    // The pipes' other ends are the run's alone.
    drop(command);

    let confirmed = std::mem::take(&mut pipes.confirmed);
    let mut watch = Watch {
        namespaces,
        surroundings,
        disk,
        manager: manager.id(),
        start: Instant::now(),
        stopped: Vec::new(),
        limits_shown: false,
        streams_shown: None,
        abandoned: None,
        attempt: Attempt {
            end: End::Hang,
            done: Vec::new(),
            confirmed,
            killed: false,
            faults: Vec::new(),
            said: String::new(),
            logs: String::new(),
            keeps_errors: pipes.keeps_errors(),
        },
    };
    let mut deeds = surroundings.deeds.clone();
    watch.attempt.done.push(surroundings.outset());
    while watch.attempt.end == End::Hang && watch.start.elapsed() < PATIENCE {
        let share = fs::metadata(journal).map_or(0, |found| found.len() * 100 / journal_bytes);
        pipes.step(watch.start.elapsed());
        watch.step(&mut deeds, share, &pipes);
        sleep(STEP);
        if let Some(status) = manager.try_wait().expect("our own child") {
            watch.attempt.end = status.into();
        }
    }
    Ok(watch.finish(&mut manager, pipes, group))
}

impl Watch<'_> {
    fn step(&mut self, deeds: &mut Vec<(When, Deed)>, share: u64, pipes: &Pipes) {
        let elapsed = self.start.elapsed();
        // No process is disturbed while the shell makes way for the program.
        let begun = Process::find(self.manager).is_some_and(|process| process.name == "marti");
        if !begun {
            return;
        }
        if !self.limits_shown && !self.surroundings.limits.is_empty() {
            self.limits_shown = self.surroundings.limits.iter().all(|limit| limit.is_shown(self.manager));
        }
        if self.streams_shown.is_none() {
            self.streams_shown = pipes.confirm(self.manager);
        }
        deeds.retain(|&(when, deed)| {
            let is_due = match when {
                When::After(time) => elapsed >= time,
                When::Tiles(percent) => share > u64::from(percent),
            };
            if is_due {
                self.attempt.done.push(format!("{:.3} s {deed:?}", elapsed.as_secs_f64()));
                self.carry_out(deed);
            }
            !is_due
        });
        self.stopped.retain(|(process, until)| {
            let stays = until.is_none_or(|until| elapsed < until);
            if !stays {
                process.signal(Signal::SIGCONT);
            }
            stays
        });
        self.disk.step(elapsed);
        self.look_after_abandoned();
    }

    fn carry_out(&mut self, deed: Deed) {
        let elapsed = self.start.elapsed();
        match deed {
            Deed::Fill(time) => self.disk.fill_until(time.map(|time| elapsed + time)),
            Deed::Signal(signal, to) => {
                let targets = self.choose(to);
                targets.iter().for_each(|process| process.signal(signal));
                self.attempt.killed |= to.manager && signal == Signal::SIGKILL;
                // What else a signal does is seen by the exit code.
                if [Signal::SIGKILL, Signal::SIGSEGV].contains(&signal) {
                    self.confirm(&targets, "gone", |pid| Process::find(pid).is_none());
                }
            }
            Deed::Stop(to, time) => {
                let targets = self.choose(to);
                targets.iter().for_each(|process| process.signal(Signal::SIGSTOP));
                let stands = |pid| Process::find(pid).is_some_and(|process| process.state == 'T');
                self.confirm(&targets, "in state T", stands);
                if to.manager && time.is_none() {
                    self.abandoned = Some(Instant::now());
                }
                self.stopped.extend(targets.into_iter().map(|process| (process, time.map(|time| elapsed + time))));
            }
            Deed::Limit(limit, to) => {
                let targets = self.choose(to);
                for pid in targets.iter().filter_map(Process::inner_pid) {
                    // It may have ended just now.
                    let _ = tool("prlimit", &format!("--pid {pid} {}", limit.option()));
                }
                self.limits_shown |= targets.iter().all(|process| limit.is_shown(process.pid));
            }
        }
    }

    fn choose(&self, to: Targets) -> Vec<Process> {
        let is_manager = |process: &Process| process.pid == self.manager;
        let (mut chosen, mut children): (Vec<Process>, Vec<Process>) =
            self.namespaces.processes().into_iter().partition(is_manager);
        // Until a child is its own program, its parent waits for it in the kernel: stopping it stops both.
        children.retain(|process| process.name != "marti");
        if !to.manager {
            chosen.clear();
        }
        let count = children.len();
        let hit = |index: usize| to.children >> (index % 8) & 1 == 1;
        let mut hit: Vec<bool> = (0..count).map(hit).collect();
        if !to.manager && count > 0 && !hit.contains(&true) {
            hit[to.children as usize % count] = true;
        }
        chosen.extend(children.into_iter().zip(hit).filter_map(|(process, hit)| hit.then_some(process)));
        chosen
    }

    /// All of them have to be seen like that.
    fn confirm(&mut self, targets: &[Process], what: &str, is_so: impl Fn(u32) -> bool) {
        let start = Instant::now();
        while !targets.iter().all(|process| is_so(process.pid)) {
            if start.elapsed() > SIGNAL_PATIENCE {
                return;
            }
            sleep(STEP);
        }
        if !targets.is_empty() {
            let names: Vec<&str> = targets.iter().map(|process| process.name.as_str()).collect();
            self.attempt.confirmed.push(format!("{what}: {}", names.join(" ")));
        }
    }

    /// Once the children of a manager that is stopped for ever have ended, it is killed.
    fn look_after_abandoned(&mut self) {
        let Some(since) = self.abandoned else { return };
        let children: Vec<Process> =
            self.namespaces.processes().into_iter().filter(|process| process.pid != self.manager).collect();
        let is_late = since.elapsed() > ORPHAN_PATIENCE;
        if is_late {
            self.attempt.faults.extend(children.iter().map(|child| format!("orphan: {}", child.whereabouts())));
        }
        if is_late || children.is_empty() {
            let seconds = since.elapsed().as_secs_f64();
            self.attempt.done.push(format!("{} children left {seconds:.1} s later, then killed", children.len()));
            self.abandoned = None;
            self.attempt.killed = true;
            self.stopped.iter().for_each(|(process, _)| process.signal(Signal::SIGKILL));
        }
    }

    /// Of a signal other than SIGKILL.
    fn confirm_by_end(&mut self) {
        let asks = |(_, deed): &&(When, Deed)| match deed {
            Deed::Signal(signal, to) if to.manager => {
                let signal = *signal as i32;
                [End::Signal(signal), End::Code(128 + signal)].contains(&self.attempt.end)
            }
            _ => false,
        };
        if self.surroundings.deeds.iter().any(|deed| asks(&deed)) {
            self.attempt.confirmed.push(format!("the manager ended with {:?}", self.attempt.end));
        }
    }

    fn finish(mut self, manager: &mut Child, mut pipes: Pipes, group: Option<MemoryGroup>) -> Attempt {
        self.confirm_by_end();
        if self.attempt.end == End::Hang {
            let stands: Vec<String> = self.namespaces.processes().iter().map(Process::whereabouts).collect();
            self.attempt.faults.push(format!("hang: {}", stands.join(", ")));
            self.namespaces.processes().iter().for_each(|process| process.signal(Signal::SIGKILL));
            manager.wait().expect("our own child");
        }
        // A stopped process cannot end by itself.
        self.stopped.iter().for_each(|(process, _)| process.signal(Signal::SIGCONT));
        for orphan in self.namespaces.left_after(ORPHAN_PATIENCE) {
            self.attempt.faults.push(format!("orphan: {}", orphan.whereabouts()));
            orphan.signal(Signal::SIGKILL);
        }
        self.disk.release();
        self.attempt.confirmed.extend(self.disk.confirmed.take());
        pipes.drain();
        self.attempt.confirmed.extend(group.as_ref().and_then(MemoryGroup::effect));
        if let Some(shown) = self.streams_shown {
            self.attempt.confirmed.push(shown);
        }
        (self.attempt.said, self.attempt.logs) = (pipes.text(), logs(&self.disk.folder));
        let is_there = |refusal: &&str| self.attempt.said.contains(refusal) || self.attempt.logs.contains(refusal);
        let refusals: Vec<&str> = REFUSALS.into_iter().filter(is_there).collect();
        // Limits that nothing meets are confirmed by themselves.
        let is_met = self.attempt.end != End::Code(0) || !refusals.is_empty() || self.surroundings.limits.len() > 1;
        if self.limits_shown && is_met && !self.attempt.could_not_begin() {
            self.attempt.confirmed.push(format!("limit: in /proc/PID/limits; {:?} {refusals:?}", self.attempt.end));
        }
        if self.surroundings.disk_bytes < 2 << 20 && refusals.contains(&"os error 28)") {
            self.attempt.confirmed.push("disk: a write of the run was refused".to_owned());
        }
        self.attempt
    }
}

impl Attempt {
    /// The system has no room to load the program, or its loader has none for the libraries.
    pub(crate) fn could_not_begin(&self) -> bool {
        let by_system = matches!(self.end, End::Signal(9 | 11)) && self.said.is_empty();
        self.end == End::Code(127) || (by_system && !self.killed)
    }

    /// The manager's last word, without which it may not fail.
    pub(crate) fn error(&self) -> &str {
        self.said.lines().find(|line| line.contains("error") || line.contains("failed")).unwrap_or_default()
    }
}

impl Limit {
    fn is_shown(&self, pid: u32) -> bool {
        let label = match self.resource {
            "nofile" => "Max open files",
            "nproc" => "Max processes",
            "fsize" => "Max file size",
            "as" => "Max address space",
            "data" => "Max data size",
            "stack" => "Max stack size",
            "cpu" => "Max cpu time",
            "core" => "Max core file size",
            "memlock" => "Max locked memory",
            "rss" => "Max resident set",
            "locks" => "Max file locks",
            "sigpending" => "Max pending signals",
            "msgqueue" => "Max msgqueue size",
            "nice" => "Max nice priority",
            "rtprio" => "Max realtime priority",
            other => unreachable!("{other} is no resource"),
        };
        let limits = fs::read_to_string(format!("/proc/{pid}/limits")).unwrap_or_default();
        let row = limits.lines().find_map(|line| line.strip_prefix(label));
        row.and_then(|row| row.split_whitespace().next()) == Some(self.value.to_string().as_str())
    }
}

impl From<ExitStatus> for End {
    fn from(status: ExitStatus) -> Self {
        status.code().map_or_else(|| Self::Signal(status.signal().unwrap_or_default()), Self::Code)
    }
}

/// All logs below a folder, but those of earlier attempts.
fn logs(folder: &Path) -> String {
    let Ok(entries) = fs::read_dir(folder) else { return String::new() };
    let text = |path: PathBuf| {
        if path.ends_with("earlier") {
            String::new()
        } else if path.is_dir() {
            logs(&path)
        } else if path.extension().is_some_and(|extension| extension == "log") {
            String::from_utf8_lossy(&fs::read(&path).unwrap_or_default()).into_owned()
        } else {
            String::new()
        }
    };
    entries.flatten().map(|entry| text(entry.path())).collect()
}
