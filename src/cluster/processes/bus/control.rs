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
type End = driver::End<Control>;

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

impl Machine for Control {
    type Command = BusCommand;
    type Report = BusReport;
    type Incoming = Never;
    type Outgoing = Never;
    type Task = Task;
    type Answer = Answer;

    const WAITING_MAX: usize = WAITING_MAX;
    const FAILED: fn(String) -> BusReport = BusReport::Failed;

    fn step(&mut self, now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        match (&self.phase, event) {
            (Phase::Over, _) => {}
            (_, Event::Failed(why)) => return Err(End::Failed(why)),
            (Phase::Unconfigured, Event::Command(BusCommand::Configure(configuration))) => {
                self.phase = Phase::Serving;
                actions.extend([Action::Task(Task::Serve(configuration)), Action::Listen(Admission::BusClients)]);
            }
            (Phase::Unconfigured, Event::Command(BusCommand::Finish { .. })) => {
                return Err(End::Done(BusReport::Finished(BusTotals::default())));
            }
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
            (Phase::Finishing { .. }, Event::Answer(Answer::Ended(Ok(totals)))) => {
                return Err(End::Done(BusReport::Finished(totals)));
            }
            (_, Event::Answer(Answer::Ended(Err(why)))) => return Err(End::Failed(why)),
            (_, Event::Answer(Answer::Ended(Ok(_)))) => {
                return Err("the thread that owns the memory connections has ended".into());
            }
            (&Phase::Finishing { by }, Event::Deadline) if now >= by => {
                return Err(format!("the recording was not closed within {} s", FINISH_DEADLINE.as_secs()).into());
            }
            _ => {}
        }
        Ok(())
    }

    fn be_over(&mut self) {
        self.phase = Phase::Over;
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

#[cfg(test)]
#[path = "control_tests.rs"]
mod tests;
