//! Who is refused at a port, and in which words: tests/golden/refusals.txt, which `MARTI_UPDATE=1` writes anew.

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener as StdListener, TcpStream as StdStream};
use std::path::Path;
use std::thread;
use std::time::Duration;

use time::OffsetDateTime;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;

use super::tls::tests::{unchecked, without_certificate};
use super::*;
use crate::keys::{Authority, Identity, RoleKind, Validity};
use crate::protocol::hello::{Hello, PROTOCOL_VERSION, Role, RunToken};
use crate::protocol::work::{WorkReply, WorkRequest};
use ground::ids::{ClusterId, Epoch, NodeId};

const TOKEN: RunToken = RunToken::new([7; 32]);
const NODE: Role = Role::Node(NodeId(3));
const MASTER: Role = Role::Master(ClusterId(0));
const SOON: Duration = Duration::from_secs(4);

/// What both sides said, case by case.
struct Book {
    text: String,
    authority: Authority,
}

impl Book {
    fn identity(&self, kind: RoleKind) -> Identity {
        issued(&self.authority, kind, Validity::days(1))
    }

    fn tls(&self, kind: RoleKind) -> Option<Tls> {
        Some(Tls::new(&self.identity(kind)).expect("good keys"))
    }

    /// A master that expects nodes.
    async fn master(&self, tls: Option<Tls>) -> Listener {
        let admits = |role, _| if matches!(role, Role::Node(_)) { Ok(()) } else { Err("a node".to_owned()) };
        Listener::bind(Ipv4Addr::LOCALHOST.into(), Credentials { tls, ..Credentials::plain(TOKEN) }, admits)
            .await
            .expect("loopback")
    }

    /// A line of each side that says something.
    fn write(&mut self, case: &str, listener: Option<String>, dialler: Option<String>) {
        writeln!(self.text, "{case}").expect("a string");
        for (side, said) in [("listener", listener), ("dialler", dialler)] {
            if let Some(said) = said {
                writeln!(self.text, "    {side:9} {}", without_address(&said)).expect("a string");
            }
        }
    }

    /// A node dials a master, each with what it has.
    async fn dial(&mut self, case: &str, listens: Option<Tls>, hello: Hello, dials: Option<Tls>) {
        let mut listener = self.master(listens).await;
        let (address, introduction) = (listener.address(), Introduction { hello, tls: dials });
        let (dialled, arrival) = tokio::join!(connect(MASTER, address, &introduction, SOON), listener.arrival());
        let dialler = dialled.map_or_else(|error| error.to_string(), |_| "welcome".to_owned());
        let listened = arrival.map_or_else(|error| error.to_string(), |(peer, _)| peer.to_string());
        // A plain thread's connection is refused in the same words.
        let thread = tokio::task::spawn_blocking(move || {
            BlockingConnection::<WorkRequest, WorkReply>::connect(MASTER, address, &introduction, SOON)
                .map_or_else(|error| error.to_string(), |_| "welcome".to_owned())
        });
        let (again, _) = tokio::join!(thread, listener.arrival());
        assert_eq!(again.expect("no panic"), dialler, "{case}");
        self.write(case, Some(listened), Some(dialler));
    }

    /// Somebody sends raw bytes, in pieces with a pause.
    async fn raw(&mut self, case: &str, listens: Option<Tls>, pieces: Vec<Vec<u8>>, pause: Duration) {
        let mut listener = self.master(listens).await;
        let mut stream = TcpStream::connect(listener.address()).await.expect("listening");
        let sending = async {
            for piece in pieces {
                if stream.write_all(&piece).await.is_err() {
                    break;
                }
                tokio::time::sleep(pause).await;
            }
            // Neither end is told: the listener has to find out by itself.
            std::future::pending::<()>().await;
        };
        let arrival = tokio::select! {
            () = sending => unreachable!("it never ends"),
            arrival = listener.arrival() => arrival,
        };
        self.write(case, Some(arrival.map(|_| ()).expect_err(case).to_string()), None);
    }
}

fn issued(authority: &Authority, kind: RoleKind, validity: Validity) -> Identity {
    Identity { kind, pem: authority.issue(kind, validity).expect("random numbers") }
}

