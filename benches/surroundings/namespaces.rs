//! Namespaces of its own for a trial: mounts, processes, network.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nix::mount::{MsFlags, mount};
use nix::sched::{CloneFlags, unshare};
use nix::sys::signal::{Signal, kill};
use nix::sys::stat::{Mode, SFlag, makedev, mknod};
use nix::unistd::Pid;

use crate::machine::DEVICES;

/// A thread that has entered it cannot leave, nor start threads. What it starts lives in the namespaces; it sees their
/// files as they do, and all processes of the machine. Everything in it ends when it is dropped, or when this process
/// ends in whichever way.
pub(crate) struct Namespaces {
    /// 512 MB that vanish with it.
    pub(crate) room: PathBuf,
    /// The first process of the namespace: it waits for the end of its standard input, and the others end with it.
    keeper: Child,
    namespace: PathBuf,
}

/// One of its processes, which is no zombie.
pub(crate) struct Process {
    pub(crate) pid: u32,
    pub(crate) name: String,
    pub(crate) state: char,
}

impl Namespaces {
    /// Enters new namespaces with this thread; `room` is an empty folder.
    ///
    /// # Errors
    /// They cannot be had here, and why.
    pub(crate) fn enter(room: &Path) -> Result<Self, String> {
        let failed = |what: &'static str| move |error: nix::Error| format!("{what}: {error} (root is needed)");
        unshare(CloneFlags::CLONE_NEWNS | CloneFlags::CLONE_NEWPID | CloneFlags::CLONE_NEWNET)
            .map_err(failed("new namespaces"))?;
        let nothing = None::<&str>;
        mount(nothing, "/", nothing, MsFlags::MS_REC | MsFlags::MS_PRIVATE, nothing)
            .map_err(failed("private mounts"))?;
        mount_memory(room, "size=512m,mode=1777")?;
        // Whatever replaces a device replaces one of these.
        mount_memory(Path::new("/dev"), "size=64k,mode=755")?;
        for (name, major, minor) in DEVICES {
            let path = format!("/dev/{name}");
            mknod(path.as_str(), SFlag::S_IFCHR, Mode::empty(), makedev(major, minor)).map_err(failed("a device"))?;
            let mode = std::os::unix::fs::PermissionsExt::from_mode(0o666);
            fs::set_permissions(path, mode).map_err(|error| error.to_string())?;
        }
        let mut keeper = Command::new("cat");
        let keeper =
            keeper.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().map_err(|error| format!("cat: {error}"))?;
        let namespace = namespace_of(keeper.id()).ok_or("/proc tells no namespaces")?;
        let namespaces = Self { room: room.to_owned(), keeper, namespace };
        tool("ip", "link set lo up")?;
        Ok(namespaces)
    }

    /// Those that live, or are stopped.
    pub(crate) fn processes(&self) -> Vec<Process> {
        let entries = fs::read_dir("/proc").expect("Linux has /proc").flatten();
        let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        let ours = pids.filter(|&pid| pid != self.keeper.id() && namespace_of(pid).as_ref() == Some(&self.namespace));
        let mut found: Vec<Process> = ours.filter_map(Process::find).collect();
        found.sort_by(|a, b| (&a.name, a.pid).cmp(&(&b.name, b.pid)));
        found
    }

    /// Those that are left when `patience` has passed, or none.
    pub(crate) fn left_after(&self, patience: Duration) -> Vec<Process> {
        let start = Instant::now();
        loop {
            let left = self.processes();
            if left.is_empty() || start.elapsed() >= patience {
                return left;
            }
            sleep(Duration::from_millis(20));
        }
    }
}

impl Process {
    /// `None`: it is gone, or a zombie.
    pub(crate) fn find(pid: u32) -> Option<Self> {
        // "pid (name) state ppid …"
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
        let state = rest.trim_start().chars().next()?;
        (!['Z', 'X'].contains(&state)).then(|| Self { pid, name: name.to_owned(), state })
    }

    pub(crate) fn signal(&self, signal: Signal) {
        // It may have ended just now.
        let _ = kill(Pid::from_raw(self.pid as i32), signal);
    }

    /// As the tools that run in the namespaces know it.
    pub(crate) fn inner_pid(&self) -> Option<u32> {
        let status = fs::read_to_string(format!("/proc/{}/status", self.pid)).ok()?;
        let pids = status.lines().find_map(|line| line.strip_prefix("NSpid:"))?;
        pids.split_whitespace().next_back()?.parse().ok()
    }

    /// For a look into a hang.
    pub(crate) fn whereabouts(&self) -> String {
        let waits = fs::read_to_string(format!("/proc/{}/wchan", self.pid)).unwrap_or_default();
        format!("{} in state {} ({waits})", self.name, self.state)
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        drop(self.keeper.stdin.take());
        // It ends when all others have, and a process that was not waited for does not.
        if !std::thread::panicking() {
            let _ = self.keeper.wait();
        }
    }
}

/// A file system in memory.
pub(crate) fn mount_memory(at: &Path, options: &str) -> Result<(), String> {
    let flags = MsFlags::empty();
    mount(Some("none"), at, Some("tmpfs"), flags, Some(options)).map_err(|error| format!("{}: {error}", at.display()))
}

/// Runs a system's tool; its arguments have no blanks.
pub(crate) fn tool(program: &str, arguments: &str) -> Result<(), String> {
    let mut command = Command::new(program);
    let output = command.args(arguments.split(' ')).output().map_err(|error| format!("{program}: {error}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if output.status.success() { Ok(()) } else { Err(format!("{program} {arguments}: {}", said.trim())) }
}

fn namespace_of(pid: u32) -> Option<PathBuf> {
    fs::read_link(format!("/proc/{pid}/ns/pid")).ok()
}
