//! What deciding costs on the host. The simulation itself has no clock.

use std::time::Duration;

/// Time on the host.
pub type Clock = fn() -> Duration;

#[derive(Debug)]
pub(super) struct Stopwatch {
    clock: Option<Clock>,
    pub(super) spent: Duration,
    pub(super) events: u64,
}

impl Stopwatch {
    pub(super) fn new(clock: Option<Clock>) -> Self {
        Self { clock, spent: Duration::ZERO, events: 0 }
    }

    pub(super) fn time<T>(&mut self, decide: impl FnOnce() -> T) -> T {
        self.events += 1;
        let Some(clock) = self.clock else { return decide() };
        let start = clock();
        let decided = decide();
        self.spent += clock().saturating_sub(start);
        decided
    }
}
