//! What a node does with a tile that it is handed, and what it reports to the master of one that is done.

use std::process;

use cluster::processes::node::tiles::Job;
use cluster::protocol::mac::Mac;
use cluster::protocol::work::TileDone;
use ground::ids::{Attempt, TileId};
use tokio::time::Instant;

use super::mode::Mode;
use super::node::Node;
use super::{Outcome, deed};

impl Node {
    /// The master hands out a tile.
    pub(crate) fn take(&mut self, mode: Mode, job: Job) -> Outcome {
        self.since.insert(job.tile, Instant::now());
        match mode {
            Mode::Hoard => {
                deed(format_args!("hoards {}", job.tile));
                Ok(())
            }
            Mode::DieHolding => {
                deed(format_args!("dies of {}", job.tile));
                process::exit(1)
            }
            _ => Ok(self.tracer.jobs.try_send(job)?),
        }
    }

    /// The display has a tile.
    pub(crate) async fn acknowledged(
        &mut self,
        mode: Mode,
        (tile, attempt): (TileId, Attempt),
        receipt: Mac,
    ) -> Outcome {
        let is_it = |done: &TileDone| (done.tile, done.attempt) == (tile, attempt);
        // Some modes send more than they await an answer to.
        let Some(place) = self.traced.iter().position(|traced| is_it(&traced.done)) else { return Ok(()) };
        if mode == Mode::GreyHeld && std::mem::replace(&mut self.has_told, true) {
            return Ok(());
        }
        let mut done = self.traced.remove(place).done;
        forge(mode, &mut done);
        self.tell_done(&done, receipt).await?;
        match mode {
            Mode::OtherTile => {
                for withheld in std::mem::take(&mut self.withheld) {
                    deed(format_args!("tells {} done by {tile}", withheld.done.tile));
                    self.tell_done(&withheld.done, receipt).await?;
                    self.ask().await?;
                }
            }
            Mode::DoneTwice => {
                deed(format_args!("tells {tile} done twice"));
                self.tell_done(&done, receipt).await?;
            }
            Mode::Mortal => {
                deed(format_args!("dies after {tile}"));
                process::exit(1)
            }
            Mode::Lazy => {
                deed("asks for no more");
                return Ok(());
            }
            _ => {}
        }
        self.ask().await
    }
}

/// Counters that were not counted.
fn forge(mode: Mode, done: &mut TileDone) {
    let counters = done.memory.as_mut().and_then(|memory| memory.counters.as_flattened_mut().first_mut());
    match (mode, counters) {
        (Mode::MaxCounters, counters) => {
            done.trace.rays.fill(u64::MAX);
            done.trace.octree_accesses.fill(u64::MAX);
            done.render_cpu_nanoseconds = u64::MAX;
            if let Some(counters) = counters {
                (counters.record_accesses, counters.record_misses) = (u64::MAX, u64::MAX);
                (counters.line_accesses, counters.line_misses) = (u64::MAX, u64::MAX);
            }
        }
        (Mode::MoreMisses, Some(counters)) => {
            (counters.record_accesses, counters.record_misses) = (0, counters.record_misses + 1);
        }
        (Mode::WrongRays, _) => done.trace.rays[0] += 1,
        (Mode::WrongHits, Some(counters)) => {
            counters.record_accesses += 1;
            counters.line_accesses += 1;
        }
        _ => return,
    }
    deed(format_args!("tells other counts of {}", done.tile));
}
