//! Where missing lines come from.

use crate::hardware::cluster_memory::{AccessError, ClusterMemory};
use crate::hardware::transaction::FetchRequest;

/// Serves the missing lines of one record as one transaction: over the bus, or in process.
pub trait LineSource {
    type Error;

    /// Fills `into`, which is as long as the wanted lines together, with these in ascending order.
    ///
    /// # Errors
    /// The lines cannot be had; what `into` holds then is of no meaning.
    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), Self::Error>;
}

/// Counted like a bus, but served in process: no arbitration, no waiting.
impl LineSource for &ClusterMemory {
    type Error = AccessError;

    fn fetch(&mut self, request: &FetchRequest, into: &mut [u8]) -> Result<(), AccessError> {
        let slots = into.chunks_exact_mut(request.line_bytes as usize);
        self.lines(request)?.zip(slots).for_each(|(line, slot)| slot.copy_from_slice(line));
        Ok(())
    }
}
