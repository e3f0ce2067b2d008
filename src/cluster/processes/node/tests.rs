//! A node between a manager, a master, a bus and a display that the tests play.

use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use super::*;
use crate::processes::simulation::test_scene;
use crate::protocol::connection::{Credentials, Listener};
use crate::protocol::control::{Bootstrap, NodeCommand, NodeConfiguration, NodeReport};
use crate::protocol::hello::{Role, RunToken};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::{Claim, Mac, MacKey};
use crate::protocol::memory::{MemoryReply, MemoryRequest};
use crate::protocol::work::{TileDone, WorkReply, WorkRequest, jobs_per_node};
use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};
use machine::hardware::cluster_memory::ClusterMemory;
use machine::hardware::specification::{LocalMemory, MemorySize, Replacement};
use machine::hardware::transaction::FetchRequest;
use trace::database::Database;
use trace::database::verify::Verified;
use trace::picture::{AovSet, ImageSettings, Pixels, Sides, Tiling};
use trace::tracer::octree::Octree;
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, View};

const TOKEN: RunToken = RunToken::new([5; 32]);
const KEY: MacKey = MacKey::new([6; 32]);
const SOON: Duration = Duration::from_secs(10);
const TILING: Tiling = Tiling::new(Sides { width: 20, height: 13, tile_width: 8, tile_height: 8 }).expect("possible");
const AOV: AovSet = AovSet { depth: true, normal: false, primitive: true };
const ALL: MemorySize = MemorySize::All;
const SMALL: MemorySize = MemorySize::Share { numerator: 1, denominator: 16 };

/// The only attempt at a tile: its number is the tile's.
fn claim(tile: u32) -> Claim {
    Claim { tile: TileId(tile), attempt: Attempt(tile), node: NodeId(0), epoch: Epoch(0) }
}

/// As the simulation's.
fn database() -> &'static Verified {
    test_scene::database()
}

fn view() -> View {
    let Sides { width, height, .. } = TILING.sides();
    View { image: ImageSettings::new(width, height, 3, 0.0).expect("possible"), ..test_scene::view(1) }
}

/// The planes of every tile, traced without any process.
fn expected(database: &Verified) -> Vec<Vec<u8>> {
    let mut tracer = TileTracer::new(&database.database().header, &view(), true);
    let trace = |tile| {
        let rect = TILING.rect(TileId(tile)).expect("in the image");
        let Ok((pixels, _)) = tracer.trace(&mut Slices::new(database), rect, AOV);
        let mut planes = Vec::new();
        pixels.write_bytes(&mut planes);
        planes
    };
    (0..TILING.tile_count()).map(trace).collect()
}

async fn listen() -> Listener {
    Listener::bind(Ipv4Addr::LOCALHOST.into(), Credentials::plain(TOKEN), |_, _| Ok(())).await.expect("loopback")
}

/// What the bus was asked for.
#[derive(Default)]
struct Asked {
    fetches: AtomicU64,
    bulks: AtomicU64,
    pixel_bytes: AtomicU64,
}

/// Serves one node until it leaves, or leaves itself after so many requests.
async fn play_bus(mut listener: Listener, database: Database, asked: Arc<Asked>, requests_max: u64) {
    let mut memory = ClusterMemory::new(&database.header.layout);
    memory.store(Address(0), database.bytes()).expect("whole");
    let (_, connection) = listener.arrival().await.expect("the node");
    let (mut sender, mut receiver) = connection.split::<MemoryReply, MemoryRequest>();
    for _ in 0..requests_max {
        let Ok(Some(request)) = receiver.receive().await else { return };
        let data = match request {
            MemoryRequest::Fetch { section, address, line_bytes, lines, accesses_before, .. } => {
                asked.fetches.fetch_add(1, Relaxed);
                let line_bytes = u32::from(line_bytes);
                let fetch = FetchRequest { section, address, line_bytes, lines, accesses_before };
                let mut data = Vec::new();
                memory.gather(&fetch, &mut data).expect("a good fetch");
                data
            }
            MemoryRequest::Bulk { address, bytes } => {
                asked.bulks.fetch_add(1, Relaxed);
                memory.range(address, u64::from(bytes)).expect("in range").to_vec()
            }
            MemoryRequest::Pixels { bytes, .. } => {
                asked.pixel_bytes.fetch_add(u64::from(bytes), Relaxed);
                continue;
            }
            other => panic!("a node does not ask for {other:?}"),
        };
        sender.send_with_bulk(&MemoryReply::Data { bytes: data.len() as u32 }, data.as_slice()).await.expect("awaited");
    }
}

