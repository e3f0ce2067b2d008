//! What a log requires of its player, and whether it can be played at all: the first of two walks through it.

use std::collections::BTreeSet;

use super::PlayError;
use ground::ids::NodeId;
use machine::hardware::transaction::{Kind, Transaction};
use machine::recording::bus_log::{ReadError, Reader};

/// Which initiators there are, and when the first request is due.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Schedule {
    pub(super) nodes: BTreeSet<NodeId>,
    /// The master sent jobs.
    pub(super) has_jobs: bool,
    /// All but the upload's.
    pub(super) transactions: u64,
    /// Between the first request and the last completion of these.
    pub(super) recorded_nanoseconds: u64,
    /// When the first of them was asked for.
    pub(super) first_request: u64,
    uploaded_bytes: u64,
    has_fetched: bool,
    /// Where the readable part of a damaged log ended.
    pub(super) fault: Option<ReadError>,
}

impl Schedule {
    /// Reads a log to its end or, if it may be damaged, to its first fault. `image` is the database as it was
    /// rebuilt: the recorded upload must be of the same bytes.
    ///
    /// # Errors
    /// The log cannot be read, or holds what cannot be played again.
    pub(super) fn read(mut log: Reader, image: &[u8], nodes: u16, may_be_damaged: bool) -> Result<Self, PlayError> {
        let mut schedule = Self::default();
        loop {
            match log.next_rows() {
                Ok(Some(rows)) => rows.iter().try_for_each(|row| schedule.note(row, image, nodes))?,
                Ok(None) => break,
                Err(fault) if may_be_damaged => {
                    schedule.fault = Some(fault);
                    break;
                }
                Err(fault) => return Err(fault.into()),
            }
        }
        if schedule.uploaded_bytes < image.len() as u64 {
            return Err(PlayError::UploadCut { recorded: schedule.uploaded_bytes, image: image.len() as u64 });
        }
        Ok(schedule)
    }

    fn note(&mut self, row: &Transaction, image: &[u8], nodes: u16) -> Result<(), PlayError> {
        let unplayable = |why: String| PlayError::Unplayable { sequence: row.sequence, why };
        match row.kind {
            Kind::Write => return self.note_write(row, image),
            Kind::Allocate | Kind::Publish => {
                let what = "it changes the image, as this player cannot";
                return Err(unplayable(format!("{}: {what}", row.kind.name())));
            }
            Kind::Fetch | Kind::Bulk => self.has_fetched = true,
            Kind::Job | Kind::Pixels => {}
        }
        let node = row.node.filter(|node| node.0 < nodes);
        let node = node.ok_or_else(|| unplayable(format!("it is of none of the topology's {nodes} nodes")))?;
        if row.kind == Kind::Job {
            self.has_jobs = true;
        } else {
            self.nodes.insert(node);
        }
        if self.transactions == 0 {
            self.first_request = row.request_nanoseconds;
        }
        self.first_request = self.first_request.min(row.request_nanoseconds);
        self.recorded_nanoseconds = row.completion_nanoseconds - self.first_request;
        self.transactions += 1;
        Ok(())
    }

    /// A piece of the upload, which ends before anybody fetches.
    fn note_write(&mut self, row: &Transaction, image: &[u8]) -> Result<(), PlayError> {
        let unplayable = |why: String| PlayError::Unplayable { sequence: row.sequence, why };
        if self.has_fetched {
            let why = "a write after the first fetch: what was read depended on it, and it is not in the log";
            return Err(unplayable(why.to_owned()));
        }
        let address = row.address.map_or(0, |address| address.0);
        if address != self.uploaded_bytes {
            return Err(unplayable(format!(
                "a write at {address}, expected the upload's next piece at {}",
                self.uploaded_bytes
            )));
        }
        let end = address + u64::from(row.bytes);
        let piece = usize::try_from(address).ok().zip(usize::try_from(end).ok()).and_then(|(a, z)| image.get(a..z));
        let piece = piece.ok_or_else(|| unplayable("a write beyond the image".to_owned()))?;
        if Some(crc32c::crc32c(piece)) != row.crc32c {
            return Err(PlayError::OtherImage { address, bytes: row.bytes });
        }
        self.uploaded_bytes = end;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::ids::{Address, Attempt, ClusterId, Epoch, TileId};
    use trace::database::Section;

    const IMAGE: [u8; 512] = [7; 512];

    fn row(sequence: u64, kind: Kind) -> Transaction {
        let moves = matches!(kind, Kind::Fetch | Kind::Write);
        let fetch = kind == Kind::Fetch;
        Transaction {
            sequence,
            epoch: Epoch(0),
            cluster: ClusterId(0),
            kind,
            node: (kind != Kind::Write).then_some(NodeId(1)),
            tile: Some(TileId(3)),
            attempt: Some(Attempt(0)),
            section: fetch.then_some(Section::OctreeNodes),
            address: moves.then_some(Address(0)),
            bytes: 256,
            lines: fetch.then_some(1),
            crc32c: moves.then(|| crc32c::crc32c(&IMAGE[..256])),
            accesses_before: fetch.then_some(0),
            request_nanoseconds: 100 * sequence,
            grant_nanoseconds: 100 * sequence + 1,
            completion_nanoseconds: 100 * sequence + 2,
        }
    }

    fn write(sequence: u64, address: u64) -> Transaction {
        Transaction { address: Some(Address(address)), ..row(sequence, Kind::Write) }
    }

    fn schedule(rows: &[Transaction]) -> Result<Schedule, PlayError> {
        let mut schedule = Schedule::default();
        rows.iter().try_for_each(|row| schedule.note(row, &IMAGE, 4)).map(|()| schedule)
    }

    #[test]
    fn initiators_and_duration_are_known_beforehand() {
        let rows = [write(0, 0), write(1, 256), row(2, Kind::Job), row(3, Kind::Fetch), row(4, Kind::Pixels)];
        let schedule = schedule(&rows).expect("playable");
        assert_eq!((schedule.nodes, schedule.has_jobs, schedule.transactions), (BTreeSet::from([NodeId(1)]), true, 3));
        assert_eq!((schedule.first_request, schedule.recorded_nanoseconds, schedule.uploaded_bytes), (200, 202, 512));
    }

    #[test]
    fn what_cannot_be_played_again_is_refused_with_the_reason() {
        let stranger = Transaction { node: Some(NodeId(4)), ..row(2, Kind::Fetch) };
        for (rows, expected) in [
            (
                vec![write(0, 0), row(1, Kind::Fetch), write(2, 256)],
                "sequence 2 of the recording cannot be played again: \
             a write after the first fetch",
            ),
            (vec![write(0, 256)], "a write at 256, expected the upload's next piece at 0"),
            (vec![write(0, 0), write(1, 256), write(2, 512)], "a write beyond the image"),
            (
                vec![Transaction { crc32c: Some(1), ..write(0, 0) }],
                "the 256 bytes at 0 of the image are not those recorded",
            ),
            (vec![row(0, Kind::Allocate)], "allocate: it changes the image"),
            (vec![row(0, Kind::Publish)], "publish: it changes the image"),
            (vec![stranger], "it is of none of the topology's 4 nodes"),
        ] {
            let error = schedule(&rows).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
