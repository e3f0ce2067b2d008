//! Ten thousand connections that say nothing, at a plain port and at one with TLS: the memory of the process stays
//! bounded, and whoever belongs to the run gets in meanwhile. In a binary of its own, so that the memory is its own.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use cluster::keys::{Identity, KeyFolder, RoleKind, Validity};
use cluster::protocol::connection::{Credentials, Introduction, Listener, Tls, connect};
use cluster::protocol::hello::{Role, RunToken};
use ground::ids::{Epoch, NodeId};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use tokio::net::{TcpSocket, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinSet;
use tokio::time::sleep;

const TOKEN: RunToken = RunToken::new([7; 32]);
const STRANGERS: usize = 10_000;
/// Besides those of the flood.
const DESCRIPTORS: u64 = 1000;
/// What a process may grow by: the strangers that there may be, and what the flood itself takes here.
const GROWTH_KIB_MAX: u64 = 48 << 10;
const DEADLINE: Duration = Duration::from_secs(5);
/// Between two dials of those who belong here.
const PAUSE: Duration = Duration::from_millis(10);
/// Of those who belong here: of fewer, two that are late would be more than a tenth.
const DIALS_MIN: u32 = 50;
/// Connections of the flood that are made at a time.
const CROWD: usize = 100;

#[test]
fn a_flood_of_silent_strangers_neither_fills_memory_nor_keeps_anybody_out() {
    let needed = STRANGERS as u64 + DESCRIPTORS;
    let (_, hard) = getrlimit(Resource::RLIMIT_NOFILE).expect("a limit");
    if hard < needed || setrlimit(Resource::RLIMIT_NOFILE, needed, hard).is_err() {
        println!("SKIPPED: {needed} file descriptors are needed, the system allows {hard}");
        return;
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    KeyFolder::at(folder.path()).create(Validity::days(1)).expect("an empty folder");
    let tls = |kind| Tls::new(&Identity::read(folder.path(), kind).expect("keys")).expect("good keys");
    let (bus, node) = (tls(RoleKind::Bus), tls(RoleKind::Node));
    // As in every process of a run: one thread.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("an event queue");
    for (what, listens, dials) in [("plain", None, None), ("TLS", Some(bus), Some(node))] {
        for from in [Ipv4Addr::new(127, 0, 0, 2), Ipv4Addr::LOCALHOST] {
            let failed = runtime.block_on(flood(what, from, listens.clone(), dials.clone()));
            let crowded = from == Ipv4Addr::LOCALHOST;
            assert!(crowded || failed == 0, "{what}: {failed} peers at another address were kept out");
        }
    }
}

/// Floods a port from an address, dials it from 127.0.0.1 all the while, and tells how many of those who did were kept out.
async fn flood(what: &str, from: Ipv4Addr, listens: Option<Tls>, dials: Option<Tls>) -> u32 {
    let refusals = Arc::new(AtomicU64::new(0));
    let (address, listening) = listen(Credentials { tls: listens, ..Credentials::plain(TOKEN) }, Arc::clone(&refusals));
    let before = memory_kib();
    let begin = Instant::now();
    let flooding = thread::spawn(move || strangers(from, address));
    let introduction =
        Introduction { tls: dials, ..Credentials::plain(TOKEN).introduction(Role::Node(NodeId(1)), Epoch(0)) };
    let (mut welcome, mut failed, mut longest) = (0, 0u32, Duration::ZERO);
    while !flooding.is_finished() || welcome + failed < DIALS_MIN {
        let dialled = Instant::now();
        match connect(Role::Bus(ground::ids::ClusterId(0)), address, &introduction, DEADLINE).await {
            Ok(_) => welcome += 1,
            Err(_) => failed += 1,
        }
        longest = longest.max(dialled.elapsed());
        sleep(PAUSE).await;
        assert!(begin.elapsed() < Duration::from_secs(120), "{what}: the flood does not end");
    }
    let held = flooding.join().expect("no panic");
    let grown = memory_kib().saturating_sub(before);
    println!(
        "{what:5} {} silent connections from {from} in {:4.1} s: {grown} KiB more, {} refusals told; peers from \
         127.0.0.1: {welcome} welcome, {failed} failed, the longest wait {} ms",
        held.len(),
        begin.elapsed().as_secs_f64(),
        refusals.load(Ordering::Relaxed),
        longest.as_millis(),
    );
    assert_eq!(held.len(), STRANGERS);
    assert!(grown < GROWTH_KIB_MAX, "{what}: grew by {grown} KiB");
    assert!(welcome > 9 * failed, "{what}: {failed} of {} were kept out", welcome + failed);
    drop(listening);
    failed
}

/// On a thread of its own, until what is returned is dropped.
fn listen(credentials: Credentials, refusals: Arc<AtomicU64>) -> (SocketAddr, oneshot::Sender<()>) {
    let (until, mut dropped) = oneshot::channel();
    let (bound, address) = std::sync::mpsc::channel();
    thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("an event queue");
        runtime.block_on(async {
            let listener = Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials, |_, _| Ok(()));
            let mut listener = listener.await.expect("loopback");
            bound.send(listener.address()).expect("awaited");
            loop {
                tokio::select! {
                    // Who is welcome leaves again.
                    arrival = listener.arrival() => drop(arrival.map_err(|_| refusals.fetch_add(1, Ordering::Relaxed))),
                    _ = &mut dropped => return,
                }
            }
        });
    });
    (address.recv_timeout(DEADLINE).expect("bound"), until)
}

/// As fast as the system connects them. All are kept until they are dropped, whatever the listener does with them.
fn strangers(from: Ipv4Addr, to: SocketAddr) -> Vec<TcpStream> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("an event queue");
    runtime.block_on(async {
        let mut crowd = JoinSet::new();
        for _ in 0..CROWD {
            crowd.spawn(async move {
                let mut held = Vec::with_capacity(STRANGERS / CROWD);
                while held.len() < STRANGERS / CROWD {
                    let socket = TcpSocket::new_v4().expect("a descriptor");
                    socket.bind((from, 0).into()).expect("a port");
                    if let Ok(stream) = socket.connect(to).await {
                        held.push(stream);
                    }
                }
                held
            });
        }
        crowd.join_all().await.into_iter().flatten().collect()
    })
}

/// Of this process, now.
fn memory_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").expect("Linux has /proc");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a line of memory");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}
