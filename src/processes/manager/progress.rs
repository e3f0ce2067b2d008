//! How far the run is, on standard error: a bar on a terminal, a line every other second elsewhere.

use std::io::{IsTerminal, Write, stderr};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::state::State;

/// Between two lines where standard error is no terminal.
const LINE_PERIOD: Duration = Duration::from_secs(2);

pub(super) enum Progress {
    Quiet,
    Bar(ProgressBar),
    Lines { last: Duration },
}

impl Progress {
    pub(super) fn new(quiet: bool, tiles: u32) -> Self {
        if quiet {
            return Self::Quiet;
        }
        if !stderr().is_terminal() {
            return Self::Lines { last: Duration::ZERO };
        }
        let template = "{bar:32} {pos}/{len} tiles, {msg}";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        Self::Bar(ProgressBar::new(u64::from(tiles)).with_style(style))
    }

    /// Called often; shows something when it is time.
    pub(super) fn show(&mut self, state: &State) {
        match self {
            Self::Quiet => {}
            Self::Bar(bar) => {
                bar.set_position(u64::from(state.queue.total() - state.queue.missing()));
                bar.set_message(speed(state));
            }
            Self::Lines { last } if state.now >= *last + LINE_PERIOD && state.ledger.first_tile.is_some() => {
                *last = state.now;
                print_line(state);
            }
            Self::Lines { .. } => {}
        }
    }

    pub(super) fn finish(self, state: &State) {
        match self {
            Self::Quiet => {}
            Self::Bar(bar) => bar.finish_and_clear(),
            Self::Lines { .. } => print_line(state),
        }
    }
}

fn print_line(state: &State) {
    let (total, missing) = (state.queue.total(), state.queue.missing());
    // Nobody is left to be told that standard error is closed.
    let _ = writeln!(stderr(), "{}/{total} tiles, {}", total - missing, speed(state));
}

/// Rays a second so far, and the time that the missing tiles will take at the speed of those done.
fn speed(state: &State) -> String {
    let Some(first) = state.ledger.first_tile else { return "starting".to_owned() };
    let end = if state.queue.missing() == 0 { state.ledger.last_tile.unwrap_or(state.now) } else { state.now };
    let seconds = end.saturating_sub(first).as_secs_f64().max(1e-9);
    let done = state.queue.total() - state.queue.missing();
    let rays = state.ledger.trace.all_rays() as f64 / seconds;
    let left = match done {
        0 => "?".to_owned(),
        done => format!("{:.0}", seconds * f64::from(state.queue.missing()) / f64::from(done)),
    };
    format!("{:.3} Mrays/s, {left} s left", rays * 1e-6)
}
