//! The way to the end of a run, whatever the cause: the nodes first, so that nothing is under way any more, then
//! the master closes its books, then bus and display theirs, then all go. Every step has a deadline.

use std::time::Duration;

use super::Interrupt;
use super::process::{Process, Stage};
use super::state::{Phase, State};
use crate::protocol::hello::Role;

/// From a signal until everybody is killed: all must be over within two seconds.
const INTERRUPTED_DEADLINE: Duration = Duration::from_millis(1500);
/// From a server's death until everybody is killed; the display needs some time for the partial image.
const FAILED_DEADLINE: Duration = Duration::from_secs(5);
/// For the last processes to go after they have told everything.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);
/// From killing a process until its death is confirmed.
const KILL_DEADLINE: Duration = Duration::from_millis(200);

/// Why a run ends.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Cause {
    Complete,
    /// All nodes are set aside.
    NoNodes,
    Interrupted(Interrupt),
    /// A process that cannot be replaced died, which, and how; or the image cannot be vouched for.
    Failed(String),
}

#[derive(Debug)]
pub(super) struct Ending {
    pub(super) cause: Cause,
    step: Step,
    deadline: Duration,
    /// Who kept us waiting past the deadline was killed.
    forced: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    Nodes,
    Master,
    /// Bus and display.
    Books,
    Farewell,
}

impl State {
    /// Whether all that is left to do is to close the books and write the image.
    pub(super) fn is_ending_in_peace(&self) -> bool {
        matches!(&self.phase, Phase::Ending(Ending { cause: Cause::Complete | Cause::NoNodes, .. }))
    }

    /// Whether the run is about to end as complete.
    pub(super) fn is_completing(&self) -> bool {
        matches!(&self.phase, Phase::Ending(Ending { cause: Cause::Complete, .. }))
    }

    /// Begins the end.
    pub(super) fn end(&mut self, cause: Cause) {
        let deadline = self.now + self.patience(&cause, Step::Nodes);
        let gently = cause == Cause::Complete;
        // What is under way to the display, or found by it, is not to be missed.
        self.expect_more_of_display();
        self.phase = Phase::Ending(Ending { cause, step: Step::Nodes, deadline, forced: false });
        let nodes: Vec<_> = self.table.nodes().map(|node| (node.id, node.stage)).collect();
        for (id, stage) in nodes {
            match stage {
                Stage::Connected | Stage::Serving | Stage::Working if gently => self.tell_to_finish(id),
                _ => self.dismiss(id),
            }
        }
    }

    /// The run cannot go on, and why.
    pub(super) fn fail(&mut self, why: String) {
        match &mut self.phase {
            Phase::Running => self.end(Cause::Failed(why)),
            // The first failure is the cause of the others; a signal explains them all.
            Phase::Ending(ending) if matches!(ending.cause, Cause::Complete | Cause::NoNodes) => {
                ending.cause = Cause::Failed(why);
                ending.deadline = ending.deadline.min(self.now + FAILED_DEADLINE);
            }
            Phase::Ending(_) | Phase::Over(_) => self.ledger.incident(self.now, why),
        }
    }

    /// The first signal ends the run and keeps the partial image, the second one ends everything at once.
    pub(super) fn interrupt(&mut self, signal: Interrupt) {
        self.ledger.incident(self.now, format!("interrupted by {signal}"));
        match &mut self.phase {
            Phase::Running => self.end(Cause::Interrupted(signal)),
            Phase::Ending(ending) if matches!(ending.cause, Cause::Complete | Cause::NoNodes) => {
                ending.cause = Cause::Interrupted(signal);
                ending.deadline = ending.deadline.min(self.now + INTERRUPTED_DEADLINE);
            }
            Phase::Ending(ending) => {
                (ending.step, ending.forced) = (Step::Farewell, true);
                ending.deadline = self.now + KILL_DEADLINE;
                self.kill("was killed by a second signal", |_| true);
            }
            Phase::Over(_) => {}
        }
    }

