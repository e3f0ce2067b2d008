//! A display's files in virtual time: a journal that is a list, and outlives the displays.

use std::cell::RefCell;
use std::rc::Rc;

use super::host::{Context, Worker};
use crate::processes::display::composition::Finished;
use crate::processes::display::state::{Answer, Entry, State, Task};
use crate::protocol::control::DisplayTotals;
use ground::ids::{Attempt, Producer, TileId};

pub(super) type Journal = Rc<RefCell<Vec<Entry>>>;

/// Whose pixels of a tile were taken last.
pub(super) fn source(journal: &Journal, of: TileId) -> Option<(Producer, Attempt)> {
    journal.borrow().iter().rev().find_map(|entry| match entry {
        Entry::Pixels { tile, attempt, producer, .. } if *tile == of => Some((*producer, *attempt)),
        _ => None,
    })
}

/// Whether the display took the tiles of a process out of the frame after it took any into it.
pub(super) fn is_rid_of(journal: &Journal, process: Producer) -> bool {
    let latest = journal.borrow().iter().rev().find_map(|entry| match entry {
        Entry::Pixels { producer, .. } if *producer == process => Some(false),
        Entry::Condemned(producer) if *producer == process => Some(true),
        _ => None,
    });
    latest != Some(false)
}

pub(super) struct Files {
    pub(super) journal: Journal,
    /// The image, once it is written.
    pub(super) finished: Option<Finished>,
}

impl Worker<State> for Files {
    fn begin(&mut self, _desk: &mut Context, task: Task) -> Result<Option<Answer>, String> {
        match task {
            Task::Restore(mut composition, configuration) => {
                let mut journal = self.journal.borrow_mut();
                if !configuration.resume {
                    journal.clear();
                }
                journal.iter().for_each(|entry| composition.restore(&entry.record()));
                Ok(Some(Answer::Restored(composition, None)))
            }
            Task::Append(entry) => {
                self.journal.borrow_mut().push(entry);
                Ok(None)
            }
            Task::Write(composition) => {
                let finished = composition.finish();
                let totals = DisplayTotals {
                    sha256: finished.frame.sha256(),
                    tiles_done: finished.tiles_done,
                    tiles_stale: finished.tiles_stale,
                    wire_bytes: 0,
                    written: Vec::new(),
                };
                self.finished = Some(finished);
                Ok(Some(Answer::Written(Ok(totals))))
            }
        }
    }
}
