//! The bus: requests wait, the arbiter grants one at a time, a completed one becomes a [`Transaction`].
//!
//! Who drives it moves the data and tells the time, in nanoseconds since the bus started:
//!
//! ```text
//! request(initiator, request, now)          as requests arrive
//! while let Some(grant) = grant(now)        one at a time, in the arbiter's order
//!     move what grant.request asks for, answer the initiator
//!     complete(grant, data, now)            → the transaction, for the recording
//!     or refuse(grant)                      when the cluster memory refuses it: not recorded
//! disconnect(initiator)                     when its connection ends
//! ```

use std::collections::{BTreeMap, HashMap, VecDeque};

use super::arbiter::{Arbiter, Waiting};
use super::transaction::{Initiator, Request, Transaction};
use crate::ids::{Address, Attempt, ClusterId, Epoch, NodeId, TileId};

/// Most requests of one initiator that may wait. Who drives the bus stops reading from an initiator
/// that has no room left.
pub const PENDING_MAX: usize = 64;

/// An initiator has [`PENDING_MAX`] requests waiting already.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{initiator:?} has {PENDING_MAX} requests waiting already")]
pub struct QueueFull {
    pub initiator: Initiator,
}

/// The right to use the bus, until it is given to [`Bus::complete`] or [`Bus::refuse`].
#[derive(Debug)]
#[must_use = "the bus is held until the grant is completed or refused"]
pub struct Grant {
    pub initiator: Initiator,
    pub request: Request,
    request_nanoseconds: u64,
    grant_nanoseconds: u64,
}

/// What crossed the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct BusStats {
    pub transactions: u64,
    pub fetches: u64,
    pub fetched_bytes: u64,
    pub bulk_bytes: u64,
    /// Modelled jobs and pixels.
    pub message_bytes: u64,
    pub writes: u64,
    pub written_bytes: u64,
}

/// The fetches made for one attempt at a tile.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct FetchCount {
    pub fetches: u64,
    pub bytes: u64,
}

#[derive(Debug)]
struct Pending {
    request: Request,
    arrival: u64,
    request_nanoseconds: u64,
}

/// The state of one cluster's bus.
pub struct Bus {
    cluster: ClusterId,
    epoch: Epoch,
    arbiter: Box<dyn Arbiter>,
    /// Only initiators with a request waiting have an entry.
    pending: BTreeMap<Initiator, VecDeque<Pending>>,
    /// The heads of `pending`, rebuilt for each grant.
    waiting: Vec<Waiting>,
    /// A grant is out.
    held: bool,
    arrivals: u64,
    stats: BusStats,
    fetches: HashMap<(NodeId, TileId, Attempt), FetchCount>,
}

impl Bus {
    pub fn new(cluster: ClusterId, epoch: Epoch, arbiter: Box<dyn Arbiter>) -> Self {
        Self {
            cluster,
            epoch,
            arbiter,
            pending: BTreeMap::new(),
            waiting: Vec::new(),
            held: false,
            arrivals: 0,
            stats: BusStats::default(),
            fetches: HashMap::new(),
        }
    }

    /// How many more requests of an initiator may wait.
    pub fn room(&self, initiator: Initiator) -> usize {
        PENDING_MAX - self.pending.get(&initiator).map_or(0, VecDeque::len)
    }

    /// Takes a request; those of one initiator are granted in the order in which they came.
    ///
    /// # Errors
    /// The initiator has no [`room`](Self::room).
    pub fn request(&mut self, initiator: Initiator, request: Request, now_nanoseconds: u64) -> Result<(), QueueFull> {
        if self.room(initiator) == 0 {
            return Err(QueueFull { initiator });
        }
        let pending = Pending { request, arrival: self.arrivals, request_nanoseconds: now_nanoseconds };
        self.arrivals += 1;
        self.pending.entry(initiator).or_default().push_back(pending);
        Ok(())
    }

    /// The next request in the arbiter's order; `None` when none waits or the bus is held.
    pub fn grant(&mut self, now_nanoseconds: u64) -> Option<Grant> {
        if self.held {
            return None;
        }
        self.waiting.clear();
        self.waiting.extend(self.pending.iter().filter_map(|(&initiator, queue)| {
            queue.front().map(|oldest| Waiting { initiator, arrival: oldest.arrival })
        }));
        let initiator = self.arbiter.grant(&self.waiting)?;
        let queue = self.pending.get_mut(&initiator)?;
        let pending = queue.pop_front()?;
        if queue.is_empty() {
            self.pending.remove(&initiator);
        }
        self.held = true;
        Some(Grant {
            initiator,
            request: pending.request,
            request_nanoseconds: pending.request_nanoseconds,
            grant_nanoseconds: now_nanoseconds,
        })
    }

