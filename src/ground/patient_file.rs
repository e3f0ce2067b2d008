//! A file whose writes wait for room: a disk that is full for a moment is no reason to end.

use std::fs::File;
use std::io::{self, ErrorKind, IoSlice, Write};
use std::thread;
use std::time::{Duration, Instant};

/// For room to be made. Shorter than the time after which a thread counts as stuck, and than the deadlines of other processes
/// that wait for what is written.
const DEADLINE: Duration = Duration::from_secs(3);
const PAUSE: Duration = Duration::from_millis(20);

#[derive(Debug)]
pub struct PatientFile(pub File);

impl Write for PatientFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        with_room(|| self.0.write(bytes))
    }

    fn write_vectored(&mut self, parts: &[IoSlice<'_>]) -> io::Result<usize> {
        with_room(|| self.0.write_vectored(parts))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Tries for 3 s at most while the disk, or the quota, is exhausted.
///
/// # Errors
/// Those of `write`.
pub fn with_room<T>(mut write: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let mut late = None;
    loop {
        match write() {
            Err(error) if is_full(&error) => {
                let late = *late.get_or_insert_with(|| {
                    tracing::warn!("waiting for room: {error}");
                    Instant::now() + DEADLINE
                });
                if Instant::now() >= late {
                    return Err(error);
                }
                thread::sleep(PAUSE);
            }
            written => return written,
        }
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_write_waits_for_room_and_not_for_ever() {
        let mut file = PatientFile(File::create("/dev/full").expect("Linux has it"));
        let start = Instant::now();
        assert_eq!(file.write(b"x").expect_err("full").kind(), ErrorKind::StorageFull);
        assert!((DEADLINE..3 * DEADLINE).contains(&start.elapsed()), "{:?}", start.elapsed());
        let mut tries = 0;
        let written = with_room(|| {
            tries += 1;
            if tries < 4 { Err(ErrorKind::StorageFull.into()) } else { Ok(tries) }
        });
        assert_eq!(written.expect("room was made"), 4);
        let other = with_room(|| -> io::Result<()> {
            tries += 1;
            Err(ErrorKind::FileTooLarge.into())
        });
        assert_eq!((other.expect_err("told at once").kind(), tries), (ErrorKind::FileTooLarge, 5));
    }
}
