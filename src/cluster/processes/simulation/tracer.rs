//! A node's tracer in virtual time: tiles are traced through a real local memory over a copy of the database, at once; what it
//! fetched is then asked of the bus, one request after the other, and what comes is compared with the copy.

use std::collections::{HashMap, VecDeque};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use super::dice::hash;
use super::host::{Context, Worker};
use super::network::{Message, Parcel, Timer, Wire};
use crate::processes::node::state::{Answer, State, Task};
use crate::processes::node::tiles::{Job, Traced};
use crate::protocol::control::{NodeConfiguration, Packets};
use crate::protocol::frame::{self, PREFIX_BYTES};
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use crate::protocol::work::TileDone;
use ground::ids::{Address, Attempt, TileId};
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::local_memory::{Geometry, LineSource, LocalMemory};
use machine::hardware::replacement::Lru;
use machine::hardware::specification::MemorySize;
use machine::hardware::stats::MemoryStats;
use machine::hardware::transaction::{FetchRequest, PIXEL_BYTES};
use trace::database::verify::Verified;
use trace::tracer::simd::Simd;
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, TraceStats};

/// For the bus to answer the hello.
const BUS_DEADLINE: Duration = Duration::from_secs(10);

pub(super) struct Tracer {
    /// What the bus is to answer is known here.
    database: Verified,
    configuration: Option<Box<NodeConfiguration>>,
    bus: Option<Wire>,
    bus_reached: bool,
    /// `None`: all of the database.
    local: Option<LocalMemory<Lru, Copied>>,
    jobs: VecDeque<Job>,
    under_way: Option<UnderWay>,
    /// What was counted of each attempt.
    pub(super) counted: HashMap<(TileId, Attempt), Counts>,
}

/// What a tracer and its local memory count.
pub(super) type Counts = (TraceStats, Option<MemoryStats>);

struct UnderWay {
    /// `None`: the database is pulled.
    traced: Option<Traced>,
    /// With what the bus must answer.
    requests: VecDeque<(MemoryRequest, Vec<u8>)>,
}

/// A copy of the database that writes down what is fetched from it.
struct Copied {
    memory: ClusterMemory,
    fetched: Vec<(FetchRequest, Vec<u8>)>,
}

impl LineSource for Copied {
    type Error = Infallible;

    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), Infallible> {
        let mut data = Vec::new();
        // A local memory asks for lines of the layout alone.
        let _ = self.memory.gather(request, &mut data);
        into.copy_from_slice(&data);
        self.fetched.push((*request, data));
        Ok(())
    }
}

/// Some tiles take ten times as long as most.
fn takes(tile: TileId) -> Duration {
    let chance = hash(u64::from(tile.0), 7);
    let usual = Duration::from_micros(5_000 + chance % 45_000);
    if chance >> 32 & 15 == 0 { 10 * usual } else { usual }
}

impl Tracer {
    pub(super) fn new(database: Verified) -> Self {
        Self {
            database,
            configuration: None,
            bus: None,
            bus_reached: false,
            local: None,
            jobs: VecDeque::new(),
            under_way: None,
            counted: Default::default(),
        }
    }

    fn start(&mut self, configuration: Box<NodeConfiguration>) -> Result<(), String> {
        if configuration.local_memory.size != MemorySize::All {
            let layout = &configuration.header.layout;
            let geometry = Geometry::new(&configuration.local_memory, layout).map_err(|error| error.to_string())?;
            let mut memory = ClusterMemory::new(layout);
            memory.store(Address(0), self.database.database().bytes()).map_err(|error| error.to_string())?;
            let copied = Copied { memory, fetched: Vec::new() };
            self.local = Some(LocalMemory::new(geometry, layout, configuration.seed, copied));
        }
        self.configuration = Some(configuration);
        Ok(())
    }

    /// The bus lets this node in.
    fn welcomed(&mut self, context: &mut Context) -> Vec<Answer> {
        self.bus_reached = true;
        if self.local.is_some() {
            return vec![Answer::Ready(None)];
        }
        let pieces = self.database.database().bytes().chunks(BULK_BYTES_MAX as usize);
        let request = |(i, piece): (usize, &[u8])| {
            let address = Address(i as u64 * u64::from(BULK_BYTES_MAX));
            (MemoryRequest::Bulk { address, bytes: piece.len() as u32 }, piece.to_vec())
        };
        let requests = pieces.enumerate().map(request).collect();
        self.under_way = Some(UnderWay { traced: None, requests });
        self.ask(context)
    }

    /// Begins with the next tile.
    fn turn(&mut self, context: &mut Context) {
        if let (None, Some(job)) = (&self.under_way, self.jobs.front()) {
            self.under_way = Some(UnderWay { traced: None, requests: VecDeque::new() });
            context.network.wake(context.me, takes(job.tile), Timer::Traced);
        }
    }