    /// Frees the bus and counts the transaction. `data` are the bytes sent back: of a fetch its lines in
    /// ascending order, of a bulk its range, empty otherwise.
    pub fn complete(&mut self, grant: Grant, data: &[u8], now_nanoseconds: u64) -> Transaction {
        self.held = false;
        let transaction = self.record(&grant, data, now_nanoseconds);
        self.count(&grant, transaction.bytes);
        transaction
    }

    /// Frees the bus without a transaction: the request cannot be served.
    pub fn refuse(&mut self, grant: Grant) {
        drop(grant);
        self.held = false;
    }

    /// Forgets what an initiator was waiting for; returns how many requests these were.
    pub fn disconnect(&mut self, initiator: Initiator) -> usize {
        self.pending.remove(&initiator).map_or(0, |queue| queue.len())
    }

    pub fn stats(&self) -> BusStats {
        self.stats
    }

    /// The fetches of an attempt, zero if it made none.
    pub fn fetches_of(&self, node: NodeId, tile: TileId, attempt: Attempt) -> FetchCount {
        self.fetches.get(&(node, tile, attempt)).copied().unwrap_or_default()
    }

    fn record(&self, grant: &Grant, data: &[u8], now_nanoseconds: u64) -> Transaction {
        let asked_by = match grant.initiator {
            Initiator::Node(node) => Some(node),
            Initiator::Loader | Initiator::Master => None,
        };
        let mut row = Transaction {
            sequence: self.stats.transactions,
            epoch: self.epoch,
            cluster: self.cluster,
            kind: grant.request.kind(),
            node: asked_by,
            tile: None,
            attempt: None,
            section: None,
            address: None,
            bytes: grant.request.bytes(),
            lines: None,
            crc32c: None,
            accesses_before: None,
            request_nanoseconds: grant.request_nanoseconds,
            grant_nanoseconds: grant.grant_nanoseconds,
            completion_nanoseconds: now_nanoseconds,
        };
        let moved = |row: &mut Transaction, address: Address, data: &[u8]| {
            debug_assert_eq!(data.len(), row.bytes as usize, "the data are not those of the request");
            row.address = Some(address);
            row.crc32c = Some(crc32c::crc32c(data));
        };
        match &grant.request {
            Request::Fetch { tile, attempt, fetch } => {
                (row.tile, row.attempt) = (Some(*tile), Some(*attempt));
                row.section = Some(fetch.section);
                row.lines = Some(fetch.lines);
                row.accesses_before = Some(fetch.accesses_before);
                moved(&mut row, fetch.address, data);
            }
            Request::Bulk { address, .. } => moved(&mut row, *address, data),
            Request::Write { address, data } => moved(&mut row, *address, data),
            Request::Job { node, tile, attempt, .. } => {
                (row.node, row.tile, row.attempt) = (Some(*node), Some(*tile), Some(*attempt));
            }
            Request::Pixels { tile, attempt, .. } => (row.tile, row.attempt) = (Some(*tile), Some(*attempt)),
        }
        row
    }

    fn count(&mut self, grant: &Grant, bytes: u32) {
        let bytes = u64::from(bytes);
        self.stats.transactions += 1;
        match (&grant.request, grant.initiator) {
            (Request::Fetch { tile, attempt, .. }, initiator) => {
                self.stats.fetches += 1;
                self.stats.fetched_bytes += bytes;
                if let Initiator::Node(node) = initiator {
                    let count = self.fetches.entry((node, *tile, *attempt)).or_default();
                    count.fetches += 1;
                    count.bytes += bytes;
                }
            }
            (Request::Bulk { .. }, _) => self.stats.bulk_bytes += bytes,
            (Request::Write { .. }, _) => {
                self.stats.writes += 1;
                self.stats.written_bytes += bytes;
            }
            (Request::Job { .. } | Request::Pixels { .. }, _) => self.stats.message_bytes += bytes,
        }
    }
}
