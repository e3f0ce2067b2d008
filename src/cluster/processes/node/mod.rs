//! A processing node: asks the master for tiles, traces them through its local memory, sends the pixels to
//! the display, and reports to the master when they have arrived.

pub mod bus_lines;
mod corruption;
pub mod memory;
mod simulated_memory;
pub mod state;
pub mod tile_memory;
pub mod tiles;
pub mod tracer_thread;
pub mod whole_database;

use std::sync::Arc;

pub use bus_lines::BusLines;

use self::state::{Answer, State, Task};
use self::tracer_thread::{FromTracer, Tracer};
use super::Child;
use super::driver::live::{self, ProcessError, Worker};

/// Works until the manager says that it is over, or SIGTERM that it is to go. `threads`: instead of as many as the topology says.
///
/// # Errors
/// Anything that keeps this node from going on; it was reported to the manager.
pub fn run(child: &Child, threads: Option<u16>) -> Result<(), ProcessError> {
    live::run(child, State::new(child.bootstrap.role), TracerWorker { child, threads, tracer: None }, Arc::default())
}

/// The threads that trace, once the state is configured.
struct TracerWorker<'a> {
    child: &'a Child,
    threads: Option<u16>,
    tracer: Option<Tracer>,
}

impl Worker<State> for TracerWorker<'_> {
    fn begin(&mut self, task: Task) -> Result<Option<Answer>, String> {
        match (task, &self.tracer) {
            (Task::Start(configuration), _) => {
                let (introduction, pulse) = (self.child.introduction(), self.child.pulse.clone());
                let tracer = Tracer::start(*configuration, self.threads, introduction, pulse);
                self.tracer = Some(tracer.map_err(|error| error.to_string())?);
            }
            // There is room: no more tiles are asked for than the queue takes.
            (Task::Trace(job), Some(tracer)) => tracer.jobs.try_send(job).map_err(|error| error.to_string())?,
            (Task::Trace(_), None) => {}
        }
        Ok(None)
    }

    async fn answer(&mut self) -> Answer {
        let Some(tracer) = &mut self.tracer else { return std::future::pending().await };
        match tracer.said.recv().await {
            Some(FromTracer::Ready(packets)) => Answer::Ready(packets),
            Some(FromTracer::Traced(traced)) => Answer::Traced(traced),
            Some(FromTracer::Failed(why)) => Answer::Failed(why),
            None => Answer::Failed("its thread ended".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests;
