//! One connection to the bus: a node's or the master's, on a thread of its own. It sends the recorded requests again, one
//! request at a time, and compares every answer with the recorded one.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use nix::sys::prctl::set_timerslack;

use super::latency::Latencies;
use crate::protocol::connection::{BlockingConnection, ConnectionError, Credentials, Fault};
use crate::protocol::hello::Role;
use crate::protocol::memory::{MemoryReply, MemoryRequest};
use ground::ids::{ClusterId, Epoch};
use machine::hardware::transaction::{Kind, Transaction};

/// For the bus to answer.
const DEADLINE: Duration = Duration::from_secs(10);
/// How often to look, during long pauses, whether it is over.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

/// When a request is due.
#[derive(Clone, Copy, Debug)]
pub(super) enum Due {
    /// As soon as the one before it was answered.
    AtOnce,
    /// So long after `start` as it was asked for after the first.
    Recorded { start: Instant, first_request: u64 },
}

/// What one agent sent.
#[derive(Clone, Debug)]
pub(super) struct Tally {
    /// By [`Kind`].
    pub(super) transactions: [u64; Kind::COUNT],
    pub(super) bytes: [u64; Kind::COUNT],
    pub(super) mismatches: u64,
    /// Of the lowest sequence.
    pub(super) first_mismatch: Option<(u64, String)>,
    pub(super) latencies: Latencies,
    /// The most that a request came later than it was due.
    pub(super) late: Duration,
}

impl Tally {
    pub(super) fn new() -> Self {
        Self {
            transactions: [0; Kind::COUNT],
            bytes: [0; Kind::COUNT],
            mismatches: 0,
            first_mismatch: None,
            latencies: Latencies::new(),
            late: Duration::ZERO,
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        for kind in Kind::ALL {
            self.transactions[kind as usize] += other.transactions[kind as usize];
            self.bytes[kind as usize] += other.bytes[kind as usize];
        }
        self.mismatches += other.mismatches;
        let found = [self.first_mismatch.take(), other.first_mismatch.clone()];
        self.first_mismatch = found.into_iter().flatten().min();
        self.latencies.add_all(&other.latencies);
        self.late = self.late.max(other.late);
    }

    fn count(&mut self, row: &Transaction) {
        self.transactions[row.kind as usize] += 1;
        self.bytes[row.kind as usize] += u64::from(row.bytes);
    }
}

pub(super) struct Agent {
    connection: BlockingConnection<MemoryRequest, MemoryReply>,
    tally: Tally,
}

impl Agent {
    /// # Errors
    /// The bus does not answer, or refuses this process.
    pub(super) fn connect(bus: SocketAddr, role: Role, credentials: &Credentials) -> Result<Self, ConnectionError> {
        let introduction = credentials.introduction(role, Epoch(0));
        let connection = BlockingConnection::connect(Role::Bus(ClusterId(0)), bus, &introduction, DEADLINE)?;
        Ok(Self { connection, tally: Tally::new() })
    }

    /// Sends all rows that come, until no more do, or until it is to `stop`.
    ///
    /// # Errors
    /// The bus is gone, is silent, or refuses a request.
    pub(super) fn send_all(
        mut self,
        rows: &Receiver<Vec<Transaction>>,
        due: Due,
        stop: &AtomicBool,
    ) -> Result<Tally, ConnectionError> {
        // An error means that sleeps end some 50 us late, which is reported.
        let _ = set_timerslack(1);
        for rows in rows {
            for row in rows {
                if !self.wait(&row, due, stop) {
                    return Ok(self.tally);
                }
                self.send(&row)?;
            }
        }
        Ok(self.tally)
    }

    /// `false`: it is over.
    fn wait(&mut self, row: &Transaction, due: Due, stop: &AtomicBool) -> bool {
        let Due::Recorded { start, first_request } = due else { return true };
        let due = start + Duration::from_nanos(row.request_nanoseconds.saturating_sub(first_request));
        loop {
            let now = Instant::now();
            let early = due.saturating_duration_since(now);
            if early.is_zero() {
                self.tally.late = self.tally.late.max(now.saturating_duration_since(due));
                return true;
            }
            if stop.load(Ordering::Relaxed) {
                return false;
            }
            // A plain sleep: waiting for a channel spins first, and takes the processor from the bus.
            thread::sleep(early.min(LOOK_PERIOD));
        }
    }

    fn send(&mut self, row: &Transaction) -> Result<(), ConnectionError> {
        let Some(request) = request(row) else {
            // The schedule has refused all such logs.
            return Err(self.connection.error(Fault::Unexpected(format!("no initiator sends row {}", row.sequence))));
        };
        let sent = Instant::now();
        self.connection.send(&request, &[])?;
        if row.crc32c.is_some() {
            let (reply, data) = self.connection.receive()?;
            self.tally.latencies.add(sent.elapsed());
            let found = (data.len(), crc32c::crc32c(data));
            let fault = match reply {
                MemoryReply::Data { .. } => None,
                MemoryReply::Stored => {
                    Some(Fault::Unexpected("it reports that it stored, but was asked for data".into()))
                }
                MemoryReply::Refused(why) => Some(Fault::RefusedUs(why)),
            };
            if let Some(fault) = fault {
                return Err(self.connection.error(fault));
            }
            self.compare(row, found);
        }
        self.tally.count(row);
        Ok(())
    }

    fn compare(&mut self, row: &Transaction, (bytes, crc32c): (usize, u32)) {
        let expected = row.crc32c.unwrap_or_default();
        if (bytes, crc32c) == (row.bytes as usize, expected) {
            return;
        }
        self.tally.mismatches += 1;
        self.tally.first_mismatch.get_or_insert_with(|| {
            let address = row.address.unwrap_or_default();
            let asked = format!("sequence {}, {} at {address}", row.sequence, row.kind.name());
            let was = format!("recorded were {} bytes with crc32c {expected:#010x}", row.bytes);
            (row.sequence, format!("{asked}: {was}, the bus sent {bytes} with {crc32c:#010x}"))
        });
    }
}

/// `None` for what neither nodes nor the master send.
fn request(row: &Transaction) -> Option<MemoryRequest> {
    let bytes = row.bytes;
    Some(match row.kind {
        Kind::Fetch => MemoryRequest::Fetch {
            tile: row.tile?,
            attempt: row.attempt?,
            section: row.section?,
            address: row.address?,
            line_bytes: u16::try_from(bytes.checked_div(row.lines?.count_ones())?).ok()?,
            lines: row.lines?,
            accesses_before: row.accesses_before?,
        },
        Kind::Bulk => MemoryRequest::Bulk { address: row.address?, bytes },
        Kind::Job => MemoryRequest::Job { node: row.node?, tile: row.tile?, attempt: row.attempt?, bytes },
        Kind::Pixels => MemoryRequest::Pixels { tile: row.tile?, attempt: row.attempt?, bytes },
        Kind::Allocate | Kind::Write | Kind::Publish => return None,
    })
}