/// Hands out all tiles and collects their completions. Stays until the node has ended.
async fn play_master(mut listener: Listener, all: oneshot::Sender<Vec<TileDone>>) {
    let (_, connection) = listener.arrival().await.expect("the node");
    let (mut sender, mut receiver) = connection.split::<WorkReply, WorkRequest>();
    let (mut next, mut outstanding, mut all_done) = (0, 0, Vec::new());
    while all_done.len() < TILING.tile_count() as usize {
        match receiver.receive().await.expect("whole frames").expect("the node stays") {
            WorkRequest::Ready if next < TILING.tile_count() => {
                let job =
                    WorkReply::Job { tile: TileId(next), attempt: Attempt(next), permit: KEY.permit(claim(next)) };
                sender.send(&job).await.expect("awaited");
                next += 1;
                outstanding += 1;
                assert!(outstanding <= jobs_per_node(1));
            }
            WorkRequest::Ready => {}
            WorkRequest::Done { done, receipt } => {
                assert!(KEY.is_receipt(claim(done.tile.0), receipt));
                outstanding -= 1;
                all_done.push(*done);
            }
        }
    }
    // An error means that a test does not want them.
    let _ = all.send(all_done);
    while let Ok(Some(_)) = receiver.receive().await {}
}

async fn play_display(listener: Listener) -> Vec<Vec<u8>> {
    play_mortal_display(listener, usize::MAX).await
}

/// Dies when it has received so many tiles, before it acknowledges the last of them.
async fn play_mortal_display(mut listener: Listener, tiles_max: usize) -> Vec<Vec<u8>> {
    let mut tiles = vec![Vec::new(); TILING.tile_count() as usize];
    let (_, connection) = listener.arrival().await.expect("the node");
    let (mut sender, mut receiver) = connection.split::<ImageReply, TilePixels>();
    let mut received = 0;
    while let Ok(Some((TilePixels { tile, attempt, permit, crc32c }, planes))) = receiver.receive_with_bulk().await {
        received += 1;
        if received == tiles_max {
            break;
        }
        assert_eq!(crc32c, crc32c::crc32c(&planes));
        assert_eq!(planes.len(), Pixels::byte_len(TILING.rect(tile).expect("in the image").pixel_count(), AOV));
        tiles[tile.0 as usize] = planes.to_vec();
        assert!(KEY.is_permit(claim(tile.0), permit));
        let receipt = KEY.receipt(claim(tile.0));
        sender.send(&ImageReply::Acknowledged { tile, attempt, receipt }).await.expect("awaited");
    }
    tiles
}

type Node = thread::JoinHandle<Result<(), ProcessError>>;

/// Starts a node as [`run`] does, but without standard input and log. What is returned commands it.
async fn start_node(configuration: NodeConfiguration) -> (mpsc::Sender<NodeCommand>, Node) {
    let mut manager = listen().await;
    let bootstrap = Bootstrap {
        role: Role::Node(NodeId(0)),
        epoch: Epoch(0),
        token: TOKEN.of(Role::Node(NodeId(0)), Epoch(0)),
        manager: manager.address(),
        identity: None,
        bind: None,
        advertise: None,
        log: None,
        heartbeat_milliseconds: 50,
    };
    let node = thread::spawn(|| run(&Child::new(bootstrap, false).expect("no keys"), None));
    let (_, connection) = manager.arrival().await.expect("the node");
    let (mut to_node, mut from_node) = connection.split::<NodeCommand, NodeReport>();
    to_node.send(&NodeCommand::Configure(Box::new(configuration))).await.expect("awaited");
    let (commands, mut awaited) = mpsc::channel(4);
    tokio::spawn(async move {
        while let Ok(Some(NodeReport::Heartbeat | NodeReport::Packets(_))) = from_node.receive().await {
            to_node.send(&NodeCommand::Heartbeat).await.expect("awaited");
            while let Ok(command) = awaited.try_recv() {
                to_node.send(&command).await.expect("awaited");
            }
        }
    });
    (commands, node)
}

