//! Whether the threads of a process make progress. A thread that is at work, takes no step and uses no processor time is
//! stuck: it waits for a lock or for a disk, for example.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use nix::libc;
use nix::time::{ClockId, clock_gettime};

/// The threads of a process that are watched. Clones are one.
#[derive(Clone, Debug, Default)]
pub struct Pulse(Arc<Mutex<Vec<Weak<Turns>>>>);

/// A thread's own end. The thread is watched until it is dropped.
#[derive(Debug)]
pub struct Beacon(Arc<Turns>);

#[derive(Debug)]
struct Turns {
    /// Of the thread, for messages.
    name: &'static str,
    /// Odd: at work.
    count: AtomicU64,
    /// Of the thread's processor time; `None` where the system has no such clock.
    clock: Option<ClockId>,
}

impl Pulse {
    /// Begins to watch the calling thread, which is idle.
    pub fn beacon(&self, name: &'static str) -> Beacon {
        let turns = Arc::new(Turns { name, count: AtomicU64::new(0), clock: clock_of_this_thread() });
        let mut watched = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        watched.retain(|turns| turns.strong_count() > 0);
        watched.push(Arc::downgrade(&turns));
        Beacon(turns)
    }
}

impl Beacon {
    /// The thread is at work, and has got a step further.
    pub fn turn(&self) {
        self.set(|count| (count | 1) + 2);
    }

    /// The thread waits for work.
    pub fn idle(&self) {
        self.set(|count| (count | 1) + 1);
    }

    fn set(&self, next: impl Fn(u64) -> u64) {
        // The thread alone writes.
        self.0.count.store(next(self.0.count.load(Ordering::Relaxed)), Ordering::Relaxed);
    }
}

/// Looks at a pulse every so often.
#[derive(Debug)]
pub struct Watch {
    pulse: Pulse,
    /// Looks without a change after which a thread is stuck. Not a time: a process that was stopped is not stuck.
    looks_max: u32,
    seen: Vec<Seen>,
}

#[derive(Debug)]
struct Seen {
    turns: Weak<Turns>,
    count: u64,
    cpu: Option<libc::timespec>,
    looks: u32,
}

impl Watch {
    pub fn new(pulse: Pulse, looks_max: u32) -> Self {
        Self { pulse, looks_max, seen: Vec::new() }
    }

    /// The name of a thread that is stuck.
    pub fn look(&mut self) -> Option<&'static str> {
        let watched = self.pulse.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.seen.retain(|seen| seen.turns.strong_count() > 0);
        for turns in watched {
            if !self.seen.iter().any(|seen| seen.turns.ptr_eq(&turns)) {
                self.seen.push(Seen { turns, count: 0, cpu: None, looks: 0 });
            }
        }
        let looks_max = self.looks_max;
        self.seen.iter_mut().find_map(|seen| seen.look().filter(|_| seen.looks >= looks_max))
    }
}

impl Seen {
    fn look(&mut self) -> Option<&'static str> {
        let turns = self.turns.upgrade()?;
        let (count, cpu) = (turns.count.load(Ordering::Relaxed), turns.cpu());
        let is_stuck = count % 2 == 1 && (count, cpu) == (self.count, self.cpu);
        self.looks = if is_stuck { self.looks + 1 } else { 0 };
        (self.count, self.cpu) = (count, cpu);
        Some(turns.name)
    }
}

impl Turns {
    fn cpu(&self) -> Option<libc::timespec> {
        Some(*clock_gettime(self.clock?).ok()?.as_ref())
    }
}

fn clock_of_this_thread() -> Option<ClockId> {
    let mut clock = 0;
    // SAFETY: the calling thread lives, and the clock is written to memory of our own.
    let error = unsafe { libc::pthread_getcpuclockid(libc::pthread_self(), &raw mut clock) };
    (error == 0).then(|| ClockId::from_raw(clock))
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;
    use std::sync::mpsc::channel;
    use std::thread;
    use std::time::{Duration, Instant};

    use super::*;

    /// Whether a thread that behaves so is found stuck by ten looks, two without a change being enough.
    fn is_found(behave: impl FnOnce(&Beacon, &dyn Fn()) + Send) -> bool {
        let pulse = Pulse::default();
        let (ended, end) = channel::<()>();
        thread::scope(|scope| {
            let (ready, is_ready) = channel();
            let watched = pulse.clone();
            scope.spawn(move || {
                let beacon = watched.beacon("test");
                behave(&beacon, &|| ready.send(()).expect("awaited"));
                let _ = end.recv();
            });
            is_ready.recv().expect("behaves");
            let mut watch = Watch::new(pulse, 2);
            let found = (0..10).any(|_| {
                thread::sleep(Duration::from_millis(20));
                watch.look() == Some("test")
            });
            drop(ended);
            found
        })
    }

    #[test]
    fn a_thread_that_waits_while_at_work_is_stuck() {
        let waits = |beacon: &Beacon, ready: &dyn Fn()| {
            beacon.idle();
            beacon.turn();
            ready();
        };
        assert!(is_found(waits));
    }

    #[test]
    fn a_thread_that_is_idle_calculates_or_turns_is_not() {
        let is_idle = |beacon: &Beacon, ready: &dyn Fn()| {
            beacon.turn();
            beacon.idle();
            ready();
        };
        assert!(!is_found(is_idle));
        let calculates = |beacon: &Beacon, ready: &dyn Fn()| {
            beacon.turn();
            ready();
            let start = Instant::now();
            while start.elapsed() < Duration::from_millis(400) {
                black_box(start);
            }
        };
        assert!(!is_found(calculates));
        let turns = |beacon: &Beacon, ready: &dyn Fn()| {
            ready();
            (0..80).for_each(|_| {
                beacon.turn();
                thread::sleep(Duration::from_millis(5));
            });
        };
        assert!(!is_found(turns));
    }

    #[test]
    fn a_thread_that_has_ended_is_forgotten() {
        let pulse = Pulse::default();
        pulse.beacon("gone").turn();
        let mut watch = Watch::new(pulse, 1);
        assert_eq!((0..5).find_map(|_| watch.look()), None);
    }
}
