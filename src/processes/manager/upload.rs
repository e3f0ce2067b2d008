//! Loads the database into the bus.

use std::net::SocketAddr;
use std::time::Duration;

use crate::ids::Address;
use crate::protocol::connection::connect;
use crate::protocol::hello::{Hello, Role};
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};

/// Stores the image piece by piece; `deadline` is for each of them.
///
/// # Errors
/// The bus is gone, refuses a piece, or does not answer in time.
pub(super) async fn upload(bus: SocketAddr, hello: &Hello, image: &[u8], deadline: Duration) -> Result<(), String> {
    let connection = connect(Role::Bus, bus, hello, deadline).await.map_err(|error| error.to_string())?;
    let (mut sender, mut receiver) = connection.split::<MemoryRequest, MemoryReply>();
    let mut address = Address(0);
    for piece in image.chunks(BULK_BYTES_MAX as usize) {
        let stored = async {
            sender.send_with_bulk(&MemoryRequest::Store { address }, piece).await?;
            receiver.receive_within(deadline).await
        };
        match stored.await.map_err(|error| error.to_string())? {
            Some(MemoryReply::Stored) => address.0 += piece.len() as u64,
            Some(MemoryReply::Refused(why)) => return Err(format!("the bus refused {address}: {why}")),
            Some(MemoryReply::Data { .. }) => return Err("the bus answered with data".to_owned()),
            None => return Err("the bus closed the connection".to_owned()),
        }
    }
    sender.finish().await;
    Ok(())
}