fn configuration(database: &Verified, size: MemorySize, servers: [&Listener; 3]) -> NodeConfiguration {
    let [master, bus, display] = servers.map(Listener::address);
    NodeConfiguration {
        cluster: ClusterId(0),
        master,
        bus,
        display,
        header: database.database().header.clone(),
        view: view(),
        tiling: TILING,
        aov: AOV,
        octree: Octree { leaf_size: 2, max_depth: 8, mailbox: true },
        local_memory: LocalMemory { size, line: 32, ways: None, replacement: Replacement::Lru },
        threads: 1,
        seed: 1,
        references: None,
    }
}

async fn ended(node: Node) -> Result<(), ProcessError> {
    let join = tokio::task::spawn_blocking(|| node.join().expect("no panic"));
    timeout(SOON, join).await.expect("in time").expect("no panic")
}

#[tokio::test]
async fn its_tiles_are_those_of_the_tracer_alone_and_its_counts_those_of_the_bus() {
    let database = database();
    let expected = expected(database);
    let policies = [
        Replacement::Lru,
        Replacement::Fifo,
        Replacement::Clock,
        Replacement::Random,
        Replacement::Clock0,
        Replacement::Srrip,
        Replacement::Sieve,
        Replacement::S3Fifo,
    ];
    for replacement in policies {
        for size in [ALL, SMALL] {
            let (master, bus, display) = (listen().await, listen().await, listen().await);
            let mut configuration = configuration(database, size, [&master, &bus, &display]);
            configuration.local_memory.replacement = replacement;
            let asked = Arc::new(Asked::default());
            tokio::spawn(play_bus(bus, database.database().clone(), Arc::clone(&asked), u64::MAX));
            let tiles = tokio::spawn(play_display(display));
            let (all, all_done) = oneshot::channel();
            tokio::spawn(play_master(master, all));
            let (commands, node) = start_node(configuration).await;
            let done = timeout(SOON, all_done).await.expect("in time").expect("no panic");
            commands.send(NodeCommand::Finish).await.expect("running");
            ended(node).await.expect("told to finish");
            assert!(tiles.await.expect("no panic") == expected, "{replacement:?}, {size:?}");
            assert!(done.iter().all(|done| done.attempt.0 == done.tile.0 && done.render_cpu_nanoseconds > 0));

            let counted: Vec<_> = done.iter().filter_map(|done| done.memory.as_ref()).collect();
            let fetches: u64 = counted.iter().map(|memory| memory.total().record_misses).sum();
            assert_eq!(counted.is_empty(), size == ALL);
            assert_eq!(asked.fetches.load(Relaxed), fetches);
            assert_eq!((fetches > 0, asked.bulks.load(Relaxed)), if size == ALL { (false, 1) } else { (true, 0) });
            assert!(counted.iter().any(|memory| memory.stall_nanoseconds > 0) || size == ALL);
            assert_eq!(asked.pixel_bytes.load(Relaxed), u64::from(3 * TILING.sides().width * TILING.sides().height));
        }
    }
}

#[tokio::test]
async fn a_bus_that_leaves_ends_the_node() {
    let database = database();
    for (size, requests) in [(ALL, 0), (SMALL, 0), (SMALL, 40)] {
        let (master, bus, display) = (listen().await, listen().await, listen().await);
        let configuration = configuration(database, size, [&master, &bus, &display]);
        tokio::spawn(play_bus(bus, database.database().clone(), Arc::default(), requests));
        tokio::spawn(play_display(display));
        tokio::spawn(play_master(master, oneshot::channel().0));
        let (_commands, node) = start_node(configuration).await;
        let error = ended(node).await.expect_err("no bus").to_string();
        assert!(error.starts_with("tracer: ") && error.contains("bus at 127.0.0.1"), "{error}");
    }
}

#[tokio::test]
async fn a_corrupt_database_ends_the_node() {
    let database = database();
    let (master, bus, display) = (listen().await, listen().await, listen().await);
    let configuration = configuration(database, ALL, [&master, &bus, &display]);
    let mut corrupt = database.database().clone();
    Arc::make_mut(&mut corrupt.words)[0] = u32::MAX;
    tokio::spawn(play_bus(bus, corrupt, Arc::default(), u64::MAX));
    tokio::spawn(play_display(display));
    tokio::spawn(play_master(master, oneshot::channel().0));
    let (_commands, node) = start_node(configuration).await;
    let error = ended(node).await.expect_err("corrupt").to_string();
    assert!(error.contains("the database is corrupt: octree node"), "{error}");
}

