//! What a process waits with, and what it must not wait for: made so that a system without a descriptor or a thread left
//! is an error, where tokio by itself panics.

use std::io;
use std::os::unix::net::UnixStream;
use std::thread;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;

use ground::pulse::Pulse;

/// The event queue of one thread. Not to be dropped inside of another one's `block_on`.
///
/// # Errors
/// The system has no descriptor left.
pub(super) fn event_queue() -> io::Result<Runtime> {
    let failed = |error: io::Error| io::Error::new(error.kind(), format!("cannot make an event queue: {error}"));
    // The first one of a process takes three descriptors, then a pair for signals, where it panics if it cannot, and one.
    let pair = || UnixStream::pair().map_err(failed);
    drop([pair()?, pair()?, pair()?]);
    Builder::new_current_thread().enable_all().build().map_err(failed)
}

/// Work that would block the event queue, on a thread of its own.
///
/// # Errors
/// The system has no thread left, or the work panicked.
pub(super) async fn aside<T: Send + 'static>(
    pulse: &Pulse,
    name: &'static str,
    work: impl FnOnce() -> T + Send + 'static,
) -> io::Result<T> {
    let (sender, done) = oneshot::channel();
    // An error of sending means that the outcome is not awaited any more.
    let pulse = pulse.clone();
    let started = thread::Builder::new().name(name.to_owned()).spawn(move || {
        // Without memory a thread may be stuck in the very report of it.
        let beacon = pulse.beacon(name);
        beacon.turn();
        drop(sender.send(work()));
    });
    started.map_err(|error| io::Error::new(error.kind(), format!("cannot start a thread: {error}")))?;
    done.await.map_err(|_| io::Error::other(format!("the thread {name} panicked, see the log")))
}
