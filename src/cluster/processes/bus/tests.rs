//! The memory loop with real sockets on the loopback interface.

use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::*;
use crate::keys::{Authority, Identity, RoleKind, Validity};
use crate::processes::driver::Admission;
use crate::protocol::connection::{BlockingConnection, Credentials, Fault, Listener, Tls};
use crate::protocol::frame;
use crate::protocol::hello::{Hello, Role, RunToken};
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use machine::hardware::specification::Arbiter;
use machine::hardware::totals::LostAttempt;
use trace::database::{Layout, Section};

type Connection = BlockingConnection<MemoryRequest, MemoryReply>;

const TOKEN: RunToken = RunToken::new([3; 32]);
const SOON: Duration = Duration::from_secs(5);
/// Short, for the test of a peer that does not read.
const STUCK_DEADLINE: Duration = Duration::from_millis(300);
/// Larger than what the sockets of a peer that does not read can hold.
const IMAGE_BYTES: usize = 3 * BULK_BYTES_MAX as usize;

/// A bus without a manager: its loop, and a listener that hands peers to it.
struct TestBus {
    keys: Keys,
    address: SocketAddr,
    finish: oneshot::Sender<Vec<LostAttempt>>,
    incidents: mpsc::Receiver<String>,
    totals: JoinHandle<BusTotals>,
    folder: tempfile::TempDir,
}

/// Who signs the certificates of a bus and its peers; none: plain TCP.
type Keys = Option<Arc<Authority>>;

/// Plain TCP, and mutual TLS.
fn wires() -> [Keys; 2] {
    [None, Some(Arc::new(Authority::new().expect("random numbers")))]
}

fn credentials(keys: &Keys, kind: RoleKind) -> Credentials {
    let tls = keys.as_ref().map(|authority| {
        let pem = authority.issue(kind, Validity::days(1)).expect("random numbers");
        Tls::new(&Identity { kind, pem }).expect("good keys")
    });
    Credentials { tls, ..Credentials::plain(TOKEN) }
}

impl TestBus {
    fn start() -> Self {
        Self::start_over(None)
    }

    fn start_over(keys: Keys) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let configuration = BusConfiguration {
            cluster: ClusterId(0),
            arbiter: Arbiter::Fifo,
            layout: layout(),
            recording: folder.path().to_owned(),
        };
        let (incident_sender, incidents) = mpsc::channel(INCIDENTS_MAX);
        let (finish, finished) = oneshot::channel();
        let (bound, address) = std::sync::mpsc::channel();
        let credentials = credentials(&keys, RoleKind::Bus);
        let totals = thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
            runtime.block_on(run_until(finished, &configuration, credentials, incident_sender, &bound))
        });
        Self { keys, address: address.recv_timeout(SOON).expect("bound"), finish, incidents, totals, folder }
    }

    /// Stores the image.
    fn loaded() -> Self {
        Self::loaded_over(None)
    }

    fn loaded_over(keys: Keys) -> Self {
        let bus = Self::start_over(keys);
        let mut loader = bus.connect(Role::Manager, 0);
        let mut address = 0;
        for part in image().chunks(BULK_BYTES_MAX as usize) {
            let stored = ask(&mut loader, &MemoryRequest::Store { address: Address(address) }, part);
            assert_eq!(stored.expect("in order").0, MemoryReply::Stored);
            address += part.len() as u64;
        }
        bus
    }

    fn connect(&self, role: Role, epoch: u32) -> Connection {
        let introduction = credentials(&self.keys, role.kind()).introduction(role, Epoch(epoch));
        Connection::connect(Role::Bus(ClusterId(0)), self.address, &introduction, SOON).expect("welcome")
    }

    fn node(&self, node: u16) -> Connection {
        self.connect(Role::Node(NodeId(node)), 0)
    }

    fn incident(&mut self) -> String {
        let begin = Instant::now();
        while begin.elapsed() < SOON {
            match self.incidents.try_recv() {
                Ok(incident) => return incident,
                Err(_) => thread::sleep(Duration::from_millis(5)),
            }
        }
        panic!("no incident")
    }

    fn finish(self, lost: Vec<LostAttempt>) -> (BusTotals, tempfile::TempDir) {
        self.finish.send(lost).expect("running");
        (self.totals.join().expect("no panic"), self.folder)
    }
}

async fn run_until(
    mut finished: oneshot::Receiver<Vec<LostAttempt>>,
    configuration: &BusConfiguration,
    credentials: Credentials,
    incidents: mpsc::Sender<String>,
    bound: &std::sync::mpsc::Sender<SocketAddr>,
) -> BusTotals {
    let metadata = Metadata {
        cluster: configuration.cluster,
        epoch: Epoch(0),
        arbiter: configuration.arbiter,
        layout: configuration.layout.clone(),
    };
    let recording = Writer::create(&configuration.recording, &metadata).expect("an empty folder");
    let state = State::new(configuration, Epoch(0));
    let (memory_loop, handle) = MemoryLoop::new(state, recording, incidents, STUCK_DEADLINE).expect("descriptors");
    let loop_thread = thread::spawn(|| memory_loop.run(&Pulse::default().beacon("bus")));
    let admits = |role, _| Admission::BusClients.check(role);
    let mut listener = Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials, admits).await.expect("loopback");
    bound.send(listener.address()).expect("awaited");
    let lost = loop {
        tokio::select! {
            // Who is welcome is admitted, even if the test ends at once.
            biased;
            arrival = listener.arrival() => if let Ok((peer, connection)) = arrival {
                let _ = admit(peer, connection, &handle);
            },
            lost = &mut finished => break lost.expect("told"),
        }
    };
    handle.send(Command::Finish { lost }).expect("running");
    loop_thread.join().expect("no panic").expect("recorded").expect("told to finish")
}

