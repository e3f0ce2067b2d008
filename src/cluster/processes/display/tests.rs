//! A display between a manager and nodes that the tests play, over real sockets and a real journal.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::thread;
use std::time::Duration;

use super::*;
use crate::protocol::connection::{ConnectionError, Credentials, Listener, Receiver, Sender, connect};
use crate::protocol::control::{Bootstrap, DisplayCommand, DisplayReport};
use crate::protocol::hello::{Role, RunToken};
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::{Claim, MacKey};
use ground::ids::{Attempt, Epoch, NodeId, Producer, TileId};
use trace::picture::{AovSet, Sides, Tiling};

const TOKEN: RunToken = RunToken::new([5; 32]);
const KEY: MacKey = MacKey::new([6; 32]);
const SOON: Duration = Duration::from_secs(10);
const TILES: u32 = 6;

/// Six tiles of 4x4 pixels.
fn configuration(folder: &Path, resume: bool) -> DisplayConfiguration {
    DisplayConfiguration {
        tiling: Tiling::new(Sides { width: 12, height: 8, tile_width: 4, tile_height: 4 }).expect("possible"),
        aov: AovSet::default(),
        journal: folder.join("tiles"),
        resume,
        fingerprint: [1; 32],
        key: KEY,
        image: folder.join("image.png"),
        exr: false,
    }
}

fn planes(tile: u32) -> Vec<u8> {
    (0..16 * 3).flat_map(|i| ((100 * tile + i) as f32).to_le_bytes()).collect()
}

/// The manager's end.
struct Manager {
    to_display: Sender<DisplayCommand>,
    from_display: Receiver<DisplayReport>,
    display: thread::JoinHandle<Result<(), ProcessError>>,
}

impl Manager {
    async fn start(configuration: DisplayConfiguration) -> Self {
        let credentials = Credentials::plain(TOKEN);
        let mut manager =
            Listener::bind(Ipv4Addr::LOCALHOST.into(), credentials, |_, _| Ok(())).await.expect("loopback");
        let bootstrap = Bootstrap {
            role: Role::Display,
            epoch: Epoch(0),
            token: TOKEN,
            manager: manager.address(),
            identity: None,
            bind: None,
            advertise: None,
            log: None,
            heartbeat_milliseconds: 50,
        };
        let display = thread::spawn(|| run(&Child::new(bootstrap, false).expect("no keys")));
        let (_, connection) = manager.arrival().await.expect("the display");
        let (mut to_display, from_display) = connection.split();
        to_display.send(&DisplayCommand::Configure(configuration)).await.expect("awaited");
        Self { to_display, from_display, display }
    }

    async fn report(&mut self) -> DisplayReport {
        loop {
            match self.from_display.receive_within(SOON).await.expect("whole frames").expect("the display stays") {
                DisplayReport::Heartbeat => self.to_display.send(&DisplayCommand::Heartbeat).await.expect("awaited"),
                report => return report,
            }
        }
    }

    /// The tiles that were restored, and where it listens.
    async fn listens(&mut self) -> (Vec<u32>, SocketAddr) {
        let DisplayReport::Restored(holdings) = self.report().await else { panic!("told before it listens") };
        let DisplayReport::Listening(address) = self.report().await else { panic!("listens") };
        ((0..TILES).filter(|tile| holdings.tiles.contains(TileId(*tile))).collect(), address)
    }

    /// The tiles that were restored, and a node.
    async fn ready(&mut self) -> (Vec<u32>, Node) {
        let (restored, address) = self.listens().await;
        (restored, Node::dial(address, 2).await)
    }

    async fn finish(mut self) -> DisplayTotals {
        self.to_display.send(&DisplayCommand::Finish).await.expect("awaited");
        let DisplayReport::Finished(totals) = self.report().await else { panic!("writes the image") };
        self.end().await.expect("told to finish");
        totals
    }

    /// Hears the display out and hangs up after it, as a manager does.
    async fn end(mut self) -> Result<(), ProcessError> {
        while self.from_display.receive_within(SOON).await.expect("whole frames").is_some() {}
        drop((self.to_display, self.from_display));
        self.display.join().expect("no panic")
    }
}

struct Node {
    node: NodeId,
    sender: Sender<TilePixels>,
    receiver: Receiver<ImageReply>,
}

impl Node {
    async fn dial(address: SocketAddr, node: u16) -> Self {
        let node = NodeId(node);
        let introduction = Credentials::plain(TOKEN).introduction(Role::Node(node), Epoch(0));
        let connection = connect(Role::Display, address, &introduction, SOON).await.expect("welcome");
        let (sender, receiver) = connection.split();
        Self { node, sender, receiver }
    }

    async fn send(&mut self, tile: u32, attempt: u32, planes: &[u8]) {
        self.send_unheard(tile, attempt, planes).await.expect("awaited");
        let (tile, attempt) = (TileId(tile), Attempt(attempt));
        let receipt = KEY.receipt(Claim { tile, attempt, node: self.node, epoch: Epoch(0) });
        let reply = self.receiver.receive_within(SOON).await.expect("whole frames");
        assert_eq!(reply, Some(ImageReply::Acknowledged { tile, attempt, receipt }));
    }

    /// Without reading the reply.
    async fn send_unheard(&mut self, tile: u32, attempt: u32, planes: &[u8]) -> Result<(), ConnectionError> {
        let (tile, attempt) = (TileId(tile), Attempt(attempt));
        let permit = KEY.permit(Claim { tile, attempt, node: self.node, epoch: Epoch(0) });
        let pixels = TilePixels { tile, attempt, permit, crc32c: crc32c::crc32c(planes) };
        self.sender.send_with_bulk(&pixels, planes).await
    }
}

