//! Loads the database into a bus.

use std::net::SocketAddr;
use std::time::Duration;

use crate::protocol::connection::{Credentials, Receiver, Sender, connect};
use crate::protocol::hello::Role;
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::{Address, ClusterId, Epoch};

/// A connection to a bus, in the loader's place.
pub(super) struct Loader {
    sender: Sender<MemoryRequest>,
    receiver: Receiver<MemoryReply>,
    /// For every reply.
    deadline: Duration,
}

impl Loader {
    /// # Errors
    /// The bus does not answer in time, or refuses this process.
    pub(super) async fn connect(
        cluster: ClusterId,
        bus: SocketAddr,
        credentials: &Credentials,
        deadline: Duration,
    ) -> Result<Self, String> {
        let introduction = credentials.introduction(Role::Manager, Epoch(0));
        let connection =
            connect(Role::Bus(cluster), bus, &introduction, deadline).await.map_err(|error| error.to_string())?;
        let (sender, receiver) = connection.split();
        Ok(Self { sender, receiver, deadline })
    }

    /// Stores all of an image, from address 0 on.
    ///
    /// # Errors
    /// As [`Self::store`]'s.
    pub(super) async fn store_all(&mut self, image: &[u8]) -> Result<(), String> {
        let mut address = Address(0);
        for piece in image.chunks(BULK_BYTES_MAX as usize) {
            self.store(address, piece).await?;
            address.0 += piece.len() as u64;
        }
        Ok(())
    }

    /// Stores at most [`BULK_BYTES_MAX`]; `address` is where the piece before ended.
    ///
    /// # Errors
    /// The bus is gone, refuses the piece, or does not answer in time.
    pub(super) async fn store(&mut self, address: Address, piece: &[u8]) -> Result<(), String> {
        let stored = async {
            self.sender.send_with_bulk(&MemoryRequest::Store { address }, piece).await?;
            self.receiver.receive_within(self.deadline).await
        };
        match stored.await.map_err(|error| error.to_string())? {
            Some(MemoryReply::Stored) => Ok(()),
            Some(MemoryReply::Refused(why)) => Err(format!("the bus refused {address}: {why}")),
            Some(MemoryReply::Data { .. }) => Err("the bus answered with data".to_owned()),
            None => Err("the bus closed the connection".to_owned()),
        }
    }

    /// Says that nothing more comes.
    pub(super) async fn leave(self) {
        self.sender.finish().await;
    }
}