fn layout() -> Layout {
    Layout::new([IMAGE_BYTES as u64 / 4, 0, 0, 0, 0, 0, 0, 0, 0]).expect("small")
}

fn image() -> Vec<u8> {
    (0..IMAGE_BYTES as u32 / 4).flat_map(|word| word.wrapping_mul(0x9E37_79B1).to_le_bytes()).collect()
}

fn ask(
    connection: &mut Connection,
    request: &MemoryRequest,
    bulk: &[u8],
) -> Result<(MemoryReply, Vec<u8>), ConnectionError> {
    connection.send(request, bulk)?;
    connection.receive().map(|(reply, data)| (reply, data.to_vec()))
}

fn fetch(address: u64, line_bytes: u16, lines: u32) -> MemoryRequest {
    MemoryRequest::Fetch {
        tile: TileId(0),
        attempt: Attempt(0),
        section: Section::OctreeNodes,
        address: Address(address),
        line_bytes,
        lines,
        accesses_before: 0,
    }
}

#[test]
fn lines_and_ranges_come_as_they_were_stored() {
    for keys in wires() {
        let (bus, image) = (TestBus::loaded_over(keys), image());
        let mut node = bus.node(0);
        let (reply, data) = ask(&mut node, &fetch(1024, 64, 0b101), &[]).expect("good");
        assert_eq!(reply, MemoryReply::Data { bytes: 128 });
        assert_eq!(data, [&image[1024..1088], &image[1152..1216]].concat());
        let (_, data) = ask(&mut node, &fetch(512, 256, u32::MAX), &[]).expect("good");
        assert_eq!(data, image[512..512 + 32 * 256]);
        let range = MemoryRequest::Bulk { address: Address(4096), bytes: BULK_BYTES_MAX };
        let (_, data) = ask(&mut node, &range, &[]).expect("good");
        assert!(data == image[4096..4096 + BULK_BYTES_MAX as usize]);

        drop(node);
        let lost = LostAttempt { tile: TileId(0), attempt: Attempt(0) };
        let (totals, folder) = bus.finish(vec![lost]);
        assert_eq!((totals.fetches, totals.fetched_bytes), (2, 128 + 32 * 256));
        assert_eq!((totals.fetches_of_lost_attempts, totals.bulk_bytes), (2, u64::from(BULK_BYTES_MAX)));
        assert_eq!((totals.transactions, totals.log_rows), (6, 6), "three stores, two fetches, a range");
        assert!(folder.path().join("bus.arrows").exists());
        // All data moved, and for each request and reply less than a hundred bytes around them.
        let moved = (IMAGE_BYTES + BULK_BYTES_MAX as usize + 128 + 32 * 256) as u64;
        assert!((moved..moved + 6 * 100).contains(&totals.wire_bytes), "{} for {moved}", totals.wire_bytes);
    }
}

#[test]
fn many_nodes_at_once_each_get_their_own_lines() {
    for keys in wires() {
        let (bus, image) = (TestBus::loaded_over(keys), image());
        thread::scope(|scope| {
            for n in 0..6 {
                let (mut node, image) = (bus.node(n), &image);
                scope.spawn(move || {
                    for i in 0..500u64 {
                        let line = (i * 7919 + u64::from(n) * 104_729) % (IMAGE_BYTES as u64 / 64);
                        let (_, data) = ask(&mut node, &fetch(line * 64, 64, 1), &[]).expect("good");
                        assert_eq!(data, image[line as usize * 64..][..64]);
                    }
                });
            }
        });
        let (totals, _) = bus.finish(Vec::new());
        assert_eq!((totals.fetches, totals.fetched_bytes, totals.log_rows), (3000, 3000 * 64, 3003));
    }
}

#[test]
fn clients_that_never_stop_keep_no_other_from_being_heard() {
    let bus = TestBus::loaded();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        for node in 1..5 {
            let mut flooder = bus.node(node);
            let over = &over;
            scope.spawn(move || {
                let (tile, attempt) = (TileId(0), Attempt(0));
                // It is dropped when the bus ends.
                while flooder.send(&MemoryRequest::Pixels { tile, attempt, bytes: 4 }, &[]).is_ok()
                    && !over.load(Ordering::Relaxed)
                {}
            });
        }
        thread::sleep(Duration::from_millis(100));
        let mut other = bus.node(0);
        for line in 0..20 {
            ask(&mut other, &fetch(line * 64, 64, 1), &[]).expect("it is heard");
        }
        over.store(true, Ordering::Relaxed);
    });
    assert_eq!(bus.finish(Vec::new()).0.fetches, 20);
}

