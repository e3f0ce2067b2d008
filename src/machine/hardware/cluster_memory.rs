//! The memory image at the bus, shared by a cluster's nodes.

use super::transaction::FetchRequest;
use ground::ids::Address;
use trace::database::Layout;

/// Why a memory request cannot be served.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum AccessError {
    #[error("{bytes} bytes at {address} are outside of the image of {database_bytes} bytes")]
    OutOfRange { address: Address, bytes: u64, database_bytes: u64 },
    #[error("{address} was to be written in order: the next one is {expected}")]
    OutOfOrder { address: Address, expected: Address },
    #[error("{bytes} bytes at {address} are not uploaded yet, only those below {uploaded}")]
    NotUploaded { address: Address, bytes: u64, uploaded: Address },
    #[error("{0}")]
    BadFetch(&'static str),
}

/// The image of one layout, uploaded in ascending order and complete when all of its bytes were written.
///
/// It grows as it is uploaded, so that nothing is allocated by a length that a peer only claims.
#[derive(Debug)]
pub struct ClusterMemory {
    database_bytes: u64,
    bytes: Vec<u8>,
}

impl ClusterMemory {
    pub fn new(layout: &Layout) -> Self {
        Self { database_bytes: layout.database_bytes(), bytes: Vec::new() }
    }

    /// Whether all bytes were written.
    pub fn is_complete(&self) -> bool {
        self.bytes.len() as u64 == self.database_bytes
    }

    /// Appends to the image; `address` is the end of what was stored before.
    ///
    /// # Errors
    /// The data are not next in order, or reach beyond the layout; nothing is stored then.
    pub fn store(&mut self, address: Address, data: &[u8]) -> Result<(), AccessError> {
        let uploaded = self.bytes.len() as u64;
        if address.0 != uploaded {
            return Err(AccessError::OutOfOrder { address, expected: Address(uploaded) });
        }
        let bytes = data.len() as u64;
        if bytes > self.database_bytes - uploaded {
            return Err(AccessError::OutOfRange { address, bytes, database_bytes: self.database_bytes });
        }
        self.bytes.extend_from_slice(data);
        Ok(())
    }

    /// The bytes of a range.
    ///
    /// # Errors
    /// It reaches beyond the image, or beyond what is uploaded.
    pub fn range(&self, address: Address, bytes: u64) -> Result<&[u8], AccessError> {
        let end = address.0.checked_add(bytes).filter(|&end| end <= self.database_bytes);
        let end = end.ok_or(AccessError::OutOfRange { address, bytes, database_bytes: self.database_bytes })?;
        let uploaded = Address(self.bytes.len() as u64);
        let not_uploaded = AccessError::NotUploaded { address, bytes, uploaded };
        let (Ok(start), Ok(end)) = (usize::try_from(address.0), usize::try_from(end)) else {
            return Err(not_uploaded);
        };
        self.bytes.get(start..end).ok_or(not_uploaded)
    }

