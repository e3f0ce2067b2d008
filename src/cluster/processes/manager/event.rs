//! The events that the manager's state takes, and the actions that it answers.

use std::net::SocketAddr;

use super::cause::Interrupt;
use super::process::{Command, ProcessId, Report};

#[derive(Debug)]
pub(in crate::processes) enum Event {
    Connected(ProcessId),
    Report(ProcessId, Report),
    /// The control connection ended; `Some`: by nonsense, and what it was.
    Disconnected(ProcessId, Option<String>),
    /// The process is confirmed dead, or could not be started; how, as the rest of a sentence that begins with its name.
    Exited(ProcessId, String),
    /// This bus has the database.
    Uploaded(ProcessId),
    UploadFailed(ProcessId, String),
    /// What [`Action::Begin`] came to, or why it cannot be done.
    Begun(Result<(), String>),
    /// Somebody was not let in at the manager's port.
    Refused(String),
    Signal(Interrupt),
    Tick,
}

#[derive(Clone, PartialEq, Debug)]
pub(in crate::processes) enum Action {
    /// Put aside what an earlier run left: this one begins in earnest. [`Event::Begun`] is the answer.
    Begin,
    Spawn(ProcessId),
    Tell(ProcessId, Command),
    /// End the control connection.
    HangUp(ProcessId),
    Kill(ProcessId),
    /// Load the database into this bus.
    Upload(ProcessId, SocketAddr),
}
