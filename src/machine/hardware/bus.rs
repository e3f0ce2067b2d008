//! The bus: requests wait, the arbiter grants one at a time, a completed one becomes a [`Transaction`].
//!
//! The caller moves the data and gives the time, in nanoseconds since the bus started:
//!
//! ```text
//! request(initiator, request, now)          as requests arrive
//! while let Some(grant) = grant(now)        one at a time, in the arbiter's order
//!     move what grant.request asks for, answer the initiator
//!     complete(grant, data, now)            → the transaction, for the recording
//!     or refuse(grant)                      when the cluster memory refuses it: not recorded
//! disconnect(initiator)                     when its connection ends
//! ```

use std::collections::{BTreeMap, VecDeque};

use super::arbiter::{Arbiter, Waiting};
use super::transaction::{Initiator, Request, Transaction};
use ground::ids::{Address, Attempt, ClusterId, Epoch, TileId};

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
    fetches: BTreeMap<(TileId, Attempt), FetchCount>,
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
            fetches: BTreeMap::new(),
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
    pub fn fetches_of(&self, tile: TileId, attempt: Attempt) -> FetchCount {
        self.fetches.get(&(tile, attempt)).copied().unwrap_or_default()
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
                if matches!(initiator, Initiator::Node(_)) {
                    let count = self.fetches.entry((*tile, *attempt)).or_default();
                    count.fetches += 1;
                    count.bytes += bytes;
                }
            }
            (Request::Bulk { .. }, _) => self.stats.bulk_bytes += bytes,
            (Request::Write { .. }, _) => {}
            // Their sender says how many.
            (Request::Job { .. } | Request::Pixels { .. }, _) => {
                self.stats.message_bytes = self.stats.message_bytes.saturating_add(bytes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;

    use super::*;
    use crate::hardware::arbiter::{Fifo, FixedPriority};
    use crate::hardware::transaction::{FetchRequest, Kind};
    use ground::ids::NodeId;
    use trace::database::Section;

    const N0: Initiator = Initiator::Node(NodeId(0));
    const N7: Initiator = Initiator::Node(NodeId(7));

    fn bus(arbiter: impl Arbiter + 'static) -> Bus {
        Bus::new(ClusterId(2), Epoch(1), Box::new(arbiter))
    }

    const FETCH: FetchRequest = FetchRequest {
        section: Section::Triangles,
        address: Address(512),
        line_bytes: 64,
        lines: 0b101,
        accesses_before: 30,
    };

    fn fetch(tile: u32) -> Request {
        Request::Fetch { tile: TileId(tile), attempt: Attempt(0), fetch: FETCH }
    }

    #[test]
    fn a_transaction_holds_the_bus_until_it_completes() {
        let mut bus = bus(Fifo);
        bus.request(N7, fetch(5), 100).expect("room");
        bus.request(N0, fetch(6), 110).expect("room");
        let first = bus.grant(120).expect("waiting");
        assert_eq!(first.initiator, N7);
        assert!(bus.grant(125).is_none(), "held");
        let row = bus.complete(first, &[9; 128], 130);
        let expected = Transaction {
            sequence: 0,
            epoch: Epoch(1),
            cluster: ClusterId(2),
            kind: Kind::Fetch,
            node: Some(NodeId(7)),
            tile: Some(TileId(5)),
            attempt: Some(Attempt(0)),
            section: Some(Section::Triangles),
            address: Some(Address(512)),
            bytes: 128,
            lines: Some(0b101),
            crc32c: Some(crc32c::crc32c(&[9; 128])),
            accesses_before: Some(30),
            request_nanoseconds: 100,
            grant_nanoseconds: 120,
            completion_nanoseconds: 130,
        };
        assert_eq!(row, expected);
        let second = bus.grant(131).expect("waiting");
        let row = bus.complete(second, &[0; 128], 140);
        assert_eq!((row.sequence, row.node, row.request_nanoseconds), (1, Some(NodeId(0)), 110));
        assert!(bus.grant(141).is_none(), "nothing waits");
    }

    #[test]
    fn a_refused_request_leaves_no_gap() {
        let mut bus = bus(Fifo);
        bus.request(N0, Request::Bulk { address: Address(u64::MAX), bytes: 1 }, 0).expect("room");
        bus.request(N7, Request::Bulk { address: Address(256), bytes: 3 }, 0).expect("room");
        let refused = bus.grant(1).expect("waiting");
        bus.refuse(refused);
        let served = bus.grant(2).expect("waiting");
        assert_eq!(bus.complete(served, &[1, 2, 3], 3).sequence, 0);
        assert_eq!(bus.stats(), BusStats { transactions: 1, bulk_bytes: 3, ..BusStats::default() });
    }

    #[test]
    fn requests_of_one_initiator_keep_their_order_and_their_limit() {
        let mut bus = bus(FixedPriority);
        for tile in 0..PENDING_MAX as u32 {
            bus.request(N0, fetch(tile), 0).expect("room");
        }
        assert_eq!(bus.request(N0, fetch(0), 0), Err(QueueFull { initiator: N0 }));
        assert_eq!((bus.room(N0), bus.room(N7)), (0, PENDING_MAX));
        let granted = std::iter::from_fn(|| {
            let grant = bus.grant(0)?;
            bus.complete(grant, &[0; 128], 0).tile
        });
        assert!(granted.map(|tile| tile.0).eq(0..PENDING_MAX as u32));
    }

    #[test]
    fn a_disconnected_initiator_is_not_granted() {
        let mut bus = bus(Fifo);
        bus.request(N0, fetch(0), 0).expect("room");
        bus.request(N0, fetch(0), 0).expect("room");
        assert_eq!((bus.disconnect(N0), bus.disconnect(N7)), (2, 0));
        assert!(bus.grant(0).is_none());
    }

    #[test]
    fn every_kind_is_counted_and_recorded_as_what_it_is() {
        let mut bus = bus(Fifo);
        let (tile, attempt) = (TileId(3), Attempt(1));
        let write = Request::Write { address: Address(0), data: Bytes::from_static(b"upload") };
        let requests = [
            (Initiator::Loader, write, vec![]),
            (Initiator::Master, Request::Job { node: NodeId(7), tile, attempt, bytes: 4 }, vec![]),
            (N7, fetch(3), vec![0; 128]),
            (N7, Request::Fetch { tile, attempt, fetch: FETCH }, vec![0; 128]),
            (N7, Request::Pixels { tile, attempt, bytes: 75 }, vec![]),
        ];
        let mut rows = Vec::new();
        for (initiator, request, data) in requests {
            bus.request(initiator, request, 0).expect("room");
            let grant = bus.grant(0).expect("waiting");
            rows.push(bus.complete(grant, &data, 0));
        }
        let kinds: Vec<_> = rows.iter().map(|row| (row.kind, row.node, row.bytes, row.crc32c.is_some())).collect();
        let n7 = Some(NodeId(7));
        let expected = [
            (Kind::Write, None, 6, true),
            (Kind::Job, n7, 4, false),
            (Kind::Fetch, n7, 128, true),
            (Kind::Fetch, n7, 128, true),
            (Kind::Pixels, n7, 75, false),
        ];
        assert_eq!(kinds, expected);
        assert_eq!(rows[0].crc32c, Some(crc32c::crc32c(b"upload")));
        let expected = BusStats { transactions: 5, fetches: 2, fetched_bytes: 256, bulk_bytes: 0, message_bytes: 79 };
        assert_eq!(bus.stats(), expected);
        let count = |attempt| bus.fetches_of(tile, Attempt(attempt));
        assert_eq!(
            (count(0), count(1)),
            (FetchCount { fetches: 1, bytes: 128 }, FetchCount { fetches: 1, bytes: 128 })
        );
        assert_eq!(bus.fetches_of(TileId(9999), attempt), FetchCount::default());
    }
}
