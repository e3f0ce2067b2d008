//! A 64-byte line fetched by a node over a real bus, against a raw ping-pong of as many bytes over the
//! loopback interface, in turns; then the same fetch over mutual TLS. `cargo bench --bench fetch`; the ratio of the
//! plain one is to stay below 1.5.

use std::error::Error;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use cluster::keys::{Identity, KeyFolder, RoleKind, Validity};
use cluster::processes::bus::memory_loop::{Command, MemoryLoop};
use cluster::processes::bus::state::State;
use cluster::processes::node::BusLines;
use cluster::protocol::connection::{BlockingConnection, Credentials, Introduction, Listener, Tls};
use cluster::protocol::control::BusConfiguration;
use cluster::protocol::frame;
use cluster::protocol::hello::{Role, RunToken};
use cluster::protocol::memory::{MemoryReply, MemoryRequest};
use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use ground::pulse::Pulse;
use machine::hardware::local_memory::LineSource;
use machine::hardware::specification::Arbiter;
use machine::hardware::transaction::FetchRequest;
use machine::recording::{Metadata, Writer};
use nix::sched::{CpuSet, sched_setaffinity};
use nix::unistd::Pid;
use trace::database::{Layout, Section};

const LINE_BYTES: usize = 64;
const ROUNDS: usize = 60;
const TRIPS_PER_ROUND: u32 = 2000;
const TOKEN: RunToken = RunToken::new([1; 32]);
const DEADLINE: Duration = Duration::from_secs(5);

fn main() -> Result<(), Box<dyn Error>> {
    let (request_bytes, reply_bytes) = frame_bytes()?;
    println!("{ROUNDS} rounds of {TRIPS_PER_ROUND} trips, {request_bytes} bytes there, {reply_bytes} back; medians:");
    let processors = thread::available_parallelism()?.get();
    for keys in [Keys::none(), Keys::new()?] {
        compare("on one processor", &keys, 0, 0)?;
        if processors > 1 {
            compare("on two processors", &keys, 0, 1)?;
        }
    }
    Ok(())
}

/// What the processes know each other by.
struct Keys {
    bus: Option<Tls>,
    node: Option<Tls>,
    manager: Option<Tls>,
}

impl Keys {
    fn none() -> Self {
        Self { bus: None, node: None, manager: None }
    }

    fn new() -> Result<Self, Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        KeyFolder::at(folder.path()).create(Validity::days(1))?;
        let tls = |kind| -> Result<_, Box<dyn Error>> { Ok(Some(Tls::new(&Identity::read(folder.path(), kind)?)?)) };
        Ok(Self { bus: tls(RoleKind::Bus)?, node: tls(RoleKind::Node)?, manager: tls(RoleKind::Manager)? })
    }
}

/// Where the scheduler puts the two ends decides more than anything else, and it need not choose alike for both:
/// so they are pinned, both the same way.
fn compare(placement: &str, keys: &Keys, client: usize, server: usize) -> Result<(), Box<dyn Error>> {
    // Threads inherit where they may run: the servers stay here.
    pin(server)?;
    let folder = tempfile::tempdir()?;
    // One granule short of 1 MiB is as good as any: the bus does not cache.
    let layout = Layout::new([(1 << 18) - 64, 0, 0, 0, 0, 0, 0, 0, 0])?;
    let bus = start_bus(
        BusConfiguration {
            cluster: ClusterId(0),
            arbiter: Arbiter::Fifo,
            layout: layout.clone(),
            recording: folder.path().to_owned(),
        },
        &keys.bus,
    )?;
    let (request_bytes, reply_bytes) = frame_bytes()?;
    let pong = start_pong(request_bytes, reply_bytes)?;
    pin(client)?;
    store(bus, &keys.manager, layout.database_bytes())?;
    let mut lines = BusLines::connect(ClusterId(0), bus, &introduction(Role::Node(NodeId(0)), &keys.node))?;
    let mut raw = TcpStream::connect(pong)?;
    raw.set_nodelay(true)?;

    let (request, mut reply) = (vec![1; request_bytes], vec![0; reply_bytes]);
    let (mut fetches, mut pings) = (Vec::new(), Vec::new());
    for round in 0..ROUNDS {
        pings.push(nanoseconds_a_trip(|_| {
            raw.write_all(&request)?;
            Ok(raw.read_exact(&mut reply)?)
        })?);
        fetches.push(nanoseconds_a_trip(|trip| {
            let line = (round as u64 * 7919 + u64::from(trip)) % (layout.database_bytes() / LINE_BYTES as u64);
            Ok(lines.fetch(&fetch(line), &mut reply[..LINE_BYTES])?)
        })?);
    }
    let (fetch, ping) = (median(&mut fetches), median(&mut pings));
    let wire = if keys.bus.is_some() { "TLS 1.3" } else { "plain" };
    println!(
        "{wire:8} {placement:18} raw ping-pong {:6.2} us, fetch of a line {:6.2} us, ratio {:.2}",
        ping / 1e3,
        fetch / 1e3,
        fetch / ping
    );
    Ok(())
}