#[tokio::test]
async fn a_display_that_dies_is_replaced_and_lacks_nothing() {
    let database = database();
    let expected = expected(database);
    // Before it was dialled, with the first tile, and later.
    for tiles_max in 0..=4 {
        let (master, bus, first, second) = (listen().await, listen().await, listen().await, listen().await);
        let configuration = configuration(database, ALL, [&master, &bus, &first]);
        tokio::spawn(play_bus(bus, database.database().clone(), Arc::default(), u64::MAX));
        let (all, all_done) = oneshot::channel();
        tokio::spawn(play_master(master, all));
        let address = second.address();
        let dying = tokio::spawn(async move {
            match tiles_max {
                0 => drop(first),
                _ => return play_mortal_display(first, tiles_max).await,
            }
            vec![Vec::new(); TILING.tile_count() as usize]
        });
        let (commands, node) = start_node(configuration).await;
        let mut tiles = timeout(SOON, dying).await.expect("in time").expect("no panic");
        let successor = tokio::spawn(play_display(second));
        commands.send(NodeCommand::Display(address)).await.expect("running");
        let done = timeout(SOON, all_done).await.expect("in time").expect("no panic");
        assert_eq!(done.len(), expected.len(), "each is told once");
        commands.send(NodeCommand::Finish).await.expect("running");
        ended(node).await.expect("told to finish");
        for (tile, again) in tiles.iter_mut().zip(successor.await.expect("no panic")) {
            // An acknowledgement may have died on its way: then the tile came twice, and is the same.
            assert!(tile.is_empty() || again.is_empty() || *tile == again);
            if tile.is_empty() {
                *tile = again;
            }
        }
        assert!(tiles == expected, "{tiles_max}");
    }
}

#[tokio::test]
async fn a_display_that_hangs_up_is_dialled_again() {
    let database = database();
    let (master, bus, mut display) = (listen().await, listen().await, listen().await);
    let configuration = configuration(database, ALL, [&master, &bus, &display]);
    tokio::spawn(play_bus(bus, database.database().clone(), Arc::default(), u64::MAX));
    let (all, all_done) = oneshot::channel();
    tokio::spawn(play_master(master, all));
    let tiles = tokio::spawn(async move {
        let (_, connection) = display.arrival().await.expect("the node");
        let (sender, mut receiver) = connection.split::<ImageReply, TilePixels>();
        receiver.receive_with_bulk().await.expect("whole frames").expect("a tile");
        drop((sender, receiver));
        play_display(display).await
    });
    let (commands, node) = start_node(configuration).await;
    timeout(SOON, all_done).await.expect("in time").expect("no panic");
    commands.send(NodeCommand::Finish).await.expect("running");
    ended(node).await.expect("told to finish");
    assert!(tiles.await.expect("no panic") == expected(database));
}

#[tokio::test]
async fn a_master_or_display_that_breaks_the_conversation_is_named() {
    let database = database();
    let broken = [(99, ["the master", "handed out tile 99"]), (0, ["display refused a tile", "not with me"])];
    for (tile, expected) in broken {
        let (mut master, bus, mut display) = (listen().await, listen().await, listen().await);
        let configuration = configuration(database, ALL, [&master, &bus, &display]);
        tokio::spawn(play_bus(bus, database.database().clone(), Arc::default(), u64::MAX));
        tokio::spawn(async move {
            let (_, connection) = master.arrival().await.expect("the node");
            let (mut sender, mut receiver) = connection.split::<WorkReply, WorkRequest>();
            while let Ok(Some(_)) = receiver.receive().await {
                let _ = sender
                    .send(&WorkReply::Job { tile: TileId(tile), attempt: Attempt(0), permit: Mac::default() })
                    .await;
            }
        });
        tokio::spawn(async move {
            let (_, connection) = display.arrival().await.expect("the node");
            let (mut sender, mut receiver) = connection.split::<ImageReply, TilePixels>();
            receiver.receive_with_bulk().await.expect("whole frames");
            let _ = sender.send(&ImageReply::Refused("not with me".to_owned())).await;
            // A connection that ends with unread bytes takes the refusal with it.
            while let Ok(Some(_)) = receiver.receive_with_bulk().await {}
        });
        let (_commands, node) = start_node(configuration).await;
        let error = ended(node).await.expect_err("broken").to_string();
        assert!(expected.iter().all(|part| error.contains(part)), "{error}");
    }
}
