//! The way to the end of a run, whatever the cause: the nodes first, so that nothing is under way any more, then
//! the master closes its books, then bus and display theirs, then all go. Every step has a deadline.

use std::time::Duration;

use super::super::cause::{Cause, Interrupt};
use super::super::process::{Command, Process, ProcessId, Stage};
use super::display::Display;
use super::supervision::Supervision;
use super::tiles::Tiles;
use crate::protocol::control::{BusCommand, DisplayCommand, MasterCommand, NodeCommand};
use crate::protocol::hello::Role;

/// From a signal until everybody is killed: all must be over within two seconds.
const INTERRUPTED_DEADLINE: Duration = Duration::from_millis(1500);
/// From a server's death until everybody is killed; the display needs some time for the partial image.
const FAILED_DEADLINE: Duration = Duration::from_secs(5);
/// For the masters to close their books where the end is not peaceful.
const MASTERS_DEADLINE: Duration = Duration::from_millis(500);
/// For the last processes to end after they have reported everything.
const FAREWELL_DEADLINE: Duration = Duration::from_secs(2);
/// From killing a process until its death is confirmed.
const KILL_DEADLINE: Duration = Duration::from_millis(200);

#[derive(Debug)]
pub(crate) struct Ending {
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Running,
    Closing(Closing),
    Over(Cause),
}

#[derive(Debug)]
struct Closing {
    cause: Cause,
    step: Step,
    deadline: Duration,
    /// Of all steps together, where the end is not peaceful.
    last: Duration,
    /// Who kept us waiting past the deadline was killed.
    forced: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Step {
    Nodes,
    Master,
    /// Bus and display.
    Books,
    Farewell,
}

impl Ending {
    pub(super) fn new() -> Self {
        Self { phase: Phase::Running }
    }

    /// Whether the end has not begun.
    pub(crate) fn is_running(&self) -> bool {
        matches!(self.phase, Phase::Running)
    }

    /// Why the run is about to end.
    pub(super) fn cause(&self) -> Option<&Cause> {
        match &self.phase {
            Phase::Closing(closing) => Some(&closing.cause),
            Phase::Running | Phase::Over(_) => None,
        }
    }

    /// Whether all that is left to do is to close the books and write the image.
    pub(super) fn is_orderly(&self) -> bool {
        self.cause().is_some_and(Cause::is_orderly)
    }

    /// Whether the run is about to end as complete.
    pub(super) fn is_completing(&self) -> bool {
        self.cause() == Some(&Cause::Complete)
    }

    /// Why the run ended, once it has.
    pub(super) fn over(&self) -> Option<&Cause> {
        match &self.phase {
            Phase::Over(cause) => Some(cause),
            Phase::Running | Phase::Closing(_) => None,
        }
    }

    /// Begins the end of a run.
    pub(super) fn begin(&mut self, cause: Cause, tiles: &mut Tiles, supervision: &mut Supervision) {
        let deadline = supervision.now + patience(&cause, Step::Nodes, supervision);
        let gently = cause == Cause::Complete;
        self.phase = Phase::Closing(Closing { cause, step: Step::Nodes, deadline, last: deadline, forced: false });
        let nodes: Vec<_> = supervision.table.nodes().map(|node| (node.id, node.stage)).collect();
        for (id, stage) in nodes {
            match stage {
                Stage::Connected | Stage::Serving | Stage::Working if gently => finish(id, tiles, supervision),
                _ => supervision.dismiss(id),
            }
        }
    }

    /// The run that is about to end fails, and why. The first failure is the cause of the others; a signal explains them
    /// all.
    pub(super) fn fail(&mut self, why: String, supervision: &mut Supervision) {
        match &mut self.phase {
            Phase::Closing(closing) if closing.cause.is_orderly() => {
                closing.cause = Cause::Failed(why);
                closing.deadline = closing.deadline.min(supervision.now + FAILED_DEADLINE);
                closing.last = closing.deadline;
            }
            _ => supervision.incident(why),
        }
    }

    /// A signal to a run that is about to end: the first one keeps the partial image, the second one ends everything at
    /// once.
    pub(super) fn interrupt(&mut self, signal: Interrupt, supervision: &mut Supervision) {
        let Phase::Closing(closing) = &mut self.phase else { return };
        if closing.cause.is_orderly() {
            closing.cause = Cause::Interrupted(signal);
            closing.deadline = closing.deadline.min(supervision.now + INTERRUPTED_DEADLINE);
            closing.last = closing.deadline;
            return;
        }
        (closing.step, closing.forced) = (Step::Farewell, true);
        closing.deadline = supervision.now + KILL_DEADLINE;
        kill(supervision, "was killed by a second signal", |_| true);
    }

