//! A bus from its first command to its end, as the manager sees it. What goes on between its clients and the memory is decided
//! in `state`, on a thread of its own.

use std::time::Duration;

use bytes::BytesMut;

use crate::processes::driver::{self, Admission, Machine};
use crate::protocol::control::{BusCommand, BusConfiguration, BusReport};
use crate::protocol::frame::CodecError;
use crate::protocol::hello::Role;
use machine::hardware::totals::{BusTotals, LostAttempt};

/// To serve what has arrived and make the recording whole.
pub const FINISH_DEADLINE: Duration = Duration::from_secs(60);
const WAITING_MAX: usize = 64;

/// A bus talks to nobody here.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Never {}

/// The memory loop's.
#[derive(Clone, PartialEq, Debug)]
pub enum Task {
    Serve(BusConfiguration),
    /// Serve what comes until all have left, and close the recording.
    Finish {
        lost: Vec<LostAttempt>,
    },
}

#[derive(Clone, PartialEq, Debug)]
pub enum Answer {
    Incident(String),
    /// It has ended; well, if it was to finish.
    Ended(Result<BusTotals, String>),
}

type Event = driver::Event<Control>;
type Action = driver::Action<Control>;

#[derive(Debug, Default)]
pub struct Control {
    phase: Phase,
}

#[derive(Debug, Default)]
enum Phase {
    #[default]
    Unconfigured,
    Serving,
    Finishing {
        by: Duration,
    },
    Over,
}

impl Control {
    fn step(&mut self, now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<Option<BusTotals>, String> {
        match (&self.phase, event) {
            (Phase::Over, _) => {}
            (_, Event::Failed(why)) => return Err(why),
            (Phase::Unconfigured, Event::Command(BusCommand::Configure(configuration))) => {
                self.phase = Phase::Serving;
                actions.extend([Action::Task(Task::Serve(configuration)), Action::Listen(Admission::BusClients)]);
            }
            (Phase::Unconfigured, Event::Command(BusCommand::Finish { .. })) => return Ok(Some(BusTotals::default())),
            (_, Event::Command(BusCommand::Configure(_))) => {
                let incident = "configured twice: the second is not heeded".to_owned();
                actions.push(Action::Report(BusReport::Incident(incident)));
            }
            (Phase::Serving, Event::Command(BusCommand::Finish { lost })) => {
                self.phase = Phase::Finishing { by: now + FINISH_DEADLINE };
                actions.push(Action::Task(Task::Finish { lost }));
            }
            (Phase::Serving, Event::Listening(address)) => {
                actions.push(Action::Report(BusReport::Listening(address)));
            }
            (_, Event::Refused(incident) | Event::Answer(Answer::Incident(incident))) => {
                tracing::warn!("{incident}");
                actions.push(Action::Report(BusReport::Incident(incident)));
            }
            (Phase::Finishing { .. }, Event::Answer(Answer::Ended(outcome))) => return outcome.map(Some),
            (_, Event::Answer(Answer::Ended(Err(why)))) => return Err(why),
            (_, Event::Answer(Answer::Ended(Ok(_)))) => {
                return Err("the thread that owns the memory connections has ended".to_owned());
            }
            (&Phase::Finishing { by }, Event::Deadline) if now >= by => {
                return Err(format!("the recording was not closed within {} s", FINISH_DEADLINE.as_secs()));
            }
            _ => {}
        }
        Ok(None)
    }
}

impl Machine for Control {
    type Command = BusCommand;
    type Report = BusReport;
    type Incoming = Never;
    type Outgoing = Never;
    type Task = Task;
    type Answer = Answer;

    const WAITING_MAX: usize = WAITING_MAX;

    fn handle(&mut self, now: Duration, event: Event) -> Vec<Action> {
        let mut actions = Vec::new();
        let end = match self.step(now, event, &mut actions) {
            Ok(None) => return actions,
            Ok(Some(totals)) => (BusReport::Finished(totals), Ok(())),
            Err(why) => (BusReport::Failed(why.clone()), Err(why)),
        };
        self.phase = Phase::Over;
        actions.extend([Action::Report(end.0), Action::End(end.1)]);
        actions
    }

    fn next_deadline(&self) -> Option<Duration> {
        match self.phase {
            Phase::Finishing { by } => Some(by),
            _ => None,
        }
    }

    fn frame_bytes_max(&self, _peer: Role) -> usize {
        0
    }
}

impl driver::Incoming for Never {
    fn decode(_peer: Role, frame: BytesMut) -> Result<Self, CodecError> {
        Err(CodecError::FrameTooLong { bytes: frame.len(), bytes_max: 0 })
    }
}

impl driver::Outgoing for Never {
    fn frame(&self, _head: &mut Vec<u8>) -> Result<[&[u8]; 4], CodecError> {
        match *self {}
    }
}
