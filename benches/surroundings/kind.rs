//! What a run is put through.

/// How a process ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum End {
    Code(i32),
    Signal(i32),
    /// It did not, and was killed.
    Hang,
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident $name:literal [$($seen:literal),*] => $allowed:pat,)*) => {
        /// One disturbance; its seed decides when, how long, and whom it hits.
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
        pub(crate) enum Kind { $($(#[$doc])* $kind),* }

        impl Kind {
            pub(crate) const ALL: &[Self] = &[$(Self::$kind),*];

            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$kind => $name),* }
            }

            /// Whether what was seen from outside is what must be seen of it.
            pub(crate) fn took_effect(self, confirmed: &[String]) -> bool {
                let must: &[&str] = match self { $(Self::$kind => &[$($seen),*]),* };
                let is_seen = |must: &&str| confirmed.iter().any(|seen| seen.starts_with(must));
                // Of a mixture two parts.
                must.iter().all(is_seen) && confirmed.len() >= if must.is_empty() { 2 } else { 1 }
            }

            /// Whether a manager may end like this besides ending well.
            pub(crate) fn allows(self, end: End) -> bool {
                use End::{Code, Signal};
                match self { $(Self::$kind => matches!(end, $allowed)),* }
            }
        }
    };
}

// Kind, name, [what must be seen] => how the manager may end.
// Codes: 1 failed, 3 tiles are missing, 128 + a signal. Signals: 1 HUP, 2 INT, 3 QUIT, 6 ABRT, 9 KILL, 11 SEGV, 15 TERM, 24 XCPU.
kinds! {
    /// The disk has 4 KiB to 1 MiB from the beginning.
    DiskSmall "disk-small" ["disk"] => Code(1 | 3),
    /// The disk has room for 3 to 24 files.
    DiskFiles "disk-files" ["disk"] => Code(1 | 3),
    /// The disk is filled and emptied one to four times.
    DiskBursts "disk-bursts" ["disk"] => Code(1 | 3),
    /// The disk is filled, and stays full.
    DiskFull "disk-full" ["disk"] => Code(1 | 3),
    /// The disk is filled, and the manager killed then.
    DiskFullKilled "disk-full-killed" ["disk", "the manager"] => Code(1 | 3) | Signal(9),
    /// Some of the standard streams are closed.
    StreamsClosed "streams-closed" ["stream"] => Code(0),
    /// Standard output, error or both are /dev/full.
    StreamsFull "streams-full" ["stream"] => Code(1),
    /// Standard output, error or both are pipes whose reader goes, at once or later.
    StreamsBroken "streams-broken" ["stream"] => Code(0),
    /// Standard output, error or both are full pipes, which are read after seconds, and slowly.
    StreamsSlow "streams-slow" ["stream"] => Code(0),
    /// Few open files, for all from the beginning or for some later.
    LimitFiles "limit-nofile" ["limit"] => Code(1 | 3),
    /// Few processes and threads, by a user of its own.
    LimitProcesses "limit-nproc" ["limit"] => Code(1 | 3),
    /// Small files, for all from the beginning or for some later.
    LimitFileSize "limit-fsize" ["limit"] => Code(1 | 3),
    /// A small address space, for all from the beginning or for some later.
    LimitAddresses "limit-as" ["limit"] => Code(1 | 3) | Signal(6),
    /// Little data, for all from the beginning or for some later.
    LimitData "limit-data" ["limit"] => Code(1 | 3) | Signal(6),
    /// A small stack.
    LimitStack "limit-stack" ["limit"] => Code(1 | 3) | Signal(6 | 11),
    /// A second of processor time each.
    LimitProcessor "limit-cpu" ["limit"] => Code(1 | 3) | Signal(9 | 24),
    /// Everything else that can be limited: locked memory, core files (with a node that crashes), resident memory, locks,
    /// pending signals, message queues, priorities; none of them matters to the program.
    LimitRest "limit-rest" ["limit"] => Code(0),
    /// Some children are stopped, and go on later, once or twice.
    StopChildren "stop-children" ["in state T"] => Code(0),
    /// Some children are stopped for ever.
    StopForEver "stop-for-ever" ["in state T"] => Code(0),
    /// The manager, and perhaps some children, are stopped, and go on later.
    StopManager "stop-manager" ["in state T"] => Code(1 | 3),
    /// The manager is stopped for ever: its children have to end by themselves.
    StopManagerForEver "stop-manager-for-ever" ["in state T"] => Signal(9),
    /// Some children are killed, once or twice.
    KillChildren "kill-children" ["gone"] => Code(0),
    /// The manager and perhaps some children are killed.
    KillManager "kill-manager" ["the manager"] => Signal(9),
    /// The manager gets SIGINT, SIGTERM, SIGHUP or SIGQUIT, up to twice.
    Interrupt "interrupt" ["the manager"] => Code(129 | 130 | 131 | 143) | Signal(1 | 2 | 3 | 15),
    /// A control group with little memory, whose processes the kernel kills.
    Memory "memory" ["memory"] => Code(1 | 3) | Signal(6 | 9),
    /// Two or three of the above together.
    Mixed "mixed" [] => Code(1 | 3 | 129 | 130 | 131 | 143) | Signal(1 | 2 | 3 | 9 | 15),
}