    /// The wanted lines in ascending order.
    ///
    /// # Errors
    /// The request is not as [`FetchRequest`] says, or a line lies beyond the image.
    pub fn lines(&self, fetch: &FetchRequest) -> Result<impl Iterator<Item = &[u8]> + use<'_>, AccessError> {
        let line = u64::from(fetch.line_bytes);
        if !fetch.line_bytes.is_power_of_two() || !(16..=256).contains(&fetch.line_bytes) {
            return Err(AccessError::BadFetch("the line of a fetch must be a power of two, 16 to 256 bytes"));
        }
        if fetch.lines & 1 == 0 {
            return Err(AccessError::BadFetch("the first line of a fetch must be wanted"));
        }
        if !fetch.address.0.is_multiple_of(line) {
            return Err(AccessError::BadFetch("the address of a fetch must be a multiple of its line"));
        }
        let mask = fetch.lines;
        let span = u64::from(u32::BITS - mask.leading_zeros()) * line;
        let lines = self.range(fetch.address, span)?.chunks_exact(fetch.line_bytes as usize);
        Ok(lines.enumerate().filter(move |(i, _)| mask >> i & 1 == 1).map(|(_, bytes)| bytes))
    }

    /// Appends the wanted lines in ascending order.
    ///
    /// # Errors
    /// As for [`Self::lines`]; `into` is as before then.
    pub fn gather(&self, fetch: &FetchRequest, into: &mut Vec<u8>) -> Result<(), AccessError> {
        self.lines(fetch)?.for_each(|line| into.extend_from_slice(line));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::database::Section;

    /// Two granules; each byte is its address modulo 251.
    fn memory() -> ClusterMemory {
        let mut memory = ClusterMemory::new(&Layout::new([65, 0, 0, 0, 0, 0, 0, 0, 0]).expect("small"));
        let image: Vec<u8> = (0..512u32).map(|i| (i % 251) as u8).collect();
        for (i, part) in image.chunks(200).enumerate() {
            assert!(!memory.is_complete());
            memory.store(Address(200 * i as u64), part).expect("in order");
        }
        memory
    }

    fn fetch(address: u64, line_bytes: u32, lines: u32) -> FetchRequest {
        FetchRequest { section: Section::OctreeNodes, address: Address(address), line_bytes, lines, accesses_before: 0 }
    }

    #[test]
    fn it_is_complete_when_all_is_stored_in_order() {
        assert!(memory().is_complete());
        let mut memory = ClusterMemory::new(&Layout::new([1, 0, 0, 0, 0, 0, 0, 0, 0]).expect("small"));
        let too_long = memory.store(Address(0), &[0; 257]);
        assert_eq!(too_long, Err(AccessError::OutOfRange { address: Address(0), bytes: 257, database_bytes: 256 }));
        memory.store(Address(0), &[1; 100]).expect("in order");
        let again = memory.store(Address(0), &[2; 100]);
        assert_eq!(again, Err(AccessError::OutOfOrder { address: Address(0), expected: Address(100) }));
        let gap = memory.store(Address(101), &[2; 1]);
        assert_eq!(gap, Err(AccessError::OutOfOrder { address: Address(101), expected: Address(100) }));
        assert_eq!(memory.range(Address(0), 100).expect("uploaded"), [1; 100]);
        assert!(!memory.is_complete());
    }

    #[test]
    fn nothing_is_allocated_before_it_is_uploaded() {
        let largest = ClusterMemory::new(&Layout::new([1 << 30, 0, 0, 0, 0, 0, 0, 0, 0]).expect("4 GiB"));
        assert_eq!(largest.bytes.capacity(), 0);
        let early = largest.range(Address(0), 16);
        assert_eq!(early, Err(AccessError::NotUploaded { address: Address(0), bytes: 16, uploaded: Address(0) }));
    }

    #[test]
    fn ranges_are_checked() {
        let memory = memory();
        assert_eq!(memory.range(Address(250), 3).expect("inside"), [250, 0, 1]);
        assert!(memory.range(Address(512), 0).expect("at the end").is_empty());
        for (address, bytes) in [(512, 1), (0, 513), (u64::MAX, 1), (1, u64::MAX), (u64::MAX, u64::MAX)] {
            let expected = AccessError::OutOfRange { address: Address(address), bytes, database_bytes: 512 };
            assert_eq!(memory.range(Address(address), bytes), Err(expected));
        }
    }

    #[test]
    fn lines_come_in_ascending_order() {
        let memory = memory();
        let firsts = |fetch| -> Result<Vec<(u8, usize)>, AccessError> {
            Ok(memory.lines(&fetch)?.map(|line| (line[0], line.len())).collect())
        };
        assert_eq!(firsts(fetch(32, 16, 0b1101)), Ok(vec![(32, 16), (64, 16), (80, 16)]));
        assert_eq!(firsts(fetch(256, 256, 1)), Ok(vec![(5, 256)]));
        assert_eq!(firsts(fetch(0, 16, u32::MAX)).map(|lines| lines.len()), Ok(32));
    }

    #[test]
    fn bad_fetches_are_refused() {
        let memory = memory();
        let cases = [
            fetch(0, 16, 0),
            fetch(0, 16, 2),
            fetch(8, 16, 1),
            fetch(0, 0, 1),
            fetch(0, 8, 1),
            fetch(0, 24, 1),
            fetch(0, 512, 1),
            fetch(512, 16, 1),
            fetch(496, 16, 3),
            fetch(256, 256, 1 << 31 | 1),
            fetch(u64::MAX - 15, 16, 1),
        ];
        for case in cases {
            assert!(memory.lines(&case).is_err(), "{case:?}");
        }
    }
}
