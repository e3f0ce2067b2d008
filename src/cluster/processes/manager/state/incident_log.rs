//! What went wrong and was dealt with.

use std::time::Duration;

use crate::report::Incident;

/// More incidents are counted, not kept: a peer that knocks all the time must not fill the memory.
const INCIDENTS_MAX: usize = 1000;

#[derive(Debug, Default)]
pub(crate) struct IncidentLog {
    kept: Vec<Incident>,
    dropped: u64,
}

impl IncidentLog {
    /// `now` is the time since the run began.
    pub(super) fn add(&mut self, now: Duration, text: impl AsRef<str>) {
        if self.kept.len() < INCIDENTS_MAX {
            let incident = Incident::new(now, text.as_ref());
            tracing::warn!("{}", incident.text);
            self.kept.push(incident);
        } else {
            self.drop_one();
        }
    }

    /// Counts an incident that is not kept.
    pub(super) fn drop_one(&mut self) {
        self.dropped += 1;
    }

    pub(crate) fn count(&self) -> u64 {
        self.kept.len() as u64 + self.dropped
    }

    /// Those that are kept.
    #[cfg(any(test, feature = "testing"))]
    pub(crate) fn len(&self) -> usize {
        self.kept.len()
    }

    /// All of them, the last one saying how many more there were.
    pub(crate) fn all(&self) -> Vec<Incident> {
        let mut all = self.kept.clone();
        if let (Some(last), 1..) = (all.last(), self.dropped) {
            let text = format!("{} more incidents, counted only", self.dropped);
            all.push(Incident { seconds: last.seconds, text });
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incidents_are_bounded() {
        let mut log = IncidentLog::default();
        (0..1500).for_each(|i| log.add(Duration::from_secs(i), format!("{i}")));
        let incidents = log.all();
        assert_eq!(incidents.len(), INCIDENTS_MAX + 1);
        assert_eq!(incidents[INCIDENTS_MAX].text, "500 more incidents, counted only");
    }
}
