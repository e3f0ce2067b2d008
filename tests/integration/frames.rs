//! What strangers may send to the listening ports of a run: each is refused and disconnected, within its
//! deadline, and the run does not mind.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::process::Stdio;
use std::time::{Duration, Instant};

use cluster::protocol::frame;
use cluster::protocol::hello::{Hello, HelloReply, Role, RunToken};
use ground::ids::{ClusterId, Epoch};

use crate::command::marti;
use crate::processes::{children, end, listening_ports, peak_memory_kib};

/// Longest that a stranger may keep a connection: the hello's deadline, and some.
const PATIENCE: Duration = Duration::from_secs(4);

fn strangers() -> BTreeMap<&'static str, Vec<u8>> {
    let token = RunToken::new([7; 32]);
    let hello = |change: fn(&mut Hello)| {
        let mut hello = Hello::new(Role::Master(ClusterId(0)), Epoch(0), token);
        change(&mut hello);
        frame::encode(&hello, &[]).expect("a hello fits")
    };
    let whole = hello(|_| {});
    let half = whole[..whole.len() / 2].to_vec();
    let mut trailing = whole.clone();
    trailing[3] += 8;
    trailing.extend([0xab; 8]);
    BTreeMap::from([
        ("garbage", b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n".to_vec()),
        ("a length of 4 GiB", vec![0xff; 4096]),
        ("a length above a hello's", [&8192u32.to_be_bytes()[..], &[0; 8192]].concat()),
        ("half a frame", half),
        ("a length of zero", vec![0; 4]),
        ("bytes after the hello", trailing),
        ("another magic", hello(|h| h.magic = *b"marti\0\n\n")),
        ("another version", hello(|h| h.version += 1)),
        ("another run's token", whole),
        ("a build name without end", hello(|h| h.build = "9".repeat(4000))),
        ("silence", Vec::new()),
    ])
}

/// What came back, until the other side hung up.
fn send(port: u16, bytes: &[u8]) -> (String, Duration) {
    let start = Instant::now();
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let mut stream = TcpStream::connect(address).expect("the port listens");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout can be set");
    // The other side may hang up before it has read everything.
    let _ = stream.write_all(bytes);
    let mut answer = Vec::new();
    let ended = stream.read_to_end(&mut answer);
    let timed_out =
        ended.is_err_and(|e| matches!(e.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut));
    assert!(!timed_out, "still connected after {PATIENCE:?}");
    let said = match answer.get(4..).map(frame::decode::<HelloReply>) {
        Some(Ok((HelloReply::Refused(why), _))) => format!("refused: {why}"),
        Some(Ok((HelloReply::Welcome, _))) => panic!("a stranger was welcomed"),
        _ => "disconnected".to_owned(),
    };
    (said, start.elapsed())
}

#[test]
fn strangers_are_refused_at_every_port() {
    let out = tempfile::tempdir().expect("temporary folder");
    let sets = ["image.width=3000", "image.height=3000", "cluster.local_memory.size=1/64"];
    let mut command = marti();
    command.args(["run", "tests/data/teapot-64.toml", "--quiet", "--out"]).arg(out.path());
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    let mut manager = command.stderr(Stdio::null()).spawn().expect("marti can be started");
    let processes = children(manager.id(), 5, Duration::from_secs(20));
    let mut servers: BTreeMap<String, u32> =
        processes.iter().filter(|(name, _)| name != "marti-node").cloned().collect();
    servers.insert("marti".to_owned(), manager.id());
    assert_eq!(servers.len(), 4, "{servers:?}");

    for (server, pid) in &servers {
        let ports = listening_ports(*pid);
        assert_eq!(ports.len(), 1, "{server} listens on {ports:?}");
        let before = peak_memory_kib(*pid);
        for (name, bytes) in strangers() {
            let (said, took) = send(ports[0], &bytes);
            println!("{server:14} {name:26} {:5} ms  {said}", took.as_millis());
        }
        let grown = peak_memory_kib(*pid).saturating_sub(before);
        assert!(grown < 64 << 10, "{server} grew by {grown} KiB");
    }

    assert!(manager.try_wait().expect("the manager can be waited for").is_none(), "the run ended early");
    assert_eq!(children(manager.id(), 5, Duration::ZERO).len(), 5, "a process died");
    end(&mut manager);
}
