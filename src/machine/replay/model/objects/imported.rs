//! The requests of a trace of objects that came from elsewhere.

use super::{Request, Requests};
use crate::hardware::references::{Event, ReferenceWord};
use crate::replay::importers::Imported;
use crate::replay::{Trace, TraceError};

/// Reads and writes alike request an object, of the size that it had at first. Nothing else is a request.
impl Requests for Imported {
    fn for_each_piece(&self, consume: &mut dyn FnMut(&[Request]) -> Result<(), TraceError>) -> Result<(), TraceError> {
        let (mut words, mut piece) = (Vec::new(), Vec::new());
        let request = |&word: &u32| match ReferenceWord(word).decode() {
            Some(Event::Read(object) | Event::Write(object)) => {
                Some(Request { object, bytes: self.object_bytes(object) })
            }
            _ => None,
        };
        for part in self.tiles().iter().flat_map(|tile| tile.parts.clone()) {
            self.read(part, &mut words)?;
            piece.clear();
            piece.extend(words.iter().filter_map(request));
            consume(&piece)?;
        }
        Ok(())
    }
}