fn without_address(said: &str) -> String {
    let number = |c: char| c.is_ascii_digit();
    match said.split_once("127.0.0.1:") {
        Some((before, rest)) => format!("{before}ADDRESS{}", rest.trim_start_matches(number)),
        None => said.to_owned(),
    }
}

fn hello(role: Role) -> Hello {
    Hello::new(role, Epoch(1), TOKEN.of(role, Epoch(1)))
}

/// Passes one connection on to `to`, and keeps what the dialler sent.
fn relay(to: SocketAddr) -> (SocketAddr, thread::JoinHandle<Vec<u8>>) {
    let listener = StdListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback");
    let address = listener.local_addr().expect("bound");
    let relayed = thread::spawn(move || {
        let (mut dialled, _) = listener.accept().expect("dialled");
        let mut onward = StdStream::connect(to).expect("listening");
        let (mut back, mut reply) = (onward.try_clone().expect("a socket"), dialled.try_clone().expect("a socket"));
        thread::spawn(move || std::io::copy(&mut back, &mut reply));
        let (mut kept, mut piece) = (Vec::new(), [0; 4096]);
        while let Ok(bytes @ 1..) = dialled.read(&mut piece) {
            kept.extend_from_slice(&piece[..bytes]);
            onward.write_all(&piece[..bytes]).expect("listening");
        }
        kept
    });
    (address, relayed)
}

/// All that a node sends to a master to be welcome, as somebody on the way sees it.
async fn captured(book: &Book, listens: Option<Tls>, dials: Option<Tls>) -> Vec<u8> {
    let mut listener = book.master(listens).await;
    let (address, relayed) = relay(listener.address());
    let introduction = Introduction { hello: hello(NODE), tls: dials };
    let (dialled, arrival) = tokio::join!(connect(MASTER, address, &introduction, SOON), listener.arrival());
    assert!(arrival.is_ok());
    drop((dialled.expect("welcome"), arrival));
    relayed.join().expect("no panic")
}

/// A ClientHello of TLS 1.2, with one cipher and no extension.
fn client_hello_of_tls_1_2() -> Vec<u8> {
    let body = [&[3, 3][..], &[9; 32], &[0, 0, 2, 0xc0, 0x2f, 1, 0]].concat();
    let length = body.len() as u8;
    [&[0x16, 3, 1, 0, length + 4, 1, 0, 0, length][..], &body].concat()
}

