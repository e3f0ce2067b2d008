//! How long a run stood still because of a fault.

use std::time::Duration;

use super::Progress;

/// The longest time without another tile done, from the first fault on.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct LongestWait {
    /// Since when nothing was done; `None` before the first fault.
    since: Option<Duration>,
    tiles_done: u32,
    longest: Duration,
}

impl LongestWait {
    /// A fault came to pass.
    pub fn disturbed(&mut self, now: Duration) {
        self.since.get_or_insert(now);
    }

    /// To be called after every event.
    pub fn note(&mut self, now: Duration, progress: Progress) {
        let goes_on = self.tiles_done < progress.tiles;
        if let Some(since) = self.since.filter(|_| goes_on) {
            self.longest = self.longest.max(now.saturating_sub(since));
        }
        if !goes_on || progress.tiles_done > self.tiles_done {
            self.since = self.since.map(|_| now);
        }
        // Tiles that turn out wrong are missing again.
        self.tiles_done = progress.tiles_done;
    }

    pub fn longest(&self) -> Duration {
        self.longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_without_a_tile_counts_from_the_first_fault_to_the_last_tile() {
        let mut wait = LongestWait::default();
        let note = |wait: &mut LongestWait, second, tiles_done| {
            let now = Duration::from_secs(second);
            wait.note(now, Progress { tiles_done, tiles: 3, elapsed: Some(now) });
            wait.longest().as_secs()
        };
        assert_eq!(note(&mut wait, 50, 0), 0);
        wait.disturbed(Duration::from_secs(51));
        assert_eq!(note(&mut wait, 53, 1), 2);
        assert_eq!(note(&mut wait, 54, 1), 2);
        wait.disturbed(Duration::from_secs(55));
        assert_eq!(note(&mut wait, 58, 2), 5);
        // A tile is taken back.
        assert_eq!(note(&mut wait, 59, 1), 5);
        assert_eq!(note(&mut wait, 61, 2), 5);
        assert_eq!(note(&mut wait, 62, 3), 5);
        assert_eq!(note(&mut wait, 99, 3), 5);
        // Even the last one.
        assert_eq!(note(&mut wait, 100, 2), 5);
        assert_eq!(note(&mut wait, 107, 3), 7);
    }
}
