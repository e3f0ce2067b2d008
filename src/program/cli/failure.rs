//! What a command ends with when it does not end well.

use std::fmt;
use std::process::ExitCode;

use ground::outlet;
use trace::preparation::PreparationError;
use trace::scene::SourceError;

/// Exit codes besides 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    Failed = 1,
    /// Wrong usage, or an input file that cannot be right.
    BadInput = 2,
    /// The run ended, and the image lacks tiles.
    TilesMissing = 3,
    /// 128 + SIGHUP.
    HungUp = 129,
    /// 128 + SIGINT.
    Interrupted = 130,
    /// 128 + SIGTERM.
    Terminated = 143,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    pub exit: Exit,
    pub message: String,
}

impl Failure {
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        Self { exit, message: message.into() }
    }

    pub fn failed(message: impl Into<String>) -> Self {
        Self::new(Exit::Failed, message)
    }

    pub fn bad_input(message: impl Into<String>) -> Self {
        Self::new(Exit::BadInput, message)
    }

    /// Prints `error: MESSAGE` to standard error; gives what to exit with.
    pub fn report(&self) -> ExitCode {
        outlet::say(format_args!("error: {self}"));
        ExitCode::from(self.exit as u8)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Failure {
    /// Of a scene with warnings, where they are to be errors.
    pub(super) fn of_warnings() -> Self {
        Self::bad_input("the scene has warnings, which --strict makes errors")
    }
}

impl From<PreparationError> for Failure {
    fn from(error: PreparationError) -> Self {
        Self::bad_input(error.to_string())
    }
}

impl From<SourceError> for Failure {
    fn from(error: SourceError) -> Self {
        Self::bad_input(error.to_string())
    }
}
