//! How far a long work is, on standard error: a bar on a terminal, a line every other second elsewhere.

use std::io::{IsTerminal, stderr};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::outlet::{self, STANDARD_ERROR};

/// Between two lines where standard error is no terminal.
const LINE_PERIOD: Duration = Duration::from_secs(2);

/// What is done so far.
#[derive(Clone, Copy, Debug)]
pub struct Status {
    pub tiles_done: u32,
    pub tiles: u32,
    /// Of the tiles done.
    pub rays: u64,
    /// Since the first tile was begun; `None` before.
    pub elapsed: Option<Duration>,
}

pub enum Progress {
    Quiet,
    Bar(ProgressBar),
    Lines { next: Duration },
}

impl Progress {
    pub fn new(quiet: bool, tiles: u32) -> Self {
        if quiet {
            return Self::Quiet;
        }
        if !stderr().is_terminal() {
            return Self::Lines { next: LINE_PERIOD };
        }
        let template = "{bar:32} {pos}/{len} tiles, {msg}";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        Self::Bar(ProgressBar::new(u64::from(tiles)).with_style(style))
    }

    /// Called often; shows something when it is time.
    pub fn show(&mut self, status: &Status) {
        match self {
            Self::Bar(bar) if STANDARD_ERROR.is_ready() => {
                bar.set_position(u64::from(status.tiles_done));
                bar.set_message(status.speed());
            }
            Self::Lines { next } if status.elapsed.is_some_and(|elapsed| elapsed >= *next) => {
                *next += LINE_PERIOD;
                status.print_line();
            }
            // A terminal that was stopped must not stop the run.
            Self::Quiet | Self::Bar(_) | Self::Lines { .. } => {}
        }
    }

    /// Shows how far it came, where that was not shown by a bar.
    pub fn finish(self, status: &Status) {
        if let Self::Lines { .. } = self {
            status.print_line();
        }
        self.clear();
    }

    /// Leaves a terminal as if there had been no bar.
    pub fn clear(self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// Steps of unequal length, shown as they are begun.
pub struct Steps {
    quiet: bool,
    bar: Option<ProgressBar>,
}

impl Steps {
    pub fn new(quiet: bool, steps: u32) -> Self {
        let bar = (!quiet && stderr().is_terminal()).then(|| {
            let style = ProgressStyle::with_template("{bar:32} {pos}/{len} {msg}");
            ProgressBar::new(u64::from(steps)).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { quiet, bar }
    }

    pub fn begin(&self, what: &str) {
        match &self.bar {
            Some(bar) => {
                bar.inc(1);
                bar.set_message(what.to_owned());
            }
            None if !self.quiet => outlet::say(what),
            None => {}
        }
    }

    /// Leaves a terminal as if there had been no bar.
    pub fn clear(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Parts of a work that several threads do.
pub struct Parts {
    quiet: bool,
    what: &'static str,
    bar: Option<ProgressBar>,
    start: Instant,
    done: AtomicUsize,
    /// When the next line is due, where standard error is no terminal.
    next: Mutex<Duration>,
}

impl Parts {
    /// `what` parts are, as in `12/80 settings`.
    pub fn new(quiet: bool, what: &'static str) -> Self {
        let bar = (!quiet && stderr().is_terminal()).then(|| {
            let style = ProgressStyle::with_template("{bar:32} {pos}/{len} {msg}, {eta} left");
            let bar = ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.with_message(what)
        });
        Self { quiet, what, bar, start: Instant::now(), done: AtomicUsize::new(0), next: Mutex::new(LINE_PERIOD) }
    }

    /// One more of `all` is done.
    pub fn done(&self, all: usize) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(bar) = &self.bar {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        } else if !self.quiet
            && let Ok(mut next) = self.next.try_lock()
            && self.start.elapsed() >= *next
        {
            let seconds = self.start.elapsed().as_secs_f64();
            let left = seconds * all.saturating_sub(done) as f64 / done as f64;
            *next = self.start.elapsed() + LINE_PERIOD;
            outlet::say(format_args!("{done}/{all} {}, {left:.0} s left", self.what));
        }
    }

    /// Leaves a terminal as if there had been no bar.
    pub fn clear(self) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Status {
    fn print_line(&self) {
        outlet::say(format_args!("{}/{} tiles, {}", self.tiles_done, self.tiles, self.speed()));
    }

    /// Rays a second so far, and the time that the missing tiles will take at the speed of those done.
    fn speed(&self) -> String {
        let Some(elapsed) = self.elapsed else { return "starting".to_owned() };
        let seconds = elapsed.as_secs_f64().max(1e-9);
        let left = match self.tiles_done {
            0 => "?".to_owned(),
            done => format!("{:.0}", seconds * f64::from(self.tiles - done) / f64::from(done)),
        };
        format!("{:.3} Mrays/s, {left} s left", self.rays as f64 / seconds * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_tiles_done() {
        let status = Status { tiles_done: 0, tiles: 40, rays: 0, elapsed: None };
        assert_eq!(status.speed(), "starting");
        let status = Status { elapsed: Some(Duration::from_secs(1)), ..status };
        assert_eq!(status.speed(), "0.000 Mrays/s, ? s left");
        let status = Status { tiles_done: 10, rays: 5_000_000, elapsed: Some(Duration::from_secs(2)), ..status };
        assert_eq!(status.speed(), "2.500 Mrays/s, 6 s left");
    }
}