    /// Goes as many steps towards the end as are possible now.
    pub(super) fn advance(&mut self, display: &mut Display, tiles: &mut Tiles, supervision: &mut Supervision) {
        while let Phase::Closing(closing) = &mut self.phase {
            let step = closing.step;
            // What a master found out before an end that is not peaceful is in the journal before the display ends.
            let is_next = step == Step::Master && closing.cause.is_orderly();
            if is_next || step > Step::Master {
                finish_display(closing.cause.is_orderly(), display, tiles, supervision);
            }
            if supervision.table.iter().any(|process| keeps_waiting(process, step)) {
                return;
            }
            let next = match step {
                Step::Nodes => {
                    finish_or_kill(|role| matches!(role, Role::Master(_)), tiles, supervision);
                    Step::Master
                }
                Step::Master => {
                    finish_or_kill(|role| matches!(role, Role::Bus(_)), tiles, supervision);
                    Step::Books
                }
                Step::Books => Step::Farewell,
                Step::Farewell => return self.be_over(tiles),
            };
            closing.enter(next, supervision);
        }
    }

    /// Kills those who keep the run waiting past the step's deadline.
    pub(super) fn tick(&mut self, tiles: &Tiles, supervision: &mut Supervision) {
        let Phase::Closing(closing) = &mut self.phase else { return };
        if supervision.now <= closing.deadline {
            return;
        }
        let step = closing.step;
        if closing.forced {
            // Not even killing helped: they go with the manager.
            return self.be_over(tiles);
        }
        closing.forced = true;
        closing.deadline = supervision.now + KILL_DEADLINE;
        kill(supervision, "did not end in time", |process| keeps_waiting(process, step));
    }

    fn be_over(&mut self, tiles: &Tiles) {
        self.phase = match self.cause() {
            Some(Cause::Complete) if tiles.ledger.display.is_none() => {
                Phase::Over(Cause::Failed("the display ended without an image".to_owned()))
            }
            Some(cause) => Phase::Over(cause.clone()),
            None => return,
        };
    }
}

impl Closing {
    fn enter(&mut self, step: Step, supervision: &Supervision) {
        self.step = step;
        if self.cause.is_orderly() || step == Step::Farewell {
            self.deadline = supervision.now + patience(&self.cause, step, supervision);
        } else {
            // An end that is not peaceful has one deadline for all steps, but for masters that hang: the display is to write
            // what there is. A step that has had to wait for a killing has some time in any case.
            let least = if self.forced { supervision.now + KILL_DEADLINE } else { Duration::ZERO };
            let most = if step == Step::Master { supervision.now + MASTERS_DEADLINE } else { Duration::MAX };
            self.deadline = self.last.max(least).min(most);
        }
        self.forced = false;
    }
}

fn patience(cause: &Cause, step: Step, supervision: &Supervision) -> Duration {
    match (cause, step) {
        (Cause::Interrupted(_), Step::Farewell) => KILL_DEADLINE,
        (Cause::Interrupted(_), _) => INTERRUPTED_DEADLINE,
        (_, Step::Farewell) => FAREWELL_DEADLINE,
        (Cause::Failed(_), _) => FAILED_DEADLINE,
        // As long as a tile may take: closing a recording and writing an image are work too.
        (Cause::Complete | Cause::NoNodes, _) => supervision.plan.run.deadlines.tile,
    }
}

/// Tells a process to come to its end, in its own words.
fn finish(id: ProcessId, tiles: &mut Tiles, supervision: &mut Supervision) {
    let command = match id.role {
        Role::Bus(cluster) => Command::Bus(BusCommand::Finish { lost: tiles.lost((cluster, id.epoch)) }),
        Role::Master(_) => Command::Master(MasterCommand::Finish),
        Role::Node(_) => Command::Node(NodeCommand::Finish),
        Role::Display => Command::Display(DisplayCommand::Finish),
        Role::Manager => return,
    };
    supervision.tell(id, command);
}

fn finish_or_kill(chosen: fn(Role) -> bool, tiles: &mut Tiles, supervision: &mut Supervision) {
    let chosen = supervision.table.iter().filter(|process| chosen(process.id.role));
    let chosen: Vec<_> = chosen.map(|process| (process.id, process.stage)).collect();
    for (id, stage) in chosen {
        match stage {
            Stage::Serving => finish(id, tiles, supervision),
            stage if stage < Stage::Serving => supervision.dismiss(id),
            _ => {}
        }
    }
}

/// Asks the display for the image, once, after it has reported what it holds; one that came in the place of another
/// must be there first.
fn finish_display(in_peace: bool, display: &mut Display, tiles: &mut Tiles, supervision: &mut Supervision) {
    let id = display.process();
    match supervision.table.get_mut(id).map(|display| display.stage) {
        Some(Stage::Serving) if !display.has_told_all(supervision) => {}
        Some(Stage::Serving) => {
            finish(id, tiles, supervision);
            supervision.enter(id, Stage::Working);
        }
        Some(Stage::Spawned | Stage::Connected) if !in_peace => supervision.dismiss(id),
        _ => {}
    }
}

fn kill(supervision: &mut Supervision, why: &str, chosen: impl Fn(&Process) -> bool) {
    supervision.those(chosen).into_iter().for_each(|id| supervision.kill(id, why.to_owned()));
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
