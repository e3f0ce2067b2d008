//! The thread that traces. It owns the local memory and the connection to the bus, and waits for nothing
//! else: tiles come and go through bounded queues.

use std::error::Error;
use std::io;
use std::sync::Arc;
use std::thread;

use crossbeam_channel as channel;
use tokio::sync::mpsc;

use super::bus_lines::BusLines;
use super::memory;
use super::tile_memory::TileMemory;
use super::tiles::{Job, Traced};
use crate::protocol::connection::Introduction;
use crate::protocol::control::{NodeConfiguration, Packets};
use crate::protocol::hello::Role;
use crate::protocol::work::{JOBS_PER_NODE, TileDone};
use ground::processor_time;
use ground::pulse::{Beacon, Pulse};
use trace::picture::AovSet;

/// What the thread says.
#[derive(Debug)]
pub enum FromTracer {
    /// Its memory is set up; it waits for tiles. `Some`: traces packets.
    Ready(Option<Packets>),
    Traced(Traced),
    /// It ends after this.
    Failed(String),
}

/// The queues of a tracer. It ends after the tile under way when they are dropped.
#[derive(Debug)]
pub struct Tracer {
    /// Has room for as many tiles as a node may hold.
    pub jobs: channel::Sender<Job>,
    pub said: mpsc::Receiver<FromTracer>,
}

impl Tracer {
    /// # Errors
    /// The system has no thread left.
    pub fn start(configuration: NodeConfiguration, introduction: Introduction, pulse: Pulse) -> io::Result<Self> {
        let (jobs, job_receiver) = channel::bounded(JOBS_PER_NODE);
        let (sender, said) = mpsc::channel(JOBS_PER_NODE);
        thread::Builder::new().name("tracer".to_owned()).spawn(move || {
            let beacon = pulse.beacon("tracer");
            if let Err(error) = trace_all(&configuration, &introduction, &beacon, &job_receiver, &sender) {
                // An error means that the process ends anyway, here as below.
                let _ = sender.blocking_send(FromTracer::Failed(with_causes(&*error)));
            }
        })?;
        Ok(Self { jobs, said })
    }
}

fn trace_all(
    configuration: &NodeConfiguration,
    introduction: &Introduction,
    beacon: &Beacon,
    jobs: &channel::Receiver<Job>,
    say: &mpsc::Sender<FromTracer>,
) -> Result<(), Box<dyn Error>> {
    beacon.turn();
    let bus = BusLines::connect(configuration.cluster, configuration.bus, introduction)?;
    let Role::Node(node) = introduction.hello.role else { return Err("this process is no node".into()) };
    memory::with(configuration, (node, introduction.hello.epoch), bus, |memory| {
        let _ = say.blocking_send(FromTracer::Ready(memory.packets()));
        beacon.idle();
        for job in jobs {
            beacon.turn();
            let traced = trace(&job, memory, configuration.aov)?;
            beacon.idle();
            if say.blocking_send(FromTracer::Traced(traced)).is_err() {
                break;
            }
        }
        Ok(())
    })
}

fn trace(job: &Job, memory: &mut dyn TileMemory, aov: AovSet) -> Result<Traced, Box<dyn Error>> {
    let start = processor_time::of_this_thread();
    memory.bus().begin(job.tile, job.attempt);
    let (pixels, trace) = memory.trace(job, aov)?;
    let render_cpu_nanoseconds = processor_time::of_this_thread().saturating_sub(start).as_nanos() as u64;
    memory.bus().tell_pixels(job.rect.pixel_count())?;
    let Job { tile, attempt, permit, .. } = *job;
    let done = TileDone { tile, attempt, trace, memory: memory.take_stats(), render_cpu_nanoseconds };
    Ok(Traced { done: Box::new(done), pixels: Arc::new(pixels), permit })
}

fn with_causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(&format!(": {error}"));
        cause = error.source();
    }
    text
}
