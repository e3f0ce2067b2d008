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
    ($($(#[$doc:meta])* $kind:ident $name:literal => $allowed:pat,)*) => {
        /// One disturbance; its seed decides when, how long, and whom it hits.
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
        pub(crate) enum Kind { $($(#[$doc])* $kind),* }

        impl Kind {
            pub(crate) const ALL: &[Self] = &[$(Self::$kind),*];

            pub(crate) fn name(self) -> &'static str {
                match self { $(Self::$kind => $name),* }
            }

            /// Whether a manager may end like this besides ending well.
            pub(crate) fn allows(self, end: End) -> bool {
                use End::{Code, Signal};
                match self { $(Self::$kind => matches!(end, $allowed)),* }
            }
        }
    };
}

// Codes: 1 failed, 3 tiles are missing, 128 + a signal. Signals: 1 HUP, 2 INT, 3 QUIT, 6 ABRT, 9 KILL, 11 SEGV, 15 TERM, 24 XCPU.
kinds! {
    /// The disk has 4 KiB to 1 MiB from the beginning.
    DiskSmall "disk-small" => Code(1 | 3),
    /// The disk has room for 3 to 24 files.
    DiskFiles "disk-files" => Code(1 | 3),
    /// The disk is filled and emptied one to four times.
    DiskBursts "disk-bursts" => Code(1 | 3),
    /// The disk is filled, and stays full.
    DiskFull "disk-full" => Code(1 | 3),
    /// The disk is filled, and the manager killed then.
    DiskFullKilled "disk-full-killed" => Code(1 | 3) | Signal(9),
    /// Some of the standard streams are closed.
    StreamsClosed "streams-closed" => Code(0),
    /// Standard output, error or both are /dev/full.
    StreamsFull "streams-full" => Code(1),
    /// Standard output, error or both are pipes whose reader goes, at once or later.
    StreamsBroken "streams-broken" => Code(0),
    /// Standard output, error or both are full pipes, which are read after seconds, and slowly.
    StreamsSlow "streams-slow" => Code(0),
    /// Few open files, for all from the beginning or for some later.
    LimitFiles "limit-nofile" => Code(1 | 3),
    /// Few processes and threads, by a user of its own.
    LimitProcesses "limit-nproc" => Code(1 | 3),
    /// Small files, for all from the beginning or for some later.
    LimitFileSize "limit-fsize" => Code(1 | 3),
    /// A small address space, for all from the beginning or for some later.
    LimitAddresses "limit-as" => Code(1 | 3) | Signal(6),
    /// Little data, for all from the beginning or for some later.
    LimitData "limit-data" => Code(1 | 3) | Signal(6),
    /// A small stack.
    LimitStack "limit-stack" => Code(1 | 3) | Signal(6 | 11),
    /// A second of processor time each.
    LimitProcessor "limit-cpu" => Code(1 | 3) | Signal(9 | 24),
    /// Everything else that can be limited: locked memory, core files (with a node that crashes), resident memory, locks,
    /// pending signals, message queues, priorities; none of them matters to the program.
    LimitRest "limit-rest" => Code(0),
    /// Some children are stopped, and go on later, once or twice.
    StopChildren "stop-children" => Code(0),
    /// Some children are stopped for ever.
    StopForEver "stop-for-ever" => Code(0),
    /// The manager, and perhaps some children, are stopped, and go on later.
    StopManager "stop-manager" => Code(1 | 3),
    /// The manager is stopped for ever: its children have to end by themselves.
    StopManagerForEver "stop-manager-for-ever" => Signal(9),
    /// Some children are killed, once or twice.
    KillChildren "kill-children" => Code(0),
    /// The manager and perhaps some children are killed.
    KillManager "kill-manager" => Signal(9),
    /// The manager gets SIGINT, SIGTERM, SIGHUP or SIGQUIT, up to twice.
    Interrupt "interrupt" => Code(129 | 130 | 131 | 143) | Signal(1 | 2 | 3 | 15),
    /// A control group with little memory, whose processes the kernel kills.
    Memory "memory" => Code(1 | 3) | Signal(6 | 9),
    /// Two or three of the above together.
    Mixed "mixed" => Code(1 | 3 | 129 | 130 | 131 | 143) | Signal(1 | 2 | 3 | 9 | 15),
}
