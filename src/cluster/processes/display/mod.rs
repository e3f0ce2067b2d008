//! The display: puts tiles together, acknowledges them, writes the image.

pub mod composition;
pub mod state;

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use self::composition::{Composition, Finished};
use self::state::{Answer, State, Task};
use crate::journal::{Journal, Subject};
use crate::processes::Child;
use crate::processes::driver::live::{self, ProcessError, Worker};
use crate::processes::event_queue::aside;
use crate::protocol::control::{DisplayConfiguration, DisplayTotals};
use ground::pulse::Pulse;

/// Serves until the manager asks for the image, and writes what there is.
///
/// # Errors
/// The manager is gone, there is no memory for the image, or image or journal cannot be written.
pub fn run(child: &Child) -> Result<(), ProcessError> {
    let wire_bytes = Arc::<AtomicU64>::default();
    let files = Files { pulse: child.pulse.clone(), wire_bytes: Arc::clone(&wire_bytes), open: None, writing: None };
    live::run(child, State::new(child.bootstrap.token.run_id()), files, wire_bytes)
}

/// The journal, and at the end the image.
struct Files {
    pulse: Pulse,
    wire_bytes: Arc<AtomicU64>,
    open: Option<(Journal, DisplayConfiguration)>,
    writing: Option<Pin<Box<dyn Future<Output = Answer>>>>,
}

impl Files {
    /// Begins where the journal ends. Blocks: no client is served yet.
    fn restore(
        &mut self,
        mut composition: Box<Composition>,
        configuration: DisplayConfiguration,
    ) -> Result<Answer, String> {
        let DisplayConfiguration { tiling, aov, fingerprint, ref journal, resume, .. } = configuration;
        let subject = Subject { tiling, aov, fingerprint };
        let opened = Journal::open(journal, &subject, resume, |record| composition.restore(record));
        let (journal, dropped) = opened.map_err(|error| error.to_string())?;
        if let Some(dropped) = &dropped {
            tracing::warn!("{dropped}");
        }
        self.open = Some((journal, configuration));
        Ok(Answer::Restored(composition, dropped))
    }

    /// Writes whatever tiles there are, in a thread of its own: a large image takes seconds.
    fn write(&mut self, composition: Composition) {
        let Some((journal, configuration)) = self.open.take() else { return };
        let (pulse, wire_bytes) = (self.pulse.clone(), self.wire_bytes.load(Ordering::Relaxed));
        self.writing = Some(Box::pin(async move {
            let written = aside(&pulse, "image", move || {
                // Locked until the image is written.
                let _journal = journal;
                let Finished { frame, tiles_done, tiles_stale } = composition.finish();
                // Before the hash: when a run is interrupted, time is short.
                let written = frame.write(&configuration.image, configuration.exr)?;
                std::io::Result::Ok(DisplayTotals {
                    sha256: frame.sha256(),
                    tiles_done,
                    tiles_stale,
                    wire_bytes,
                    written,
                })
            });
            Answer::Written(written.await.flatten().map_err(|error| format!("cannot write the image: {error}")))
        }));
    }
}

impl Worker<State> for Files {
    fn begin(&mut self, task: Task) -> Result<Option<Answer>, String> {
        match (task, &mut self.open) {
            (Task::Restore(composition, configuration), _) => {
                return self.restore(composition, configuration).map(Some);
            }
            (Task::Append(entry), Some((journal, _))) => {
                journal.append(&entry.record()).map_err(|error| error.to_string())?;
            }
            (Task::Append(_), None) => return Err("there is no journal".to_owned()),
            (Task::Write(composition), _) => self.write(*composition),
        }
        Ok(None)
    }

    async fn answer(&mut self) -> Answer {
        let Some(writing) = &mut self.writing else { return std::future::pending().await };
        let answer = writing.await;
        self.writing = None;
        answer
    }
}

#[cfg(test)]
mod composition_tests;
#[cfg(test)]
mod tests;
