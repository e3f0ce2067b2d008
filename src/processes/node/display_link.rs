//! The connection to the display, which may end and be made again: what became of it is an event, not an error.

use std::fmt;
use std::net::SocketAddr;
use std::pin::Pin;
use std::time::Duration;

use bytes::Buf;
use tokio::time::sleep;

use super::NodeError;
use super::state::Event;
use crate::ids::{Attempt, TileId};
use crate::picture::Pixels;
use crate::protocol::connection::{Connection, ConnectionError, Introduction, Receiver, Sender, connect};
use crate::protocol::hello::Role;
use crate::protocol::image::{ImageReply, TilePixels};
use crate::protocol::mac::Mac;

/// For the display to answer the hello.
const CONNECT_DEADLINE: Duration = Duration::from_secs(5);

pub struct DisplayLink {
    introduction: Introduction,
    stage: Stage,
    /// Why the last connection ended, or was not made; `None` while there is one.
    loss: Option<String>,
}

type Dialling = Pin<Box<dyn Future<Output = Result<Connection, ConnectionError>> + Send>>;

enum Stage {
    Dialling(Dialling),
    Open {
        sender: Sender<TilePixels>,
        receiver: Receiver<ImageReply>,
    },
    /// Nobody was told yet, or somebody is about to dial.
    Lost {
        told: bool,
    },
}

impl DisplayLink {
    /// The first event tells whether anybody answers.
    pub fn dial(display: SocketAddr, introduction: Introduction) -> Self {
        let mut link = Self { introduction, stage: Stage::Lost { told: true }, loss: None };
        link.redial(display, Duration::ZERO);
        link
    }

    /// Leaves whatever connection there is, and makes another after a pause.
    pub fn redial(&mut self, display: SocketAddr, pause: Duration) {
        let introduction = self.introduction.clone();
        self.loss.get_or_insert_with(|| format!("{display} does not answer"));
        self.stage = Stage::Dialling(Box::pin(async move {
            sleep(pause).await;
            connect(Role::Display, display, &introduction, CONNECT_DEADLINE).await
        }));
    }

    /// Why there is no connection; `None` if there is one.
    pub fn loss(&self) -> Option<&str> {
        self.loss.as_deref()
    }

    /// The next thing that happens. May be cancelled without losing one.
    ///
    /// # Errors
    /// The display refused a tile.
    pub async fn event(&mut self) -> Result<Event, NodeError> {
        match &mut self.stage {
            Stage::Dialling(dialling) => match dialling.await {
                Ok(connection) => {
                    let (sender, receiver) = connection.split();
                    self.stage = Stage::Open { sender, receiver };
                    self.loss = None;
                    return Ok(Event::DisplayReached);
                }
                Err(error) => self.lose(&error),
            },
            Stage::Open { receiver, .. } => match receiver.receive().await {
                Ok(Some(ImageReply::Acknowledged { tile, attempt, receipt })) => {
                    return Ok(Event::Acknowledged { tile, attempt, receipt });
                }
                Ok(Some(ImageReply::Refused(why))) => return Err(NodeError::PixelsRefused(why)),
                Ok(None) => self.lose(&"the display closed the connection"),
                Err(error) => self.lose(&error),
            },
            Stage::Lost { told: true } => std::future::pending().await,
            Stage::Lost { told: false } => {}
        }
        self.stage = Stage::Lost { told: true };
        Ok(Event::DisplayLost)
    }

    /// Without a connection nothing is sent: whoever is told that there is one again sends all that matters.
    pub async fn send(&mut self, tile: TileId, attempt: Attempt, permit: Mac, pixels: &Pixels) {
        let Stage::Open { sender, .. } = &mut self.stage else { return };
        let planes = pixels.planes();
        let crc32c = planes.iter().fold(0, |crc, plane| crc32c::crc32c_append(crc, plane));
        let [colour, depth, normal, primitive] = planes;
        let planes = colour.chain(depth).chain(normal).chain(primitive);
        if let Err(error) = sender.send_with_bulk(&TilePixels { tile, attempt, permit, crc32c }, planes).await {
            self.lose(&error);
        }
    }

    fn lose(&mut self, why: &dyn fmt::Display) {
        tracing::warn!("no display: {why}");
        self.loss = Some(why.to_string());
        self.stage = Stage::Lost { told: false };
    }
}