/// This thread, and those it starts from now on, run on one processor only.
fn pin(processor: usize) -> nix::Result<()> {
    let mut set = CpuSet::new();
    set.set(processor)?;
    sched_setaffinity(Pid::from_raw(0), &set)
}

fn nanoseconds_a_trip(mut trip: impl FnMut(u32) -> Result<(), Box<dyn Error>>) -> Result<f64, Box<dyn Error>> {
    let start = Instant::now();
    for i in 0..TRIPS_PER_ROUND {
        trip(i)?;
    }
    Ok(start.elapsed().as_nanos() as f64 / f64::from(TRIPS_PER_ROUND))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn introduction(role: Role, tls: &Option<Tls>) -> Introduction {
    Credentials { token: TOKEN, tls: tls.clone(), joiners: false }.introduction(role, Epoch(0))
}

fn fetch(line: u64) -> FetchRequest {
    let address = Address(line * LINE_BYTES as u64);
    FetchRequest { section: Section::OctreeNodes, address, line_bytes: LINE_BYTES as u32, lines: 1, accesses_before: 0 }
}

/// Of a fetch and of its reply, lengths included.
fn frame_bytes() -> Result<(usize, usize), frame::CodecError> {
    let FetchRequest { section, address, lines, accesses_before, .. } = fetch(0);
    let (tile, attempt, line_bytes) = (TileId(0), Attempt(0), LINE_BYTES as u16);
    let request = MemoryRequest::Fetch { tile, attempt, section, address, line_bytes, lines, accesses_before };
    let reply = MemoryReply::Data { bytes: LINE_BYTES as u32 };
    Ok((frame::encode(&request, &[])?.len(), frame::encode(&reply, &[0; LINE_BYTES])?.len()))
}

/// A bus without a manager, as `marti-bus` runs it: recording and all.
fn start_bus(configuration: BusConfiguration, tls: &Option<Tls>) -> Result<SocketAddr, Box<dyn Error>> {
    let BusConfiguration { cluster, arbiter, layout, recording } = &configuration;
    let metadata = Metadata { cluster: *cluster, epoch: Epoch(0), arbiter: *arbiter, layout: layout.clone() };
    let recording = Writer::create(recording, &metadata)?;
    let (incidents, mut told) = tokio::sync::mpsc::channel(1);
    let (memory_loop, handle) = MemoryLoop::new(State::new(&configuration, Epoch(0)), recording, incidents, DEADLINE)?;
    thread::spawn(|| memory_loop.run(&Pulse::default().beacon("bus")));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let credentials = Credentials { token: TOKEN, tls: tls.clone(), joiners: false };
    let bound = Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials, |_, _| Ok(()));
    let mut listener = runtime.block_on(bound)?;
    let address = listener.address();
    thread::spawn(move || {
        runtime.block_on(async {
            loop {
                tokio::select! {
                    arrival = listener.arrival() => {
                        let (peer, connection) = arrival.expect("a good hello");
                        let stream = connection.into_std().expect("nothing after the hello");
                        handle.send(Command::Admit(peer, stream)).expect("running");
                    }
                    Some(incident) = told.recv() => panic!("{incident}"),
                }
            }
        });
    });
    Ok(address)
}

fn store(bus: SocketAddr, tls: &Option<Tls>, bytes: u64) -> Result<(), Box<dyn Error>> {
    let mut loader: BlockingConnection<MemoryRequest, MemoryReply> =
        BlockingConnection::connect(Role::Bus(ClusterId(0)), bus, &introduction(Role::Manager, tls), DEADLINE)?;
    loader.send(&MemoryRequest::Store { address: Address(0) }, &vec![7; bytes as usize])?;
    match loader.receive()? {
        (MemoryReply::Stored, _) => Ok(()),
        (reply, _) => Err(format!("{reply:?}").into()),
    }
}

/// Answers each `request_bytes` with `reply_bytes`, on a plain thread with a blocking socket.
fn start_pong(request_bytes: usize, reply_bytes: usize) -> Result<SocketAddr, Box<dyn Error>> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    let address = listener.local_addr()?;
    thread::spawn(move || -> std::io::Result<()> {
        let (mut stream, _) = listener.accept()?;
        stream.set_nodelay(true)?;
        let (mut request, reply) = (vec![0; request_bytes], vec![2; reply_bytes]);
        loop {
            stream.read_exact(&mut request)?;
            stream.write_all(&reply)?;
        }
    });
    Ok(address)
}
