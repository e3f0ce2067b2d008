//! Where lines of text go, to a log file or to standard error, and decide about nothing: a line that cannot be written is
//! counted, and no thread waits long for a reader.

use std::fmt::Display;
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, poll};
use nix::unistd;

use crate::colour;

/// For the reader of a full pipe or of a stopped terminal to make room. After a line was lost the next ones do not wait.
const PATIENCE_MILLISECONDS: u8 = 100;
/// A pipe that is ready takes so many bytes at once (POSIX's `PIPE_BUF` on Linux).
const READY_BYTES: usize = 4096;

/// Standard error of this process.
pub static STANDARD_ERROR: Outlet = Outlet { path: None, state: Mutex::new(State::new()) };

/// Prints a line to standard error, its key word in colour on a terminal. A closed, full or stopped one is no failure.
pub fn say(line: impl Display) {
    STANDARD_ERROR.write_line(&(colour::message(&line.to_string(), &io::stderr()) + "\n"));
}

/// A file that is appended to, or standard error.
#[derive(Debug)]
pub struct Outlet {
    /// `None`: standard error.
    path: Option<PathBuf>,
    /// Nothing panics while it is locked, so that a panic hook may write.
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// `None` for standard error, and for a file that could not be opened yet.
    file: Option<File>,
    lost: u64,
    /// Of them, those since the last line that was written.
    gap: u64,
    first_reason: Option<io::Error>,
}

impl Outlet {
    /// A file that is opened at once or, where that fails, at a later line.
    pub fn file(path: &Path) -> Self {
        Self { path: Some(path.to_owned()), state: Mutex::new(State { file: open(path).ok(), ..State::new() }) }
    }

    /// Writes text that ends a line. Where lines before it are missing, says how many.
    pub fn write_line(&self, line: &str) {
        let mut state = self.lock();
        match state.write(self.path.as_deref(), line) {
            Ok(()) => state.gap = 0,
            Err(error) => {
                state.lost += 1;
                state.gap += 1;
                state.first_reason.get_or_insert(error);
            }
        }
    }

    /// Whether a line would be written without waiting.
    pub fn is_ready(&self) -> bool {
        self.path.is_some() || is_ready(io::stderr().as_fd(), 0)
    }

    /// How many lines could not be written, and why; `None` if all were.
    pub fn lost(&self) -> Option<String> {
        let state = self.lock();
        let reason = state.first_reason.as_ref()?;
        let name = self.path.as_ref().map_or("standard error".to_owned(), |path| path.display().to_string());
        Some(format!("{} lines to {name} could not be written: {reason}", state.lost))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// For [`tracing_subscriber`], which gives each event at once.
impl Write for &'static Outlet {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        self.write_line(&String::from_utf8_lossy(line));
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl State {
    const fn new() -> Self {
        Self { file: None, lost: 0, gap: 0, first_reason: None }
    }

    fn write(&mut self, path: Option<&Path>, line: &str) -> io::Result<()> {
        let gap = match (self.gap, &self.first_reason) {
            (1.., Some(reason)) => format!("\n{} lines are missing here: {reason}\n", self.gap),
            _ => String::new(),
        };
        let text = gap + line;
        let Some(path) = path else {
            let patience = if self.gap == 0 { PATIENCE_MILLISECONDS } else { 0 };
            return write_when_ready(io::stderr().as_fd(), text.as_bytes(), patience);
        };
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(open(path)?),
        };
        file.write_all(text.as_bytes())
    }
}

fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new().create(true).append(true).open(path)
}

fn write_when_ready(to: BorrowedFd<'_>, mut text: &[u8], patience: u8) -> io::Result<()> {
    while !text.is_empty() {
        if !is_ready(to, patience) {
            return Err(io::Error::new(ErrorKind::TimedOut, "its reader does not read"));
        }
        match unistd::write(to, &text[..text.len().min(READY_BYTES)]) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(bytes) => text = &text[bytes..],
            Err(Errno::EINTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Room, or an error that the next write will return.
fn is_ready(to: BorrowedFd<'_>, milliseconds: u8) -> bool {
    loop {
        match poll(&mut [PollFd::new(to, PollFlags::POLLOUT)], milliseconds) {
            Ok(ready) => return ready > 0,
            Err(Errno::EINTR) => {}
            Err(_) => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Read;
    use std::time::{Duration, Instant};

    use super::*;

    #[test]
    fn what_cannot_be_written_is_counted_and_named_where_it_is_missing() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("logs/node.log");
        let log = Outlet::file(&path);
        log.write_line("one\n");
        log.write_line("two\n");
        assert!(log.lost().is_some_and(|lost| lost.starts_with("2 lines to ") && lost.contains("No such file")));
        fs::create_dir(folder.path().join("logs")).expect("writable folder");
        log.write_line("three\n");
        log.write_line("four\n");
        let text = fs::read_to_string(&path).expect("made when there was room");
        assert_eq!(text, "\n2 lines are missing here: No such file or directory (os error 2)\nthree\nfour\n");
        assert!(log.lost().is_some_and(|lost| lost.starts_with("2 lines to ")));
    }

    #[test]
    fn a_full_disk_is_no_failure() {
        let log = Outlet::file(Path::new("/dev/full"));
        (0..1000).for_each(|_| log.write_line("x\n"));
        let expected = "1000 lines to /dev/full could not be written: No space left on device (os error 28)";
        assert_eq!(log.lost().as_deref(), Some(expected));
    }

    #[test]
    fn nobody_waits_long_for_a_reader() {
        let (mut reader, writer) = io::pipe().expect("descriptors");
        let line = [b'x'; 1000];
        let start = Instant::now();
        let mut written = 0;
        while write_when_ready(writer.as_fd(), &line, PATIENCE_MILLISECONDS).is_ok() {
            written += line.len();
        }
        assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
        let error = write_when_ready(writer.as_fd(), &line, 0).expect_err("still full");
        assert_eq!(error.to_string(), "its reader does not read");
        let mut read = vec![0; written];
        reader.read_exact(&mut read).expect("it was written");
        write_when_ready(writer.as_fd(), &line, 0).expect("there is room again");
        drop(reader);
        let error = write_when_ready(writer.as_fd(), &line, PATIENCE_MILLISECONDS).expect_err("no reader");
        assert_eq!(error.kind(), ErrorKind::BrokenPipe);
    }
}
