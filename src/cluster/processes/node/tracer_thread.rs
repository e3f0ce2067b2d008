//! The threads that trace: one that owns the local memory and the connection to the bus, or several over a whole database. They wait for
//! nothing else: tiles come and go through bounded queues.

use std::error::Error;
use std::io;
use std::sync::{Arc, Once};
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
use crate::protocol::work::{TileDone, jobs_per_node};
use ground::processor_time;
use ground::pulse::{Beacon, Pulse};
use machine::hardware::specification::MemorySize;
use trace::picture::AovSet;

/// What the threads say.
#[derive(Debug)]
pub enum FromTracer {
    /// The memory is set up; it waits for tiles. `Some`: traces packets.
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
    /// `threads`: instead of as many as the configuration says.
    ///
    /// # Errors
    /// The system has no thread left.
    pub fn start(
        configuration: NodeConfiguration,
        threads: Option<u16>,
        introduction: Introduction,
        pulse: Pulse,
    ) -> io::Result<Self> {
        let jobs_max = jobs_per_node(configuration.threads);
        let threads = threads_of(&configuration, threads, jobs_max);
        let (jobs, job_receiver) = channel::bounded(jobs_max);
        let (sender, said) = mpsc::channel(jobs_max);
        thread::Builder::new().name("tracer".to_owned()).spawn(move || {
            if let Err(error) = trace_all(&configuration, threads, &introduction, &pulse, &job_receiver, &sender) {
                // An error means that the process ends anyway, here as below.
                let _ = sender.blocking_send(FromTracer::Failed(with_causes(&*error)));
            }
        })?;
        Ok(Self { jobs, said })
    }
}

/// A local memory is that of one thread.
fn threads_of(configuration: &NodeConfiguration, asked: Option<u16>, jobs_max: usize) -> u16 {
    let is_whole = configuration.local_memory.size == MemorySize::All;
    match asked {
        Some(threads) if threads > 1 && !is_whole => {
            tracing::warn!(
                "--threads {threads} has no effect: nodes of this run have local memories, which are of one thread"
            );
            1
        }
        Some(threads) => {
            if usize::from(threads) > jobs_max {
                tracing::warn!(
                    "--threads {threads}: this run gives a node {jobs_max} tiles at once; cluster.threads gives it more"
                );
            }
            threads
        }
        None => configuration.threads,
    }
}

fn trace_all(
    configuration: &NodeConfiguration,
    threads: u16,
    introduction: &Introduction,
    pulse: &Pulse,
    jobs: &channel::Receiver<Job>,
    say: &mpsc::Sender<FromTracer>,
) -> Result<(), Box<dyn Error>> {
    let starting = pulse.beacon("tracer");
    starting.turn();
    let bus = BusLines::connect(configuration.cluster, configuration.bus, introduction)?;
    let Role::Node(node) = introduction.hello.role else { return Err("this process is no node".into()) };
    let ready = Once::new();
    memory::with(configuration, (node, introduction.hello.epoch), threads, bus, |memory| {
        let _guard = Panicked(say);
        let beacon = pulse.beacon("tracer");
        ready.call_once(|| {
            let _ = say.blocking_send(FromTracer::Ready(memory.packets()));
            starting.idle();
        });
        if let Err(error) = serve(memory, configuration.aov, &beacon, jobs, say) {
            let _ = say.blocking_send(FromTracer::Failed(with_causes(&*error)));
        }
    })?;
    Ok(())
}

/// Says so where a thread panics: the others would go on without it.
struct Panicked<'a>(&'a mpsc::Sender<FromTracer>);

impl Drop for Panicked<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            let _ = self.0.blocking_send(FromTracer::Failed("a thread of it panicked".to_owned()));
        }
    }
}

/// Traces tile after tile, until there are no more.
fn serve(
    memory: &mut dyn TileMemory,
    aov: AovSet,
    beacon: &Beacon,
    jobs: &channel::Receiver<Job>,
    say: &mpsc::Sender<FromTracer>,
) -> Result<(), Box<dyn Error>> {
    for job in jobs {
        beacon.turn();
        let traced = trace(&job, memory, aov)?;
        beacon.idle();
        if say.blocking_send(FromTracer::Traced(traced)).is_err() {
            break;
        }
    }
    Ok(())
}

fn trace(job: &Job, memory: &mut dyn TileMemory, aov: AovSet) -> Result<Traced, Box<dyn Error>> {
    let start = processor_time::of_this_thread();
    memory.begin(job);
    let (pixels, trace) = memory.trace(job, aov)?;
    let render_cpu_nanoseconds = processor_time::of_this_thread().saturating_sub(start).as_nanos() as u64;
    memory.tell_pixels(job)?;
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
