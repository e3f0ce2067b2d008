//! The node's end of the bus: what its local memory lacks, one round trip a record.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use crate::protocol::connection::{BlockingConnection, ConnectionError, Fault, Introduction};
use crate::protocol::hello::Role;
use crate::protocol::memory::{MemoryReply, MemoryRequest};
use ground::ids::{Address, Attempt, ClusterId, TileId};
use machine::hardware::local_memory::LineSource;
use machine::hardware::transaction::FetchRequest;
use machine::hardware::transaction::PIXEL_BYTES;

/// For the bus to answer. It waits for its log, and for the requests of the other nodes.
const BUS_DEADLINE: Duration = Duration::from_secs(10);

/// A connection to the bus, and the attempt it fetches for.
#[derive(Debug)]
pub struct BusLines {
    connection: BlockingConnection<MemoryRequest, MemoryReply>,
    tile: TileId,
    attempt: Attempt,
    stall: Duration,
}

impl BusLines {
    /// # Errors
    /// The bus does not answer within its deadline, or refuses this node.
    pub fn connect(cluster: ClusterId, bus: SocketAddr, introduction: &Introduction) -> Result<Self, ConnectionError> {
        let connection = BlockingConnection::connect(Role::Bus(cluster), bus, introduction, BUS_DEADLINE)?;
        Ok(Self { connection, tile: TileId(0), attempt: Attempt(0), stall: Duration::ZERO })
    }

    /// What is fetched from here on is fetched for this attempt.
    pub fn begin(&mut self, tile: TileId, attempt: Attempt) {
        (self.tile, self.attempt) = (tile, attempt);
    }

    /// Time waited for fetches since the last call.
    pub fn take_stall(&mut self) -> Duration {
        std::mem::take(&mut self.stall)
    }

    /// Tells the bus that the attempt's pixels are written, three bytes each; it does not answer.
    ///
    /// # Errors
    /// The bus is gone.
    pub fn tell_pixels(&mut self, pixels: usize) -> Result<(), ConnectionError> {
        let bytes = u32::try_from(pixels).unwrap_or(u32::MAX).saturating_mul(PIXEL_BYTES);
        let told = MemoryRequest::Pixels { tile: self.tile, attempt: self.attempt, bytes };
        self.connection.send(&told, &[])
    }

    /// Reads a range of the image into `into`, which is as long as the range.
    ///
    /// # Errors
    /// The bus is gone, is silent, or refuses.
    pub fn read(&mut self, address: Address, into: &mut [u8]) -> Result<(), ConnectionError> {
        let bytes = u32::try_from(into.len()).unwrap_or(u32::MAX);
        self.exchange(&MemoryRequest::Bulk { address, bytes }, into)
    }

    fn exchange(&mut self, request: &MemoryRequest, into: &mut [u8]) -> Result<(), ConnectionError> {
        self.connection.send(request, &[])?;
        let fault = match self.connection.receive()? {
            (MemoryReply::Data { bytes }, data) if bytes as usize == into.len() && data.len() == into.len() => {
                into.copy_from_slice(data);
                return Ok(());
            }
            (MemoryReply::Data { .. }, data) => {
                Fault::Unexpected(format!("it answered with {} bytes, expected {}", data.len(), into.len()))
            }
            (MemoryReply::Stored, _) => Fault::Unexpected("it says that it stored, but was asked for data".to_owned()),
            (MemoryReply::Refused(why), _) => Fault::RefusedUs(why),
        };
        Err(self.connection.error(fault))
    }
}

impl LineSource for BusLines {
    type Error = ConnectionError;

    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), ConnectionError> {
        let start = Instant::now();
        let fetch = MemoryRequest::Fetch {
            tile: self.tile,
            attempt: self.attempt,
            section: request.section,
            address: request.address,
            // At most 256: the topology is proven.
            line_bytes: request.line_bytes as u16,
            lines: request.lines,
            accesses_before: request.accesses_before,
        };
        let fetched = self.exchange(&fetch, into);
        self.stall += start.elapsed();
        fetched
    }
}