    /// Goes as many steps towards the end as are possible now.
    pub(super) fn advance_ending(&mut self) {
        while let Phase::Ending(ending) = &self.phase {
            let step = ending.step;
            if step != Step::Nodes {
                self.finish_display();
            }
            if self.table.iter().any(|process| keeps_waiting(process, step)) {
                return;
            }
            let next = match step {
                Step::Nodes => {
                    self.finish_or_kill(|role| matches!(role, Role::Master(_)));
                    Step::Master
                }
                Step::Master => {
                    self.finish_or_kill(|role| matches!(role, Role::Bus(_)));
                    Step::Books
                }
                Step::Books => Step::Farewell,
                Step::Farewell => return self.be_over(),
            };
            self.enter_step(next);
        }
    }

    /// Kills those who keep the run waiting past the step's deadline.
    pub(super) fn tick_ending(&mut self) {
        let Phase::Ending(ending) = &mut self.phase else { return };
        if self.now <= ending.deadline {
            return;
        }
        let step = ending.step;
        if ending.forced {
            // Not even killing helped: they go with the manager.
            return self.be_over();
        }
        ending.forced = true;
        ending.deadline = self.now + KILL_DEADLINE;
        self.kill("did not end in time", |process| keeps_waiting(process, step));
    }

    fn enter_step(&mut self, step: Step) {
        let Phase::Ending(ending) = &self.phase else { return };
        let deadline = self.now + self.patience(&ending.cause, step);
        let Phase::Ending(ending) = &mut self.phase else { return };
        ending.step = step;
        let peaceful = matches!(ending.cause, Cause::Complete | Cause::NoNodes);
        if peaceful || step == Step::Farewell {
            ending.deadline = deadline;
        } else if ending.forced {
            // An end that is not peaceful has one deadline for all steps; this one has had to wait for a killing.
            ending.deadline = self.now + KILL_DEADLINE;
        }
        ending.forced = false;
    }

    fn patience(&self, cause: &Cause, step: Step) -> Duration {
        match (cause, step) {
            (Cause::Interrupted(_), Step::Farewell) => KILL_DEADLINE,
            (Cause::Interrupted(_), _) => INTERRUPTED_DEADLINE,
            (_, Step::Farewell) => FAREWELL_DEADLINE,
            (Cause::Failed(_), _) => FAILED_DEADLINE,
            // As long as a tile may take: closing a recording and writing an image are work too.
            (Cause::Complete | Cause::NoNodes, _) => self.plan.run.deadlines.tile,
        }
    }

    fn finish_or_kill(&mut self, chosen: fn(Role) -> bool) {
        let chosen = self.table.iter().filter(|process| chosen(process.id.role));
        let chosen: Vec<_> = chosen.map(|process| (process.id, process.stage)).collect();
        for (id, stage) in chosen {
            match stage {
                Stage::Serving => self.tell_to_finish(id),
                stage if stage < Stage::Serving => self.dismiss(id),
                _ => {}
            }
        }
    }

    /// Asks the display for the image, once, after it has reported what it holds; one that came in the place of another
    /// must be there first.
    fn finish_display(&mut self) {
        let id = self.display_process();
        let in_peace = self.is_ending_in_peace();
        match self.table.get_mut(id).map(|display| display.stage) {
            Some(Stage::Serving) if !self.has_told_all() => {}
            Some(Stage::Serving) => {
                self.tell_to_finish(id);
                self.enter(id, Stage::Working);
            }
            Some(Stage::Spawned | Stage::Connected) if !in_peace => self.dismiss(id),
            _ => {}
        }
    }

    fn kill(&mut self, why: &str, chosen: impl Fn(&Process) -> bool) {
        let chosen: Vec<_> = self.table.iter().filter(|process| chosen(process)).map(|process| process.id).collect();
        chosen.into_iter().for_each(|id| self.doom(id, why.to_owned()));
    }

    fn be_over(&mut self) {
        if let Phase::Ending(ending) = &self.phase {
            self.phase = Phase::Over(ending.cause.clone());
        }
    }
}

/// Whether a step is not done because of this process.
fn keeps_waiting(process: &Process, step: Step) -> bool {
    let open = process.stage < Stage::Finished;
    match step {
        Step::Nodes => process.id.node().is_some(),
        Step::Master => matches!(process.id.role, Role::Master(_)) && open,
        Step::Books => open,
        Step::Farewell => true,
    }
}
