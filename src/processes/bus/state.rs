//! What a bus process decides: who may ask for what, who is served next, and with which bytes.
//!
//! Pure: the sockets and the clock are those of [`super::memory_loop`].

use bytes::Bytes;

use crate::codec;
use crate::database::Layout;
use crate::ids::Epoch;
use crate::machine::arbiter;
use crate::machine::bus::{Bus, Grant, QueueFull};
use crate::machine::cluster_memory::{AccessError, ClusterMemory};
use crate::machine::transaction::{FetchRequest, Initiator, Request, Transaction};
use crate::protocol::control::{BusConfiguration, BusTotals, LostAttempt};
use crate::protocol::hello::Role;
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};

/// Why a request is not served. The connection ends with it.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Refusal {
    #[error("{asked} is not for this process: the manager stores, the master tells jobs, nodes fetch and send pixels")]
    NotYours { asked: &'static str },
    #[error("{asked} with {bytes} bulk bytes, expected {expected}")]
    Bulk { asked: &'static str, bytes: usize, expected: &'static str },
    #[error("a range of {bytes} bytes, expected 1 to {BULK_BYTES_MAX}")]
    Range { bytes: u32 },
    #[error("the section of a fetch is not that of its address")]
    Section,
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    QueueFull(#[from] QueueFull),
}

/// Cluster memory and the right to it.
pub struct State {
    layout: Layout,
    memory: ClusterMemory,
    bus: Bus,
}

/// The place on the bus that a role has; `None` for roles that have no business there.
pub fn initiator(role: Role) -> Option<Initiator> {
    match role {
        Role::Manager => Some(Initiator::Loader),
        Role::Master => Some(Initiator::Master),
        Role::Node(node) => Some(Initiator::Node(node)),
        Role::Bus | Role::Display => None,
    }
}

impl State {
    pub fn new(configuration: &BusConfiguration, epoch: Epoch) -> Self {
        Self {
            memory: ClusterMemory::new(&configuration.layout),
            layout: configuration.layout.clone(),
            bus: Bus::new(configuration.cluster, epoch, arbiter::new(configuration.arbiter)),
        }
    }

    /// Takes a request and the bulk bytes that came with it. `now` is in nanoseconds since the bus started,
    /// here as below.
    ///
    /// # Errors
    /// The initiator may not ask for that, or not so.
    pub fn request(
        &mut self,
        initiator: Initiator,
        message: MemoryRequest,
        bulk: &[u8],
        now: u64,
    ) -> Result<(), Refusal> {
        let request = self.admissible(initiator, message, bulk)?;
        Ok(self.bus.request(initiator, request, now)?)
    }

    /// Whom to [`serve`](Self::serve) next, in the arbiter's order.
    pub fn grant(&mut self, now: u64) -> Option<Grant> {
        self.bus.grant(now)
    }

    /// Moves the data of a grant and appends the frame that answers it, if any, to `out`, without a copy in
    /// between.
    ///
    /// # Errors
    /// The cluster memory has no such bytes; `out` is as it was.
    pub fn serve(
        &mut self,
        grant: Grant,
        out: &mut Vec<u8>,
        now: impl FnOnce() -> u64,
    ) -> Result<Transaction, Refusal> {
        match move_data(&mut self.memory, &grant.request, out) {
            Ok(data_bytes) => {
                let data = out.get(out.len() - data_bytes..).unwrap_or_default();
                Ok(self.bus.complete(grant, data, now()))
            }
            Err(error) => {
                self.bus.refuse(grant);
                Err(error.into())
            }
        }
    }

    /// Frees the bus of a grant whose initiator has left.
    pub fn abandon(&mut self, grant: Grant) {
        self.bus.refuse(grant);
    }

    /// Forgets what an initiator has asked for.
    pub fn disconnect(&mut self, initiator: Initiator) {
        self.bus.disconnect(initiator);
    }

    /// What crossed the bus; the log and the wire are counted by others.
    pub fn totals(&self, lost: &[LostAttempt]) -> BusTotals {
        let stats = self.bus.stats();
        let mut totals = BusTotals {
            transactions: stats.transactions,
            fetches: stats.fetches,
            fetched_bytes: stats.fetched_bytes,
            bulk_bytes: stats.bulk_bytes,
            message_bytes: stats.message_bytes,
            ..BusTotals::default()
        };
        for attempt in lost {
            let fetched = self.bus.fetches_of(attempt.node, attempt.tile, attempt.attempt);
            totals.fetches_of_lost_attempts += fetched.fetches;
            totals.fetched_bytes_of_lost_attempts += fetched.bytes;
        }
        totals
    }

    fn admissible(&self, initiator: Initiator, message: MemoryRequest, bulk: &[u8]) -> Result<Request, Refusal> {
        let asked = name(&message);
        if let MemoryRequest::Store { address } = message {
            return match initiator {
                Initiator::Loader if bulk.is_empty() => {
                    Err(Refusal::Bulk { asked, bytes: 0, expected: "the bytes to store" })
                }
                Initiator::Loader => Ok(Request::Write { address, data: Bytes::copy_from_slice(bulk) }),
                Initiator::Master | Initiator::Node(_) => Err(Refusal::NotYours { asked }),
            };
        }
        if !bulk.is_empty() {
            return Err(Refusal::Bulk { asked, bytes: bulk.len(), expected: "none" });
        }
        match (initiator, message) {
            (
                Initiator::Node(_),
                MemoryRequest::Fetch { tile, attempt, section, address, line_bytes, lines, accesses_before },
            ) => {
                if self.layout.section_at(address).is_some_and(|found| found != section) {
                    return Err(Refusal::Section);
                }
                let line_bytes = u32::from(line_bytes);
                let fetch = FetchRequest { section, address, line_bytes, lines, accesses_before };
                Ok(Request::Fetch { tile, attempt, fetch })
            }
            (Initiator::Node(_), MemoryRequest::Bulk { address, bytes }) => {
                if !(1..=BULK_BYTES_MAX).contains(&bytes) {
                    return Err(Refusal::Range { bytes });
                }
                Ok(Request::Bulk { address, bytes })
            }
            (Initiator::Node(_), MemoryRequest::Pixels { tile, attempt, bytes }) => {
                Ok(Request::Pixels { tile, attempt, bytes })
            }
            (Initiator::Master, MemoryRequest::Job { node, tile, attempt, bytes }) => {
                Ok(Request::Job { node, tile, attempt, bytes })
            }
            _ => Err(Refusal::NotYours { asked }),
        }
    }
}

/// Does what is asked and appends the answer; returns how many bytes at its end are the data moved back.
fn move_data(memory: &mut ClusterMemory, request: &Request, out: &mut Vec<u8>) -> Result<usize, AccessError> {
    let bytes = match request {
        Request::Fetch { fetch, .. } => {
            let lines = memory.lines(fetch)?;
            encode(&MemoryReply::Data { bytes: fetch.bytes() }, out, |out| {
                lines.for_each(|line| out.extend_from_slice(line));
            });
            fetch.bytes()
        }
        Request::Bulk { address, bytes } => {
            let range = memory.range(*address, u64::from(*bytes))?;
            encode(&MemoryReply::Data { bytes: *bytes }, out, |out| out.extend_from_slice(range));
            *bytes
        }
        Request::Write { address, data } => {
            memory.store(*address, data)?;
            encode(&MemoryReply::Stored, out, |_| ());
            0
        }
        Request::Job { .. } | Request::Pixels { .. } => 0,
    };
    Ok(bytes as usize)
}

/// Replies are short, and their bulk bytes were checked when they were asked for.
fn encode(reply: &MemoryReply, out: &mut Vec<u8>, append_bulk: impl FnOnce(&mut Vec<u8>)) {
    codec::encode_into(reply, out, append_bulk).expect("a reply of the bus is within its limits");
}

fn name(message: &MemoryRequest) -> &'static str {
    match message {
        MemoryRequest::Fetch { .. } => "a fetch",
        MemoryRequest::Bulk { .. } => "a bulk read",
        MemoryRequest::Store { .. } => "a store",
        MemoryRequest::Job { .. } => "a job",
        MemoryRequest::Pixels { .. } => "pixels",
    }
}
