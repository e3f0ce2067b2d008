//! What a bus process decides: who may ask for what, who is served next, and with which bytes.
//!
//! Pure: the sockets and the clock are those of [`super::memory_loop`].

use bytes::Bytes;

use crate::protocol::control::BusConfiguration;
use crate::protocol::frame;
use crate::protocol::hello::Role;
use crate::protocol::memory::{BULK_BYTES_MAX, MemoryReply, MemoryRequest};
use ground::ids::Epoch;
use machine::hardware::arbiter;
use machine::hardware::bus::{Bus, Grant, QueueFull};
use machine::hardware::cluster_memory::{AccessError, ClusterMemory};
use machine::hardware::totals::{BusTotals, LostAttempt};
use machine::hardware::transaction::{FetchRequest, Initiator, Request, Transaction};
use trace::database::Layout;

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
        Role::Master(_) => Some(Initiator::Master),
        Role::Node(node) => Some(Initiator::Node(node)),
        Role::Bus(_) | Role::Display => None,
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
            let fetched = self.bus.fetches_of(attempt.tile, attempt.attempt);
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
    frame::encode_into(reply, out, append_bulk).expect("a reply of the bus is within its limits");
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::frame::PREFIX_BYTES;
    use ground::ids::{Address, Attempt, ClusterId, NodeId, TileId};
    use machine::hardware::specification::Arbiter;
    use machine::hardware::transaction::Kind;
    use trace::database::Section;

    const NODE: Initiator = Initiator::Node(NodeId(1));

    /// 64 octree nodes in one granule, 100 materials in the next ones; byte i of the image is i mod 251.
    fn image() -> Vec<u8> {
        (0..layout().database_bytes()).map(|i| (i % 251) as u8).collect()
    }

    fn layout() -> Layout {
        Layout::new([64, 0, 0, 0, 0, 0, 0, 100, 0]).expect("small")
    }

    fn loaded(arbiter: Arbiter) -> State {
        let configuration =
            BusConfiguration { cluster: ClusterId(0), arbiter, layout: layout(), recording: "unused".into() };
        let mut state = State::new(&configuration, Epoch(2));
        let (reply, _) =
            exchange(&mut state, Initiator::Loader, MemoryRequest::Store { address: Address(0) }, &image())
                .expect("in order");
        assert_eq!(frame::decode(&reply[PREFIX_BYTES..]), Ok((MemoryReply::Stored, &[][..])));
        state
    }

    fn exchange(
        state: &mut State,
        initiator: Initiator,
        message: MemoryRequest,
        bulk: &[u8],
    ) -> Result<(Vec<u8>, Transaction), Refusal> {
        state.request(initiator, message, bulk, 10)?;
        let grant = state.grant(20).expect("the only one");
        let mut out = Vec::new();
        let transaction = state.serve(grant, &mut out, || 30)?;
        Ok((out, transaction))
    }

    fn fetch(address: u64, line_bytes: u16, lines: u32) -> MemoryRequest {
        let section = layout().section_at(Address(address)).unwrap_or(Section::Materials);
        let (tile, attempt) = (TileId(4), Attempt(1));
        MemoryRequest::Fetch {
            tile,
            attempt,
            section,
            address: Address(address),
            line_bytes,
            lines,
            accesses_before: 9,
        }
    }

    #[test]
    fn a_fetch_brings_the_lines_of_its_mask_and_a_row() {
        let mut state = loaded(Arbiter::Fifo);
        let (reply, row) = exchange(&mut state, NODE, fetch(256, 64, 0b1011), &[]).expect("good");
        let expected = [&image()[256..384], &image()[448..512]].concat();
        assert_eq!(frame::decode(&reply[PREFIX_BYTES..]), Ok((MemoryReply::Data { bytes: 192 }, &expected[..])));
        assert_eq!((row.kind, row.sequence, row.epoch, row.bytes), (Kind::Fetch, 1, Epoch(2), 192));
        assert_eq!((row.node, row.tile, row.attempt), (Some(NodeId(1)), Some(TileId(4)), Some(Attempt(1))));
        assert_eq!(row.crc32c, Some(crc32c::crc32c(&expected)));
        assert_eq!((row.request_nanoseconds, row.grant_nanoseconds, row.completion_nanoseconds), (10, 20, 30));
    }

    #[test]
    fn what_may_not_be_asked_is_refused_and_the_bus_is_free_after_it() {
        let mut state = loaded(Arbiter::Fifo);
        let end = layout().database_bytes();
        let (tile, attempt, node) = (TileId(0), Attempt(0), NodeId(0));
        let bulk = |address, bytes| MemoryRequest::Bulk { address: Address(address), bytes };
        let job = MemoryRequest::Job { node, tile, attempt, bytes: 4 };
        let wrong_section = MemoryRequest::Fetch {
            tile,
            attempt,
            section: Section::Spheres,
            address: Address(0),
            line_bytes: 64,
            lines: 1,
            accesses_before: 0,
        };
        let cases: [(Initiator, MemoryRequest, &[u8], &str); 17] = [
            (NODE, MemoryRequest::Store { address: Address(end) }, &[1], "a store is not for this process"),
            (Initiator::Master, MemoryRequest::Store { address: Address(end) }, &[1], "a store is not"),
            (NODE, job.clone(), &[], "a job is not for this process"),
            (Initiator::Loader, job, &[], "a job is not for this process"),
            (Initiator::Loader, fetch(0, 64, 1), &[], "a fetch is not for this process"),
            (Initiator::Master, bulk(0, 4), &[], "a bulk read is not for this process"),
            (NODE, fetch(0, 64, 1), &[1, 2], "a fetch with 2 bulk bytes, expected none"),
            (Initiator::Loader, MemoryRequest::Store { address: Address(end) }, &[], "expected the bytes to store"),
            (Initiator::Loader, MemoryRequest::Store { address: Address(0) }, &[1; 256], "in order"),
            (Initiator::Loader, MemoryRequest::Store { address: Address(end) }, &[1; 256], "outside of the image"),
            (NODE, bulk(0, 0), &[], "a range of 0 bytes"),
            (NODE, bulk(0, BULK_BYTES_MAX + 1), &[], "expected 1 to 4194304"),
            (NODE, bulk(end - 4, 8), &[], "outside of the image"),
            (NODE, bulk(u64::MAX, 8), &[], "outside of the image"),
            (NODE, fetch(0, 48, 1), &[], "power of two"),
            (NODE, fetch(32, 64, 1), &[], "multiple of its line"),
            (NODE, wrong_section, &[], "section"),
        ];
        for (initiator, message, bulk, expected) in cases {
            let refusal = exchange(&mut state, initiator, message.clone(), bulk).expect_err(expected).to_string();
            assert!(refusal.contains(expected), "{message:?}: {refusal}");
        }
        for (message, expected) in [
            (fetch(0, 8, 1), "16 to 256"),
            (fetch(0, 512, 1), "16 to 256"),
            (fetch(0, 64, 0b10), "first line"),
            (fetch(end - 64, 64, 0b11), "outside of the image"),
            (fetch(1 << 40, 64, 1), "outside of the image"),
        ] {
            let refusal = exchange(&mut state, NODE, message.clone(), &[]).expect_err(expected).to_string();
            assert!(refusal.contains(expected), "{message:?}: {refusal}");
        }
        assert!(exchange(&mut state, NODE, fetch(end - 64, 64, 1), &[]).is_ok());
        assert_eq!(state.totals(&[]).transactions, 2, "the upload and the last fetch");
    }

    #[test]
    fn nothing_is_fetched_before_it_is_uploaded() {
        let configuration = BusConfiguration {
            cluster: ClusterId(0),
            arbiter: Arbiter::Fifo,
            layout: layout(),
            recording: "unused".into(),
        };
        let mut state = State::new(&configuration, Epoch(0));
        let refusal = exchange(&mut state, NODE, fetch(0, 64, 1), &[]).expect_err("empty").to_string();
        assert!(refusal.contains("not uploaded yet"), "{refusal}");
    }

    #[test]
    fn the_arbiter_decides_who_is_next() {
        let nodes = [3, 0, 2].map(|n| Initiator::Node(NodeId(n)));
        for (arbiter, expected) in [(Arbiter::Fifo, [3, 0, 2]), (Arbiter::FixedPriority, [0, 2, 3])] {
            let mut state = loaded(arbiter);
            for node in nodes {
                state.request(node, fetch(0, 16, 1), &[], 0).expect("good");
            }
            let granted = [(); 3].map(|()| {
                let grant = state.grant(1).expect("three wait");
                assert!(state.grant(1).is_none(), "one transaction at a time");
                let node = grant.initiator;
                state.serve(grant, &mut Vec::new(), || 2).expect("good");
                node
            });
            assert_eq!(granted, expected.map(|n| Initiator::Node(NodeId(n))), "{arbiter:?}");
        }
    }

    #[test]
    fn totals_tell_the_lost_apart() {
        let mut state = loaded(Arbiter::Fifo);
        let (tile, attempt) = (TileId(4), Attempt(1));
        exchange(&mut state, NODE, fetch(0, 64, 0b111), &[]).expect("good");
        exchange(&mut state, NODE, fetch(256, 16, 1), &[]).expect("good");
        let mut other = fetch(0, 128, 1);
        if let MemoryRequest::Fetch { attempt, .. } = &mut other {
            *attempt = Attempt(2);
        }
        exchange(&mut state, Initiator::Node(NodeId(2)), other, &[]).expect("good");
        exchange(&mut state, NODE, MemoryRequest::Bulk { address: Address(0), bytes: 100 }, &[]).expect("good");
        exchange(&mut state, NODE, MemoryRequest::Pixels { tile, attempt, bytes: 75 }, &[]).expect("good");
        let job = MemoryRequest::Job { node: NodeId(1), tile, attempt, bytes: 4 };
        let (reply, row) = exchange(&mut state, Initiator::Master, job, &[]).expect("good");
        assert!(reply.is_empty(), "a job is not answered");
        assert_eq!((row.kind, row.node), (Kind::Job, Some(NodeId(1))));
        let expected = BusTotals {
            transactions: 7,
            fetches: 3,
            fetched_bytes: 192 + 16 + 128,
            bulk_bytes: 100,
            message_bytes: 75 + 4,
            fetches_of_lost_attempts: 2,
            fetched_bytes_of_lost_attempts: 192 + 16,
            ..BusTotals::default()
        };
        assert_eq!(state.totals(&[LostAttempt { tile, attempt }]), expected);
    }
}