async fn undisturbed() -> DisplayTotals {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    let (restored, mut node) = manager.ready().await;
    assert!(restored.is_empty());
    for tile in 0..TILES {
        node.send(tile, 0, &planes(tile)).await;
    }
    manager.finish().await
}

#[tokio::test]
async fn a_display_goes_on_where_its_journal_ends() {
    let expected = undisturbed().await.sha256;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("tiles");
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    let (_, mut node) = manager.ready().await;
    for tile in [4, 1, 3] {
        node.send(tile, 0, &planes(tile)).await;
    }
    // As a kill would leave it: what was acknowledged is in the file already, and half of the next.
    let mut journal = fs::read(&path).expect("appended");
    assert_eq!(journal.len(), 68 + 3 * (32 + 192));
    manager.finish().await;
    journal.extend_from_slice(&[1; 70]);
    fs::write(&path, &journal).expect("writable");

    let mut manager = Manager::start(configuration(folder.path(), true)).await;
    let DisplayReport::Incident(dropped) = manager.report().await else { panic!("said") };
    assert!(dropped.contains("tiles: dropped the last 70 bytes"), "{dropped}");
    let (restored, mut node) = manager.ready().await;
    assert_eq!(restored, [1, 3, 4]);
    // The acknowledgement of tile 3 was lost.
    for tile in [3, 0, 2, 5] {
        node.send(tile, 0, &planes(tile)).await;
    }
    let totals = manager.finish().await;
    assert_eq!((totals.sha256, totals.tiles_done, totals.tiles_stale), (expected.clone(), TILES, 0));

    // A finished one, and one that starts over.
    let mut manager = Manager::start(configuration(folder.path(), true)).await;
    assert_eq!(manager.ready().await.0, [0, 1, 2, 3, 4, 5]);
    assert_eq!(manager.finish().await.sha256, expected);
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    assert!(manager.ready().await.0.is_empty());
    assert_eq!(manager.finish().await.tiles_done, 0);
}

#[tokio::test]
async fn a_wrong_tile_is_found_and_all_of_its_process_is_replaced() {
    let expected = undisturbed().await.sha256;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    let (_, address) = manager.listens().await;
    let (mut wrong, mut right) = (Node::dial(address, 2).await, Node::dial(address, 3).await);
    for tile in 0..TILES {
        let mut planes = planes(tile);
        planes[7] ^= u8::from(tile == 2);
        let node = if tile < 3 { &mut wrong } else { &mut right };
        node.send(tile, 0, &planes).await;
    }
    for (tile, same) in [(1, true), (2, false)] {
        right.send(tile, 1, &planes(tile)).await;
        let DisplayReport::Compared(comparison) = manager.report().await else { panic!("compared") };
        assert_eq!(comparison.kept.digest == comparison.other.digest, same);
    }
    let producer = Producer { run: TOKEN.run_id(), node: NodeId(2), epoch: Epoch(0) };
    manager.to_display.send(&DisplayCommand::Condemn(producer)).await.expect("awaited");
    let tiles = (0..TILES).map(|tile| tile < 3).collect();
    assert_eq!(manager.report().await, DisplayReport::Condemned(producer, tiles));
    for tile in 0..3 {
        right.send(tile, 2, &planes(tile)).await;
    }
    let totals = manager.finish().await;
    assert_eq!((totals.sha256, totals.tiles_done, totals.tiles_stale), (expected.clone(), TILES, 2));
    // And so it is in the journal.
    let mut manager = Manager::start(configuration(folder.path(), true)).await;
    assert_eq!(manager.ready().await.0, [0, 1, 2, 3, 4, 5]);
    assert_eq!(manager.finish().await.sha256, expected);
}

/// A display that waited for it would serve no other node.
#[tokio::test]
async fn a_node_that_does_not_read_is_dropped_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    let (_, address) = manager.listens().await;
    let (mut deaf, mut other) = (Node::dial(address, 2).await, Node::dial(address, 3).await);
    let flood = tokio::spawn(async move {
        let planes = planes(0);
        // Until the sockets' buffers are full of replies, and the queue after them.
        while deaf.send_unheard(0, 0, &planes).await.is_ok() {}
    });
    let begin = std::time::Instant::now();
    let mut tile = 1;
    while !flood.is_finished() {
        assert!(begin.elapsed() < Duration::from_secs(60), "it is never dropped");
        manager.to_display.send(&DisplayCommand::Heartbeat).await.expect("awaited");
        let asked = std::time::Instant::now();
        other.send(tile, 0, &planes(tile)).await;
        assert!(asked.elapsed() < Duration::from_secs(5), "it holds up the other");
        tile = (tile + 1).min(TILES - 1);
    }
    let DisplayReport::Incident(text) = manager.report().await else { panic!("said") };
    assert!(text.starts_with("node 2 (epoch 0) at ") && text.ends_with("did not read 64 messages"), "{text}");
    manager.finish().await;
}

#[tokio::test]
async fn a_journal_of_another_image_ends_the_display_with_its_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut manager = Manager::start(configuration(folder.path(), false)).await;
    manager.ready().await;
    manager.finish().await;
    let other = DisplayConfiguration { fingerprint: [2; 32], ..configuration(folder.path(), true) };
    let mut manager = Manager::start(other).await;
    let DisplayReport::Failed(why) = manager.report().await else { panic!("refused") };
    assert!(why.contains("tiles: is the journal of another image"), "{why}");
    assert!(manager.end().await.is_err());
}
