//! Signals that ask a program to end, for one that keeps what it has: the first is noted, a second ends it at once.

use std::io;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::thread;

use nix::errno::Errno;
use nix::libc;
use nix::sys::signal::{SigSet, Signal};

/// Whether a signal has come.
#[derive(Clone, Debug, Default)]
pub struct Interruption(Arc<AtomicI32>);

impl Interruption {
    /// Waits for SIGINT, SIGTERM and SIGHUP from here on. To be called before other threads are started: they inherit
    /// that the signals are blocked. SIGHUP is left alone where it is ignored (`nohup`).
    ///
    /// # Errors
    /// The system has no thread, or does not let signals be blocked.
    pub fn watch() -> io::Result<Self> {
        let mut signals = SigSet::empty();
        signals.add(Signal::SIGINT);
        signals.add(Signal::SIGTERM);
        if !is_ignored(Signal::SIGHUP)? {
            signals.add(Signal::SIGHUP);
        }
        signals.thread_block()?;
        let interruption = Self::default();
        let noted = interruption.clone();
        thread::Builder::new().name("signals".to_owned()).spawn(move || {
            if let Ok(signal) = signals.wait() {
                noted.0.store(signal as i32, Ordering::Relaxed);
            }
            // The next one finds a thread that does not block it, and ends the process.
            let _ = signals.thread_unblock();
            loop {
                thread::park();
            }
        })?;
        Ok(interruption)
    }

    /// The signal that came first.
    pub fn signal(&self) -> Option<Signal> {
        Signal::try_from(self.0.load(Ordering::Relaxed)).ok()
    }
}

/// Whether this process was started to outlive a signal.
///
/// # Errors
/// The system does not tell.
pub fn is_ignored(signal: Signal) -> io::Result<bool> {
    let mut found = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: no new action is given; the present one is written to memory that is ours, of its type.
    let outcome = unsafe { libc::sigaction(signal as i32, ptr::null(), found.as_mut_ptr()) };
    Errno::result(outcome)?;
    // SAFETY: the call succeeded, and all zeros are an action too.
    Ok(unsafe { found.assume_init() }.sa_sigaction == libc::SIG_IGN)
}
