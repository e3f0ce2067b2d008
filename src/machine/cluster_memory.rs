//! The memory image at the bus, shared by a cluster's nodes.

use super::transaction::FetchRequest;
use crate::database::Layout;
use crate::ids::Address;

/// Why a memory request cannot be served.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum AccessError {
    #[error("{bytes} bytes at {address} are outside of the image of {image_bytes} bytes")]
    OutOfRange { address: Address, bytes: u64, image_bytes: u64 },
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
    image_bytes: u64,
    bytes: Vec<u8>,
}

impl ClusterMemory {
    pub fn new(layout: &Layout) -> Self {
        Self { image_bytes: layout.image_bytes(), bytes: Vec::new() }
    }

    /// Whether all bytes were written.
    pub fn is_complete(&self) -> bool {
        self.bytes.len() as u64 == self.image_bytes
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
        if bytes > self.image_bytes - uploaded {
            return Err(AccessError::OutOfRange { address, bytes, image_bytes: self.image_bytes });
        }
        self.bytes.extend_from_slice(data);
        Ok(())
    }

    /// The bytes of a range.
    ///
    /// # Errors
    /// It reaches beyond the image, or beyond what is uploaded.
    pub fn range(&self, address: Address, bytes: u64) -> Result<&[u8], AccessError> {
        let end = address.0.checked_add(bytes).filter(|&end| end <= self.image_bytes);
        let end = end.ok_or(AccessError::OutOfRange { address, bytes, image_bytes: self.image_bytes })?;
        let uploaded = Address(self.bytes.len() as u64);
        let not_uploaded = AccessError::NotUploaded { address, bytes, uploaded };
        let (Ok(start), Ok(end)) = (usize::try_from(address.0), usize::try_from(end)) else {
            return Err(not_uploaded);
        };
        self.bytes.get(start..end).ok_or(not_uploaded)
    }

    /// Appends the wanted lines in ascending order.
    ///
    /// # Errors
    /// The request is not as [`FetchRequest`] says, or a line lies beyond the image; `into` is as before then.
    pub fn gather(&self, fetch: &FetchRequest, into: &mut Vec<u8>) -> Result<(), AccessError> {
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
        let span = u64::from(u32::BITS - fetch.lines.leading_zeros()) * line;
        let lines = self.range(fetch.address, span)?.chunks_exact(fetch.line_bytes as usize);
        for (_, bytes) in lines.enumerate().filter(|(i, _)| fetch.lines >> i & 1 == 1) {
            into.extend_from_slice(bytes);
        }
        Ok(())
    }
}
