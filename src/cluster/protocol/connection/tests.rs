//! Two ends of real sockets on the loopback interface.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream as StdStream};
use std::time::{Duration, Instant};

use tokio::net::{TcpListener, TcpStream};

use super::handshake::HELLO_DEADLINE;
use super::*;
use crate::protocol::frame::encode;
use crate::protocol::hello::{Hello, HelloReply, PROTOCOL_VERSION, Role, RunToken};
use crate::protocol::mac::Mac;
use crate::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{Attempt, ClusterId, Epoch, NodeId, TileId};

const TOKEN: RunToken = RunToken::new([7; 32]);
const NODE: Role = Role::Node(NodeId(3));
const SOON: Duration = Duration::from_secs(2);

fn hello() -> Hello {
    Hello::new(NODE, Epoch(1), TOKEN.of(NODE, Epoch(1)))
}

fn introduction() -> Introduction {
    Introduction { hello: hello(), tls: None }
}

fn nodes_only(role: Role, _: Epoch) -> Result<(), String> {
    if matches!(role, Role::Node(_)) { Ok(()) } else { Err("a node".to_owned()) }
}

async fn listener() -> Listener {
    Listener::bind(Ipv4Addr::LOCALHOST.into(), Credentials::plain(TOKEN), nodes_only).await.expect("loopback")
}

async fn tcp_pair() -> (TcpStream, TcpStream) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.expect("loopback");
    let dialled = TcpStream::connect(listener.local_addr().expect("bound")).await.expect("listening");
    (dialled, listener.accept().await.expect("dialled").0)
}

/// A node's and its master's end of one connection.
async fn connected() -> (Connection, Connection) {
    let mut listener = listener().await;
    let (address, introduction) = (listener.address(), introduction());
    let (dialled, accepted) =
        tokio::join!(connect(Role::Master(ClusterId(0)), address, &introduction, SOON), listener.arrival());
    (dialled.expect("welcome"), accepted.expect("well known").1)
}

#[tokio::test]
async fn a_known_peer_is_welcome_and_both_talk() {
    let mut listener = listener().await;
    let address = listener.address();
    let dial = tokio::spawn(async move { connect(Role::Master(ClusterId(0)), address, &introduction(), SOON).await });
    let (peer, connection) = listener.arrival().await.expect("well known");
    assert_eq!((peer.role, peer.epoch), (NODE, Epoch(1)));
    let (mut to_node, mut from_node) = connection.split::<WorkReply, WorkRequest>();
    let dialled = dial.await.expect("no panic").expect("welcome");
    assert_eq!(dialled.peer().to_string(), format!("master at {address}"));
    let (mut to_master, mut from_master) = dialled.split::<WorkRequest, WorkReply>();

    to_master.send(&WorkRequest::Ready).await.expect("open");
    assert_eq!(from_node.receive_within(SOON).await.expect("sent"), Some(WorkRequest::Ready));
    let job = WorkReply::Job { tile: TileId(5), attempt: Attempt(0), permit: Mac::default() };
    to_node.send(&job).await.expect("open");
    assert_eq!(from_master.receive_within(SOON).await.expect("sent"), Some(job));
    assert_eq!(to_master.wire_bytes(), from_node.wire_bytes());

    to_master.finish().await;
    assert_eq!(from_node.receive_within(SOON).await.expect("closed between frames"), None);
}

#[tokio::test]
async fn a_torn_frame_is_not_a_clean_close() {
    let frame =
        encode(&WorkReply::Job { tile: TileId(5), attempt: Attempt(0), permit: Mac::default() }, &[]).expect("short");
    for cut in 1..frame.len() {
        let (mut dialled, accepted) = tcp_pair().await;
        let (_, mut receiver) =
            Connection::new(Stream::Plain(accepted), "peer".into()).expect("open").split::<WorkRequest, WorkReply>();
        dialled.write_all(&frame[..cut]).await.expect("open");
        drop(dialled);
        let error = receiver.receive_within(SOON).await.expect_err("torn");
        assert!(matches!(error.fault, Fault::Torn), "{cut} bytes: {error}");
    }
}

