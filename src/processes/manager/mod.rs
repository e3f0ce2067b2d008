//! stub
mod job_queue;
mod tile_order;
#[cfg(test)]
mod sample {
    use std::time::Duration;

    use crate::topology::{Assignment, Deadlines, Run, TileOrder};

    pub(super) fn run() -> Run {
        let deadlines = Deadlines {
            startup: Duration::from_secs(10),
            heartbeat: Duration::from_secs(5),
            tile: Duration::from_secs(60),
        };
        Run { order: TileOrder::Scanline, assignment: Assignment::OnDemand, seed: 1, deadlines }
    }
}
