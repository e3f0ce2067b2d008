//! What one process and its children run in, and what happens to them there.

use std::time::Duration;

use nix::sys::signal::Signal;

use crate::kind::Kind;
use crate::random::Random;

/// Enough for every trial.
const DISK_BYTES: u64 = 200 << 20;
/// For a disk that is to be filled.
const SMALL_DISK_BYTES: u64 = 48 << 20;

#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    /// Of the file system that has the output folder.
    pub(crate) disk_bytes: u64,
    pub(crate) disk_files: Option<u64>,
    /// Standard input, output, error.
    pub(crate) streams: [Stream; 3],
    /// From the beginning.
    pub(crate) limits: Vec<Limit>,
    /// Another than root.
    pub(crate) user: Option<u32>,
    /// Of a control group.
    pub(crate) memory_bytes: Option<u64>,
    pub(crate) deeds: Vec<(When, Deed)>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Stream {
    /// A file, of which standard input has nothing.
    File,
    /// A file beside the output folder.
    OnDisk,
    Closed,
    /// /dev/full
    Full,
    /// A pipe whose reader goes after so long.
    Broken(Duration),
    /// A pipe that is full from the beginning, and is read after so long.
    Slow(Duration),
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// As `prlimit` names it.
    pub(crate) resource: &'static str,
    pub(crate) value: u64,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum When {
    After(Duration),
    /// So many of a hundred tiles are in the journal.
    Tiles(u32),
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Deed {
    /// `None`: until the run has ended.
    Fill(Option<Duration>),
    Signal(Signal, Targets),
    /// `None`: for ever.
    Stop(Targets, Option<Duration>),
    Limit(Limit, Targets),
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Targets {
    pub(crate) manager: bool,
    /// A bit a child, in the order of their names; at least one if the manager is none.
    pub(crate) children: u32,
}

impl Surroundings {
    /// Without any disturbance.
    pub(crate) fn calm() -> Self {
        Self {
            disk_bytes: DISK_BYTES,
            disk_files: None,
            streams: [Stream::File; 3],
            limits: Vec::new(),
            user: None,
            memory_bytes: None,
            deeds: Vec::new(),
        }
    }

    /// All but the deeds, as in a row.
    pub(crate) fn outset(&self) -> String {
        let Self { disk_bytes, disk_files, streams, limits, user, memory_bytes, deeds: _ } = self;
        let limits: Vec<String> = limits.iter().map(Limit::option).collect();
        let streams = if *streams == [Stream::File; 3] { String::new() } else { format!("{streams:?}") };
        let given = [("files", disk_files), ("memory", memory_bytes)].into_iter();
        let given = given.filter_map(|(what, number)| number.map(|number| format!(" {what} {number}")));
        let user = user.map_or_else(String::new, |user| format!(" user {user}"));
        format!("disk {disk_bytes}{}{user} {streams} {}", given.collect::<String>(), limits.join(" "))
    }

    pub(crate) fn new(kind: Kind, random: &mut Random) -> Self {
        let mut new = Self::calm();
        new.disturb(kind, random);
        new
    }

    fn disturb(&mut self, kind: Kind, random: &mut Random) {
        match kind {
            Kind::DiskSmall => self.disk_bytes = random.between(4 << 10, 1 << 20),
            Kind::DiskFiles => self.disk_files = Some(3 + u64::from(random.below(22))),
            Kind::DiskBursts => {
                for _ in 0..1 + random.below(4) {
                    let time = Duration::from_millis(random.between(20, 3000));
                    self.fill(Some(time), random);
                }
            }
            Kind::DiskFull => self.fill(None, random),
            Kind::DiskFullKilled => {
                let when = self.when(random);
                self.disk_bytes = SMALL_DISK_BYTES;
                self.deeds.push((when, Deed::Fill(None)));
                self.deeds.push((when, Deed::Signal(Signal::SIGKILL, Targets::manager(random))));
            }
            Kind::StreamsClosed => self.set_streams(0, random, |_| Stream::Closed),
            Kind::StreamsFull => self.set_streams(1, random, |_| Stream::Full),
            Kind::StreamsBroken => self.set_streams(1, random, |random| {
                let late = Duration::from_millis(random.between(10, 1000));
                Stream::Broken(if random.once_in(2) { Duration::ZERO } else { late })
            }),
            Kind::StreamsSlow => {
                self.set_streams(1, random, |random| Stream::Slow(Duration::from_millis(random.between(500, 5000))));
            }
            Kind::LimitFiles => self.limit("nofile", (3, 40), random),
            Kind::LimitProcesses => {
                // No other processes count.
                self.user = Some(50_000 + random.below(10_000));
                self.limits.push(Limit { resource: "nproc", value: random.between(1, 20) });
            }
            Kind::LimitFileSize => self.limit("fsize", (1 << 9, 400 << 10), random),
            Kind::LimitAddresses => self.limit("as", (8 << 20, 24 << 20), random),
            Kind::LimitData => self.limit("data", (512 << 10, 12 << 20), random),
            Kind::LimitStack => {
                self.limits.push(Limit { resource: "stack", value: random.between(8 << 10, 256 << 10) });
            }
            Kind::LimitProcessor => self.limits.push(Limit { resource: "cpu", value: 1 }),
            Kind::LimitRest => {
                let rest = ["core", "memlock", "rss", "locks", "sigpending", "msgqueue", "nice", "rtprio"];
                self.limits.extend(rest.map(|resource| Limit { resource, value: 0 }));
                let crash = Deed::Signal(Signal::SIGSEGV, Targets { manager: false, children: 1 << random.below(5) });
                self.deeds.push((self.when(random), crash));
            }
            Kind::StopChildren => {
                for _ in 0..1 + random.below(2) {
                    let time = Duration::from_millis(random.between(50, 4000));
                    self.deeds.push((self.when(random), Deed::Stop(Targets::children(random), Some(time))));
                }
            }
            Kind::StopForEver => self.deeds.push((self.when(random), Deed::Stop(Targets::children(random), None))),
            Kind::StopManager => {
                let time = Duration::from_millis(random.between(50, 8000));
                self.deeds.push((self.when(random), Deed::Stop(Targets::manager(random), Some(time))));
            }
            Kind::StopManagerForEver => {
                let alone = Targets { manager: true, children: 0 };
                self.deeds.push((self.when(random), Deed::Stop(alone, None)));
            }
            Kind::KillChildren => {
                for _ in 0..1 + random.below(2) {
                    self.deeds.push((self.when(random), Deed::Signal(Signal::SIGKILL, Targets::children(random))));
                }
            }
            Kind::KillManager => {
                self.deeds.push((self.when(random), Deed::Signal(Signal::SIGKILL, Targets::manager(random))));
            }
            Kind::Interrupt => {
                let signals = [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP, Signal::SIGQUIT];
                let (when, alone) = (self.when(random), Targets { manager: true, children: 0 });
                for _ in 0..1 + random.below(2) {
                    self.deeds.push((when, Deed::Signal(random.pick(&signals), alone)));
                }
            }
            Kind::Memory => self.memory_bytes = Some(random.between(4 << 20, 24 << 20)),
            Kind::Mixed => {
                for part in Self::parts(random) {
                    self.disturb(part, random);
                }
            }
        }
    }

    /// Which kinds are mixed.
    fn parts(random: &mut Random) -> Vec<Kind> {
        let kinds = [
            Kind::DiskBursts,
            Kind::DiskBursts,
            Kind::DiskFull,
            Kind::StreamsFull,
            Kind::StreamsBroken,
            Kind::LimitFiles,
            Kind::LimitFileSize,
            Kind::StopChildren,
            Kind::StopForEver,
            Kind::StopManager,
            Kind::KillChildren,
            Kind::KillManager,
            Kind::Interrupt,
        ];
        (0..2 + random.below(2)).map(|_| random.pick(&kinds)).collect()
    }

    /// In a third of the cases errors go to the same disk.
    fn fill(&mut self, time: Option<Duration>, random: &mut Random) {
        self.disk_bytes = SMALL_DISK_BYTES;
        self.deeds.push((self.when(random), Deed::Fill(time)));
        if random.once_in(3) {
            self.streams[2] = Stream::OnDisk;
        }
    }

    /// Some of the streams from `first`, at least one.
    fn set_streams(&mut self, first: usize, random: &mut Random, new: impl Fn(&mut Random) -> Stream) {
        let chosen = 1 + random.below((1 << (3 - first)) - 1);
        for (bit, stream) in self.streams[first..].iter_mut().enumerate() {
            if chosen >> bit & 1 == 1 {
                *stream = new(random);
            }
        }
    }

    fn limit(&mut self, resource: &'static str, (low, high): (u64, u64), random: &mut Random) {
        let limit = Limit { resource, value: random.between(low, high) };
        if random.once_in(2) {
            return self.limits.push(limit);
        }
        let when = self.when(random);
        let targets = if random.once_in(3) { Targets::children(random) } else { Targets::manager(random) };
        self.deeds.push((when, Deed::Limit(limit, targets)));
        // A process that has all that it needs takes no more, but for a successor of another.
        self.deeds.push((when, Deed::Signal(Signal::SIGKILL, Targets::children(random))));
    }

    /// While processes start, or while they render.
    fn when(&self, random: &mut Random) -> When {
        match random.below(3) {
            0 => When::After(Duration::from_millis(u64::from(random.below(150)))),
            _ => When::Tiles(random.below(85)),
        }
    }
}

impl Limit {
    /// `prlimit`'s; processor time has the soft limit first.
    pub(crate) fn option(&self) -> String {
        let hard = if self.resource == "cpu" { self.value + 1 } else { self.value };
        format!("--{}={}:{hard}", self.resource, self.value)
    }
}

impl Targets {
    fn children(random: &mut Random) -> Self {
        Self { manager: false, children: 1 + random.below(254) }
    }

    fn manager(random: &mut Random) -> Self {
        let children = if random.once_in(2) { 0 } else { random.below(255) };
        Self { manager: true, children }
    }
}