#[tokio::test]
async fn whoever_does_not_belong_is_refused_in_clear_words() {
    let mut book = Book { text: String::new(), authority: Authority::new().expect("random numbers") };
    let other = Authority::new().expect("random numbers");
    let (master, node) = (book.tls(RoleKind::Master), book.tls(RoleKind::Node));
    let noon = OffsetDateTime::from_unix_timestamp(1_600_000_000).expect("in range");
    let past = Validity { not_before: noon - Duration::from_hours(24), not_after: noon };
    let expired = |kind| Some(unchecked(&issued(&book.authority, kind, past)));
    let (expired_node, expired_master) = (expired(RoleKind::Node), expired(RoleKind::Master));
    let stranger = Some(Tls::new(&issued(&other, RoleKind::Node, Validity::days(1))).expect("good keys"));
    // Signed by the other authority, and knows ours.
    let pem = issued(&other, RoleKind::Node, Validity::days(1)).pem;
    let own = pem.rfind("-----BEGIN CERT").expect("two certificates");
    let forged = Identity { kind: RoleKind::Node, pem: pem[..own].to_owned() + book.authority.certificate() };
    let forged = Some(unchecked(&forged));
    let keyless = Some(without_certificate(&book.identity(RoleKind::Node)));

    book.dial("a node with its keys", master.clone(), hello(NODE), node.clone()).await;
    book.dial("no key", master.clone(), hello(NODE), keyless).await;
    book.dial("keys of another cluster", master.clone(), hello(NODE), stranger).await;
    book.dial("a key that another authority signed", master.clone(), hello(NODE), forged).await;
    book.dial("an expired certificate", master.clone(), hello(NODE), expired_node).await;
    book.dial("a listener with an expired certificate", expired_master, hello(NODE), node.clone()).await;
    book.dial("a node that poses as a master", master.clone(), hello(MASTER), node.clone()).await;
    book.dial("a node that listens as a master", node.clone(), hello(NODE), node.clone()).await;
    book.dial("a bus with no business here", master.clone(), hello(Role::Bus(ClusterId(0))), book.tls(RoleKind::Bus))
        .await;
    book.dial("plain TCP at a port with TLS", master.clone(), hello(NODE), None).await;
    book.dial("TLS at a plain port", None, hello(NODE), node.clone()).await;
    let wrong = Hello { token: RunToken::new([8; 32]), ..hello(NODE) };
    book.dial("the token of another run", master.clone(), wrong, node.clone()).await;
    let older = Hello { version: 1, ..hello(NODE) };
    book.dial("an older protocol", master.clone(), older, node.clone()).await;
    let newer = Hello { version: 1000, ..hello(NODE) };
    book.dial("a newer protocol", None, newer, None).await;

    let none = Duration::ZERO;
    let replayed = captured(&book, master.clone(), node.clone()).await;
    assert!(replayed.len() > 500, "handshake and hello: {} bytes", replayed.len());
    book.raw("a replayed handshake and hello", master.clone(), vec![replayed], none).await;
    book.raw("TLS 1.2", master.clone(), vec![client_hello_of_tls_1_2()], none).await;
    book.raw("garbage", master.clone(), vec![b"GET / HTTP/1.1\r\n\r\n".to_vec()], none).await;
    book.raw("silence", master.clone(), Vec::new(), none).await;
    let slowly = client_hello_of_tls_1_2().chunks(1).map(<[u8]>::to_vec).collect();
    book.raw("a byte at a time", master.clone(), slowly, Duration::from_millis(100)).await;
    book.raw("a record of 64 KiB", master.clone(), vec![[&[0x16, 3, 1, 0xff, 0xff][..], &[0; 70_000]].concat()], none)
        .await;

    // The port of a master that refused all of them is as good as before.
    for (case, nonsense) in [
        ("garbage under TLS", b"GET / HTTP/1.1\r\n\r\n".to_vec()),
        ("a length of 4 GiB under TLS", vec![0xff; 4]),
        ("an empty frame under TLS", vec![0; 4]),
    ] {
        let mut listener = book.master(master.clone()).await;
        let stream = TcpStream::connect(listener.address()).await.expect("listening");
        let tls = node.as_ref().expect("keys");
        let nonsense = async {
            let mut stream = tls.connect(RoleKind::Master, stream).await.expect("a handshake");
            stream.write_all(&nonsense).await.expect("open");
            stream.flush().await.expect("open");
            stream
        };
        let (_, arrival) = tokio::join!(nonsense, listener.arrival());
        book.write(case, Some(arrival.map(|_| ()).expect_err(case).to_string()), None);
    }
    let mut listener = book.master(master).await;
    let stream = TcpStream::connect(listener.address()).await.expect("listening");
    let unencrypted = async {
        let mut stream = node.as_ref().expect("keys").connect(RoleKind::Master, stream).await.expect("a handshake");
        stream.get_mut().0.write_all(&[0x17, 3, 3, 0, 40]).await.expect("open");
        stream.get_mut().0.write_all(&[0xab; 40]).await.expect("open");
        stream
    };
    let (_, arrival) = tokio::join!(unencrypted, listener.arrival());
    book.write(
        "what is not encrypted after the handshake",
        Some(arrival.map(|_| ()).expect_err("torn").to_string()),
        None,
    );

    let text = book.text.replace(&format!("expected {PROTOCOL_VERSION}"), "expected VERSION");
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/refusals.txt");
    if std::env::var_os("MARTI_UPDATE").is_some() {
        std::fs::write(&golden, &text).expect("writable");
    }
    let expected = std::fs::read_to_string(&golden).unwrap_or_default();
    assert_eq!(text, expected, "what is said is not what {} has; MARTI_UPDATE=1 writes it anew", golden.display());
}
