//! A sender that never waits: what is sent goes through a bounded queue to a task that writes it. So a peer that does
//! not read holds up nothing but its own connection.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::mpsc::{self, error::TrySendError};

use super::{ConnectionError, Fault, Sender};
use crate::protocol::frame::Message;

/// The connection's direction ends after what was sent, when this is dropped.
#[derive(Debug)]
pub struct QueuedSender<M> {
    queue: mpsc::Sender<M>,
    peer: Arc<str>,
}

impl<M: Message + Sync> Sender<M> {
    /// For at most `messages_max` messages that are not written yet; `wire_bytes` is raised by the bytes of those that
    /// are.
    #[must_use]
    pub fn queued(mut self, messages_max: usize, wire_bytes: Arc<AtomicU64>) -> QueuedSender<M> {
        let (queue, mut messages) = mpsc::channel(messages_max);
        let peer = Arc::clone(&self.peer);
        tokio::spawn(async move {
            while let Some(message) = messages.recv().await {
                let before = self.wire_bytes();
                if let Err(error) = self.send(&message).await {
                    // The queue is closed then, which the next message meets.
                    tracing::warn!("{error}");
                    return;
                }
                wire_bytes.fetch_add(self.wire_bytes() - before, Ordering::Relaxed);
            }
        });
        QueuedSender { queue, peer }
    }
}

impl<M: Message> QueuedSender<M> {
    /// # Errors
    /// The peer has not read so many messages that the queue is full, or a message could not be written in time, for
    /// which the log has the reason: the connection is of no use any more.
    pub fn send(&self, message: M) -> Result<(), ConnectionError> {
        let fault = match self.queue.try_send(message) {
            Ok(()) => return Ok(()),
            Err(TrySendError::Full(_)) => Fault::Unread { messages: self.queue.max_capacity() },
            Err(TrySendError::Closed(_)) => Fault::Closed,
        };
        Err(fault.of(&self.peer))
    }
}
