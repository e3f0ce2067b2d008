//! The processes of a run as the host sees them, by /proc.

use std::collections::HashSet;
use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Name and pid of the living children of a process, once there are at least `count` or after `patience`.
pub(crate) fn children(parent: u32, count: usize, patience: Duration) -> Vec<(String, u32)> {
    let start = Instant::now();
    loop {
        let found = children_now(parent);
        if found.len() >= count || start.elapsed() >= patience {
            return found;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn children_now(parent: u32) -> Vec<(String, u32)> {
    let pids = fs::read_dir("/proc")
        .expect("Linux has /proc")
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse::<u32>().ok());
    let mut found: Vec<(String, u32)> = pids
        .filter_map(|pid| {
            // "pid (name) state ppid …"
            let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
            let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
            let mut fields = rest.split_whitespace();
            let (state, ppid) = (fields.next()?, fields.next()?);
            // Until it has given itself the name of its role it has that of the program.
            (ppid == parent.to_string() && state != "Z" && name != "marti").then(|| (name.to_owned(), pid))
        })
        .collect();
    found.sort();
    found
}

/// Whether a process lives; a zombie does not.
pub(crate) fn lives(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|stat| stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z')))
}

/// The IPv4 ports that a process listens on.
pub(crate) fn listening_ports(pid: u32) -> Vec<u16> {
    let descriptors = fs::read_dir(format!("/proc/{pid}/fd")).expect("a process of ours");
    let sockets: HashSet<String> = descriptors
        .filter_map(|entry| Some(fs::read_link(entry.ok()?.path()).ok()?.to_string_lossy().into_owned()))
        .filter_map(|link| Some(link.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned()))
        .collect();
    let table = fs::read_to_string("/proc/net/tcp").expect("Linux has /proc/net/tcp");
    let listening = table.lines().skip(1).filter_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let ours = fields[3] == "0A" && sockets.contains(fields[9]);
        ours.then(|| u16::from_str_radix(fields[1].split_once(':').expect("address:port").1, 16).expect("a port"))
    });
    listening.collect()
}

/// Most memory that a process ever had in use.
pub(crate) fn peak_memory_kib(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("a process of ours");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("a line of peak memory");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

pub(crate) fn signal(pid: u32, signal: Signal) {
    kill(Pid::from_raw(i32::try_from(pid).expect("a pid")), signal).expect("a process of ours can be signalled");
}

/// Ends a manager and all its children by SIGINT, within ten seconds.
pub(crate) fn end(manager: &mut Child) -> Option<i32> {
    signal(manager.id(), Signal::SIGINT);
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(10) {
        if let Some(status) = manager.try_wait().expect("our own child") {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    signal(manager.id(), Signal::SIGKILL);
    panic!("the manager did not end within ten seconds of SIGINT");
}
