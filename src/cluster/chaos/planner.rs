//! Which faults are due.

use std::time::Duration;

use super::{Fault, When};

/// How far a run has come.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Progress {
    pub tiles_done: u32,
    pub tiles: u32,
    /// Since the first tile was handed out; `None` before.
    pub elapsed: Option<Duration>,
}

/// The faults that did not come to pass yet, in the order of the schedule.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Planner {
    waiting: Vec<Fault>,
}

impl Planner {
    pub fn new(faults: Vec<Fault>) -> Self {
        Self { waiting: faults }
    }

    /// The next fault to carry out, each once; asked again until there is none. `can_be_met` says whether a process
    /// holds the place that the fault could be done to: if not, the fault waits for one. Nothing is due before the
    /// first tile is handed out or after the last one is done.
    pub fn due(&mut self, progress: Progress, can_be_met: impl Fn(&Fault) -> bool) -> Option<Fault> {
        let elapsed = progress.elapsed.filter(|_| progress.tiles_done < progress.tiles)?;
        let is_due = |when: When| match when {
            When::Done(share) => share.is_reached(progress.tiles_done, progress.tiles),
            When::After(time) => elapsed >= time.duration(),
        };
        let next = self.waiting.iter().position(|fault| is_due(fault.when) && can_be_met(fault))?;
        Some(self.waiting.remove(next))
    }

    pub fn waiting(&self) -> &[Fault] {
        &self.waiting
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::chaos::{Cast, FaultSchedule};

    const CAST: Cast = Cast { clusters: 1, nodes: 3 };

    fn planner(text: &str) -> Planner {
        Planner::new(text.parse::<FaultSchedule>().expect("a schedule").faults(CAST).expect("of this cast"))
    }

    fn at(tiles_done: u32, seconds: f64) -> Progress {
        Progress { tiles_done, tiles: 40, elapsed: Some(Duration::from_secs_f64(seconds)) }
    }

    fn all_due(planner: &mut Planner, progress: Progress, lives: impl Fn(&Fault) -> bool) -> Vec<String> {
        std::iter::from_fn(|| planner.due(progress, &lives)).map(|fault| fault.to_string()).collect()
    }

    #[test]
    fn a_fault_comes_when_it_is_due_and_its_process_lives() {
        let mut planner = planner("kill node 2@50%; kill node 1@0.5s; kill node 0@0%");
        let mut due = |progress, lives: bool| all_due(&mut planner, progress, |_| lives);
        assert!(due(Progress { elapsed: None, ..at(0, 0.0) }, true).is_empty(), "no tile is out");
        assert!(due(at(0, 0.0), false).is_empty());
        assert_eq!(due(at(1, 0.1), true), ["kill node 0@0%"]);
        assert!(due(at(19, 0.499), true).is_empty());
        assert_eq!(due(at(20, 0.5), true), ["kill node 2@50%", "kill node 1@0.5s"]);
        assert!(due(at(21, 9.0), true).is_empty());
    }

    #[test]
    fn a_run_that_is_done_is_left_alone() {
        let mut planner = planner("kill node 2@99.9%");
        assert!(all_due(&mut planner, at(40, 1.0), |_| true).is_empty());
        assert_eq!(planner.waiting().len(), 1);
    }

    proptest! {
        #[test]
        fn each_fault_comes_once_and_never_early(
            seed: u64,
            steps in proptest::collection::vec((0..3u32, 0..500u64, any::<[bool; 3]>()), 1..60),
        ) {
            let mut planner = planner(&format!("random(9 node); kill node@1s; kill node@3s; seed={seed}"));
            let (all, mut came) = (planner.waiting().to_vec(), Vec::new());
            let (mut done, mut milliseconds) = (0, 0);
            for (tiles, time, living) in steps {
                (done, milliseconds) = ((done + tiles).min(39), milliseconds + time);
                let progress = at(done, milliseconds as f64 / 1e3);
                let lives = |fault: &Fault| matches!(fault.on, crate::chaos::ProcessSlot::Node(n) if living[usize::from(n.0)]);
                while let Some(fault) = planner.due(progress, lives) {
                    prop_assert!(lives(&fault));
                    match fault.when {
                        When::Done(share) => prop_assert!(share.is_reached(done, 40)),
                        When::After(time) => prop_assert!(time.duration() <= Duration::from_millis(milliseconds)),
                    }
                    came.push(fault);
                }
                // Nothing is held back.
                prop_assert!(planner.clone().due(progress, lives).is_none());
            }
            while let Some(fault) = planner.due(at(39, 1e4), |_| true) {
                came.push(fault);
            }
            prop_assert!(planner.waiting().is_empty());
            let sorted = |faults: Vec<Fault>| {
                let mut texts: Vec<_> = faults.iter().map(ToString::to_string).collect();
                texts.sort();
                texts
            };
            prop_assert_eq!(sorted(came), sorted(all));
        }
    }
}