#[test]
fn messages_that_are_not_answered_count_even_when_the_end_follows_at_once() {
    let bus = TestBus::start();
    let mut master = bus.connect(Role::Master(ClusterId(0)), 0);
    // More than the loop takes between two looks at its sockets.
    for tile in 0..5000 {
        let (node, tile, attempt) = (NodeId(0), TileId(tile), Attempt(0));
        master.send(&MemoryRequest::Job { node, tile, attempt, bytes: 4 }, &[]).expect("open");
    }
    drop(master);
    let (totals, _) = bus.finish(Vec::new());
    assert_eq!((totals.message_bytes, totals.log_rows), (20_000, 5000));
}

#[test]
fn who_asks_for_what_is_not_his_is_told_named_and_dropped() {
    let mut bus = TestBus::loaded();
    for (role, request, bulk, expected) in [
        (Role::Node(NodeId(4)), MemoryRequest::Store { address: Address(0) }, &[][..], "a store is not for this"),
        (Role::Master(ClusterId(0)), fetch(0, 64, 1), &[], "a fetch is not for this"),
        (Role::Node(NodeId(4)), fetch(IMAGE_BYTES as u64, 64, 1), &[], "outside of the image"),
        (Role::Node(NodeId(4)), fetch(32, 64, 1), &[], "a multiple of its line"),
    ] {
        let mut peer = bus.connect(role, 0);
        match ask(&mut peer, &request, bulk).expect("told") {
            (MemoryReply::Refused(why), _) => assert!(why.contains(expected), "{why}"),
            (reply, _) => panic!("{reply:?} instead of: {expected}"),
        }
        assert!(matches!(peer.receive().expect_err("dropped").fault, Fault::Closed));
        let incident = bus.incident();
        assert!(incident.contains(&role.to_string()) && incident.contains(expected), "{incident}");
    }
    // A frame that only the loader may send is not even read.
    let mut node = bus.node(4);
    node.send(&MemoryRequest::Store { address: Address(0) }, &[0; 4096]).expect("open");
    assert!(node.receive().is_err());
    assert!(bus.incident().contains("at most 64 are allowed"));
    // The others are served as before.
    assert!(ask(&mut bus.node(5), &fetch(0, 64, 1), &[]).is_ok());
}

#[test]
fn a_newcomer_takes_the_place_of_its_predecessor_but_not_of_its_successor() {
    let mut bus = TestBus::loaded();
    let mut first = bus.node(2);
    assert!(ask(&mut first, &fetch(0, 64, 1), &[]).is_ok());
    let mut second = bus.connect(Role::Node(NodeId(2)), 1);
    assert!(ask(&mut second, &fetch(0, 64, 1), &[]).is_ok());
    assert!(ask(&mut first, &fetch(0, 64, 1), &[]).is_err());
    let mut late = bus.node(2);
    assert!(ask(&mut late, &fetch(0, 64, 1), &[]).is_err());
    assert!(bus.incident().contains("not admitted"));
    assert!(ask(&mut second, &fetch(0, 64, 1), &[]).is_ok());
}

#[test]
fn a_peer_that_stops_reading_is_dropped_and_holds_up_nobody() {
    for keys in wires() {
        let mut bus = TestBus::loaded_over(keys);
        let mut stuck = bus.node(0);
        for _ in 0..8 {
            stuck.send(&MemoryRequest::Bulk { address: Address(0), bytes: BULK_BYTES_MAX }, &[]).expect("open");
        }
        let mut other = bus.node(1);
        let begin = Instant::now();
        for _ in 0..100 {
            ask(&mut other, &fetch(0, 64, 1), &[]).expect("good");
        }
        assert!(begin.elapsed() < STUCK_DEADLINE, "{:?}", begin.elapsed());
        let incident = bus.incident();
        assert!(incident.contains("node 0") && incident.contains("did not read"), "{incident}");
        ask(&mut other, &fetch(0, 64, 1), &[]).expect("good");
    }
}

#[test]
fn garbage_after_the_hello_is_named() {
    let mut bus = TestBus::start();
    let hello =
        frame::encode(&Hello::new(Role::Node(NodeId(9)), Epoch(0), TOKEN.of(Role::Node(NodeId(9)), Epoch(0))), &[])
            .expect("short");
    for (garbage, expected) in [(&[0xff; 8][..], "at most 64"), (&[0, 0, 0, 2, 9, 9], "not a MemoryRequest")] {
        let mut stream = std::net::TcpStream::connect(bus.address).expect("listening");
        std::io::Write::write_all(&mut stream, &hello).expect("open");
        let mut welcome = [0; 8];
        stream.read_exact(&mut welcome).expect("welcome");
        std::io::Write::write_all(&mut stream, garbage).expect("open");
        let incident = bus.incident();
        assert!(incident.contains("node 9") && incident.contains(expected), "{incident}");
    }
}
