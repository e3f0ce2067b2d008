//! The requests of a trace that came from elsewhere, for caches of objects.

use crate::hardware::references::{PART_WORDS, ReferenceWord};
use crate::replay::importers::Imported;
use crate::replay::model::objects::{Request, Requests};
use crate::replay::{Trace, TraceError};

/// Reads and writes alike, each with the size that it has in the trace.
impl Requests for Imported {
    fn for_each_piece(&self, consume: &mut dyn FnMut(&[Request]) -> Result<(), TraceError>) -> Result<(), TraceError> {
        if self.notes().invalidations > 0 {
            return Err(TraceError("a trace with deletions of objects: expected one without".to_owned()));
        }
        let (mut words, mut requests) = (Vec::new(), Vec::with_capacity(PART_WORDS));
        for part in self.tiles().iter().flat_map(|tile| tile.parts.clone()) {
            self.read(part, &mut words)?;
            requests.clear();
            let records = words.iter().filter_map(|&word| ReferenceWord(word).record());
            requests.extend(
                records.map(|record| Request { object: self.object(record), bytes: self.object_bytes(record) }),
            );
            consume(&requests)?;
        }
        Ok(())
    }
}
