//! Processor time of threads.

use std::time::Duration;

use nix::time::{ClockId, clock_gettime};

/// Of the calling thread; zero where the host has no such clock.
pub fn of_this_thread() -> Duration {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map(Duration::from).unwrap_or_default()
}