#[tokio::test]
async fn silence_has_a_deadline_and_frames_a_limit() {
    let (dialled, accepted) = connected().await;
    let (_to_node, mut from_node) = accepted.split::<WorkReply, WorkRequest>();
    let error = from_node.receive_within(Duration::from_millis(50)).await.expect_err("nothing was sent");
    assert_eq!(error.fault.to_string(), "silent for 50 ms while WorkRequest was expected");
    let mut stream = dialled.into_std().expect("nothing was received");
    stream.write_all(&u32::MAX.to_be_bytes()).expect("open");
    let error = from_node.receive_within(SOON).await.expect_err("too long");
    assert!(matches!(error.fault, Fault::Frame(CodecError::FrameTooLong { .. })), "{error}");
}

/// What a stranger sends, and what the listener says of it. Strangers that are silent or stop halfway are
/// refused by the deadline.
#[tokio::test]
async fn strangers_are_refused_and_named() {
    let frame = |hello: &Hello| encode(hello, &[]).expect("short");
    let good = frame(&hello());
    let expected_hello = "expected the hello of a marti process";
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("garbage", b"GET / HTTP/1.1\r\nHost: marti\r\n\r\n".to_vec(), "at most 4096 are allowed"),
        ("a length of 4 GiB", vec![0xff; 4], "a frame of 4294967295 bytes, at most 4096"),
        ("a short frame of garbage", vec![0, 0, 0, 2, 1, 2], expected_hello),
        ("an empty frame", vec![0, 0, 0, 0], expected_hello),
        ("a wrong magic", frame(&Hello { magic: *b"moscow\r\n", ..hello() }), expected_hello),
        (
            "a wrong version",
            frame(&Hello { version: PROTOCOL_VERSION + 1, ..hello() }),
            "it speaks protocol version 7, expected 6",
        ),
        (
            "a wrong token",
            frame(&Hello { token: RunToken::new([8; 32]), ..hello() }),
            "node 3 has not the token of this run",
        ),
        ("another's role", frame(&Hello { role: Role::Display, ..hello() }), "display has not the token of this run"),
        (
            "a wrong role",
            frame(&Hello::new(Role::Display, Epoch(1), TOKEN.of(Role::Display, Epoch(1)))),
            "display (epoch 1) has no business here, expected a node",
        ),
        ("a hello with more behind it", [&[0, 0, 1, 0][..], &good[4..], &[0; 200]].concat(), "followed by"),
        ("half a frame", good[..good.len() / 2].to_vec(), "silent for 2000 ms while a hello was expected"),
        ("silence", Vec::new(), "silent for 2000 ms while a hello was expected"),
    ];
    let mut listener = listener().await;
    let address = listener.address();
    let begin = Instant::now();
    for (what, bytes, expected) in cases {
        let mut stranger = StdStream::connect(address).expect("listening");
        let local = stranger.local_addr().expect("open");
        stranger.write_all(&bytes).expect("open");
        let refused = listener.arrival().await.expect_err(what).to_string();
        assert!(refused.starts_with(&local.to_string()), "{what}: {refused}");
        assert!(refused.contains(expected), "{what}: {refused}");
    }
    // Two of them are waited for.
    assert!(begin.elapsed() < 2 * HELLO_DEADLINE + SOON, "{:?}", begin.elapsed());
}

#[tokio::test]
async fn who_leaves_before_the_hello_is_whole_is_refused_at_once() {
    let mut listener = listener().await;
    let good = encode(&hello(), &[]).expect("short");
    for (sent, expected) in [(&good[..9], "in the middle of a frame"), (&good[..0], "the connection was closed")] {
        StdStream::connect(listener.address()).and_then(|mut s| s.write_all(sent)).expect("listening");
        let refused = listener.arrival().await.expect_err("no hello");
        assert!(refused.to_string().contains(expected), "{refused}");
    }
}

#[tokio::test]
async fn the_refused_side_learns_why() {
    let listener = listener().await;
    let hello = Hello { token: RunToken::new([0; 32]), ..hello() };
    let wrong = Introduction { hello, tls: None };
    let error = connect(Role::Master(ClusterId(0)), listener.address(), &wrong, SOON).await.expect_err("refused");
    assert!(error.to_string().starts_with(&format!("master at {}: it refused this process:", listener.address())));
    assert!(error.to_string().contains("token"));
}