    fn trace(&mut self, job: Job) -> Option<UnderWay> {
        let configuration = self.configuration.as_ref()?;
        let NodeConfiguration { header, view, octree, aov, .. } = &**configuration;
        let mut tracer = TileTracer::new(header, view, octree.mailbox);
        let Job { tile, attempt, rect, permit } = job;
        let (pixels, trace, memory, fetched) = match &mut self.local {
            Some(local) => {
                let Ok((pixels, trace)) = tracer.trace(local, rect, *aov) else { return None };
                let memory = local.take_stats();
                (pixels, trace, Some(memory), std::mem::take(&mut local.source_mut().fetched))
            }
            None => {
                let Ok((pixels, trace)) = tracer.trace(&mut Slices::new(&self.database), rect, *aov);
                (pixels, trace, None, Vec::new())
            }
        };
        let asked = |(fetch, data): (FetchRequest, Vec<u8>)| {
            let FetchRequest { section, address, line_bytes, lines, accesses_before } = fetch;
            let line_bytes = line_bytes as u16;
            (MemoryRequest::Fetch { tile, attempt, section, address, line_bytes, lines, accesses_before }, data)
        };
        let render_cpu_nanoseconds = takes(tile).as_nanos() as u64;
        self.counted.insert((tile, attempt), (trace.clone(), memory.clone()));
        let done = Box::new(TileDone { tile, attempt, trace, memory, render_cpu_nanoseconds });
        let traced = Some(Traced { done, pixels: Arc::new(pixels), permit });
        Some(UnderWay { traced, requests: fetched.into_iter().map(asked).collect() })
    }

    /// Sends the next request, or is done.
    fn ask(&mut self, context: &mut Context) -> Vec<Answer> {
        let (Some(under_way), Some(bus)) = (&self.under_way, self.bus) else { return Vec::new() };
        if let Some((request, _)) = under_way.requests.front() {
            send(context, bus, request);
            return Vec::new();
        }
        let traced = self.under_way.take().and_then(|under_way| under_way.traced);
        let answer = match traced {
            Some(traced) => {
                let TileDone { tile, attempt, .. } = *traced.done;
                send(context, bus, &MemoryRequest::Pixels { tile, attempt, bytes: PIXEL_BYTES });
                Answer::Traced(traced)
            }
            None => Answer::Ready(Some(Packets { simd: Simd::Scalar, derived_bytes: 0 })),
        };
        self.turn(context);
        vec![answer]
    }

    fn answered(&mut self, context: &mut Context, frame: &[u8]) -> Vec<Answer> {
        let body = frame.get(PREFIX_BYTES..).unwrap_or_default();
        let expected = self.under_way.as_mut().and_then(|under_way| under_way.requests.pop_front());
        match (frame::decode::<MemoryReply>(body), expected) {
            (Ok((MemoryReply::Data { .. }, data)), Some((_, expected))) if data == expected => self.ask(context),
            (Ok((MemoryReply::Refused(why), _)), _) => vec![Answer::Failed(why)],
            _ => vec![Answer::Failed("the bus answered with something else".to_owned())],
        }
    }
}

fn send(context: &mut Context, bus: Wire, request: &MemoryRequest) {
    if let Ok(frame) = frame::encode(request, &[]) {
        context.network.send(context.me, bus, Message::Frame(frame));
    }
}

impl Worker<State> for Tracer {
    fn begin(&mut self, context: &mut Context, task: Task) -> Result<Option<Answer>, String> {
        match task {
            Task::Start(configuration) => {
                self.bus = Some(context.network.dial(context.me, context.id, configuration.bus, BUS_DEADLINE));
                self.start(configuration)?;
            }
            Task::Trace(job) => {
                self.jobs.push_back(job);
                self.turn(context);
            }
        }
        Ok(None)
    }

    fn arrived(&mut self, context: &mut Context, wire: Wire, parcel: &Parcel) -> Option<Vec<Answer>> {
        (self.bus == Some(wire)).then(|| match parcel {
            Parcel::Welcome => self.welcomed(context),
            Parcel::Message(Message::Frame(frame)) => self.answered(context, frame),
            Parcel::End => vec![Answer::Failed("the bus closed the connection".to_owned())],
            _ => Vec::new(),
        })
    }

    fn timer(&mut self, context: &mut Context, timer: Timer) -> Vec<Answer> {
        match timer {
            Timer::Traced => match self.jobs.pop_front() {
                Some(job) => {
                    self.under_way = self.trace(job);
                    self.ask(context)
                }
                None => Vec::new(),
            },
            Timer::Dialled(wire) if self.bus == Some(wire) && !self.bus_reached => {
                vec![Answer::Failed("the bus does not answer".to_owned())]
            }
            _ => Vec::new(),
        }
    }
}