#[tokio::test]
async fn silent_strangers_keep_nobody_out() {
    let mut listener = listener().await;
    let strangers: Vec<_> = (0..100).map(|_| StdStream::connect(listener.address()).expect("queued")).collect();
    let address = listener.address();
    let dial =
        tokio::spawn(
            async move { connect(Role::Master(ClusterId(0)), address, &introduction(), 4 * HELLO_DEADLINE).await },
        );
    let welcome = loop {
        if let Ok((peer, _)) = listener.arrival().await {
            break peer;
        }
    };
    assert_eq!(welcome.role, NODE);
    assert!(dial.await.expect("no panic").is_ok());
    drop(strangers);
}

#[tokio::test]
async fn nobody_who_listens_but_does_not_answer_is_waited_for() {
    let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.expect("loopback");
    let address = mute.local_addr().expect("bound");
    let deadline = Duration::from_millis(100);
    let error = connect(Role::Bus(ClusterId(0)), address, &introduction(), deadline).await.expect_err("mute");
    assert!(matches!(error.fault, Fault::Silent { .. }), "{error}");
    let blocking = tokio::task::spawn_blocking(move || {
        BlockingConnection::<WorkRequest, WorkReply>::connect(
            Role::Bus(ClusterId(0)),
            address,
            &introduction(),
            deadline,
        )
        .map(drop)
    });
    let error = blocking.await.expect("no panic").expect_err("mute");
    assert!(matches!(error.fault, Fault::Silent { .. }), "{error}");
}

/// A peer for blocking connections that says what it is told to, in pieces.
fn welcoming(pieces: Vec<Vec<u8>>, pause: Duration) -> (SocketAddr, std::thread::JoinHandle<()>) {
    let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback");
    let address = listener.local_addr().expect("bound");
    let thread = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("dialled");
        let mut hello = [0; 1000];
        assert!(stream.read(&mut hello).expect("a hello") > 0);
        stream.write_all(&encode(&HelloReply::Welcome, &[]).expect("short")).expect("open");
        for piece in pieces {
            std::thread::sleep(pause);
            // An error means that the other side has had enough.
            let _ = stream.write_all(&piece);
        }
    });
    (address, thread)
}

#[test]
fn a_blocking_connection_puts_pieces_together() {
    let jobs: Vec<_> =
        (0..3).map(|tile| WorkReply::Job { tile: TileId(tile), attempt: Attempt(1), permit: Mac::default() }).collect();
    let bytes: Vec<u8> = jobs.iter().flat_map(|job| encode(job, &[]).expect("short")).collect();
    for piece in [1, 5, 17, bytes.len()] {
        let (address, peer) = welcoming(bytes.chunks(piece).map(<[u8]>::to_vec).collect(), Duration::from_millis(1));
        let mut connection = BlockingConnection::<WorkRequest, WorkReply>::connect(
            Role::Master(ClusterId(0)),
            address,
            &introduction(),
            SOON,
        )
        .expect("welcome");
        for job in &jobs {
            assert_eq!(connection.receive().expect("sent").0, *job);
        }
        peer.join().expect("no panic");
        assert!(matches!(connection.receive().expect_err("closed").fault, Fault::Closed));
    }
}

#[test]
fn a_blocking_connection_waits_for_a_whole_frame_only_so_long() {
    // One byte at a time, each well within the deadline, all of them not.
    let frame =
        encode(&WorkReply::Job { tile: TileId(1), attempt: Attempt(1), permit: Mac::default() }, &[]).expect("short");
    let (address, peer) = welcoming(frame.chunks(1).map(<[u8]>::to_vec).collect(), Duration::from_millis(60));
    let deadline = Duration::from_millis(200);
    let mut connection = BlockingConnection::<WorkRequest, WorkReply>::connect(
        Role::Master(ClusterId(0)),
        address,
        &introduction(),
        deadline,
    )
    .expect("welcome");
    let begin = Instant::now();
    let error = connection.receive().map(drop).expect_err("late");
    assert!(matches!(error.fault, Fault::Silent { .. }), "{error}");
    assert!(begin.elapsed() < 3 * deadline);
    drop(connection);
    peer.join().expect("no panic");
}
