//! A display from its first command to its end. No socket, no file. What is in the frame is decided in
//! `composition`.

use std::collections::HashMap;

use bytes::{Buf, Bytes, BytesMut};
use std::time::Duration;

use super::composition::{self, Composition, Source};
use crate::journal::Record;
use crate::processes::driver::{self, Admission, ConnectionId, Loss, Machine, PeerId};
use crate::protocol::control::{DisplayCommand, DisplayConfiguration, DisplayReport, DisplayTotals};
use crate::protocol::frame::{self, CodecError, Message};
use crate::protocol::hello::Role;
use crate::protocol::image::{ImageReply, TilePixels};
use ground::ids::{Attempt, Producer, RunId, TileId};

/// Tiles received and not composited yet, of all nodes.
const WAITING_MAX: usize = 16;

/// A tile from a node.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Incoming {
    pub tile: TilePixels,
    pub planes: Bytes,
}

/// To a node.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Outgoing(pub ImageReply);

/// What is done with files.
#[derive(Debug)]
pub enum Task {
    /// Begin where the journal ends; what is in it is put together.
    Restore(Box<Composition>, DisplayConfiguration),
    /// To be done before what comes after it.
    Append(Entry),
    /// Write whatever there is.
    Write(Box<Composition>),
}

#[derive(Debug)]
pub enum Answer {
    /// What of the journal was of no use, if anything.
    Restored(Box<Composition>, Option<String>),
    Written(Result<DisplayTotals, String>),
}

/// A record of the journal that owns its planes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Entry {
    Pixels { tile: TileId, attempt: Attempt, producer: Producer, planes: Bytes },
    Condemned(Producer),
}

impl Entry {
    pub fn record(&self) -> Record<'_> {
        match *self {
            Self::Pixels { tile, attempt, producer, ref planes } => Record::Pixels { tile, attempt, producer, planes },
            Self::Condemned(producer) => Record::Condemned(producer),
        }
    }
}

type Event = driver::Event<State>;
type Action = driver::Action<State>;
type End = driver::End<State>;

#[derive(Debug)]
pub struct State {
    run: RunId,
    phase: Phase,
}

#[derive(Debug)]
enum Phase {
    Unconfigured,
    Restoring,
    Serving { composition: Box<Composition>, peers: HashMap<ConnectionId, Source> },
    Writing,
    Over,
}

impl State {
    /// Of a display that is about to be configured.
    pub fn new(run: RunId) -> Self {
        Self { run, phase: Phase::Unconfigured }
    }
}

impl State {
    /// Connections, processes whose tiles are in the frame, and condemned ones.
    pub fn sizes(&self) -> [usize; 3] {
        let Phase::Serving { composition, peers } = &self.phase else { return [0; 3] };
        let [shares, condemned] = composition.sizes();
        [peers.len(), shares, condemned]
    }
}

impl Machine for State {
    type Command = DisplayCommand;
    type Report = DisplayReport;
    type Incoming = Incoming;
    type Outgoing = Outgoing;
    type Task = Task;
    type Answer = Answer;

    const WAITING_MAX: usize = WAITING_MAX;
    const FAILED: fn(String) -> DisplayReport = DisplayReport::Failed;

    fn step(&mut self, _now: Duration, event: Event, actions: &mut Vec<Action>) -> Result<(), End> {
        match (&mut self.phase, event) {
            (Phase::Over, _) => {}
            (_, Event::Failed(why)) => return Err(End::Failed(why)),
            (Phase::Unconfigured, Event::Command(DisplayCommand::Configure(configuration))) => {
                let composition = Composition::new(&configuration, self.run)?;
                self.phase = Phase::Restoring;
                actions.push(Action::Task(Task::Restore(Box::new(composition), configuration)));
            }
            (Phase::Unconfigured, Event::Command(_)) => {
                return Err("the manager sent something else than a configuration".into());
            }
            (Phase::Restoring, Event::Answer(Answer::Restored(composition, dropped))) => {
                actions.extend(dropped.map(|dropped| Action::Report(DisplayReport::Incident(dropped))));
                actions.push(Action::Report(DisplayReport::Restored(composition.holdings())));
                actions.push(Action::Listen(Admission::AnyNode));
                self.phase = Phase::Serving { composition, peers: HashMap::new() };
            }
            (Phase::Serving { .. }, Event::Command(DisplayCommand::Finish)) => {
                let Phase::Serving { composition, peers } = std::mem::replace(&mut self.phase, Phase::Writing) else {
                    return Ok(());
                };
                let mut peers: Vec<_> = peers.into_keys().collect();
                peers.sort_unstable();
                actions.extend(peers.into_iter().map(Action::Close));
                actions.push(Action::Task(Task::Write(composition)));
            }
            (Phase::Serving { composition, peers }, event) => serve(composition, peers, event, actions),
            (Phase::Writing, Event::Answer(Answer::Written(outcome))) => {
                return Err(End::Done(DisplayReport::Finished(outcome?)));
            }
            (Phase::Unconfigured | Phase::Restoring | Phase::Writing, _) => {}
        }
        Ok(())
    }

    fn be_over(&mut self) {
        self.phase = Phase::Over;
    }

    fn next_deadline(&self) -> Option<Duration> {
        None
    }

    fn frame_bytes_max(&self, _peer: Role) -> usize {
        let bulk = match &self.phase {
            Phase::Serving { composition, .. } => composition.tile_bytes_max(),
            _ => 0,
        };
        TilePixels::BYTES_MAX + bulk.min(TilePixels::BULK_BYTES_MAX)
    }
}

fn serve(
    composition: &mut Composition,
    peers: &mut HashMap<ConnectionId, Source>,
    event: Event,
    actions: &mut Vec<Action>,
) {
    let event = match event {
        Event::Listening(address) => return actions.push(Action::Report(DisplayReport::Listening(address))),
        Event::Accepted(id, PeerId { role: Role::Node(node), epoch }) => {
            // A process that dials again has given up its earlier connection.
            let earlier = peers.iter().find(|(_, source)| **source == (node, epoch)).map(|(&earlier, _)| earlier);
            if let Some(earlier) = earlier {
                peers.remove(&earlier);
                actions.push(Action::Close(earlier));
            }
            peers.insert(id, (node, epoch));
            return;
        }
        Event::Received(id, Incoming { tile, planes }) => {
            // The tile of a connection that was closed counts no more.
            let Some(&source) = peers.get(&id) else { return };
            let event = composition::Event::Tile { from: id, source, tile, bytes: &planes };
            return put_together(composition, peers, event, &planes, actions);
        }
        Event::Closed(id, loss) => {
            if peers.remove(&id).is_none() {
                return;
            }
            match loss {
                Some(Loss { why, is_breach: true }) => composition::Event::Refused(why),
                Some(Loss { why, .. }) => return tracing::warn!("{why}"),
                None => return,
            }
        }
        Event::Refused(who) => composition::Event::Refused(who),
        Event::Command(DisplayCommand::Condemn(producer)) => composition::Event::Condemn(producer),
        Event::Command(DisplayCommand::TellHoldings { question }) => composition::Event::TellHoldings { question },
        Event::Command(DisplayCommand::Configure(_)) => {
            composition::Event::Refused("configured twice; the first one counts".to_owned())
        }
        _ => return,
    };
    put_together(composition, peers, event, &Bytes::new(), actions);
}

fn put_together(
    composition: &mut Composition,
    peers: &mut HashMap<ConnectionId, Source>,
    event: composition::Event,
    bytes: &Bytes,
    actions: &mut Vec<Action>,
) {
    for action in composition.handle(event) {
        actions.push(match action {
            composition::Action::Append(Record::Pixels { tile, attempt, producer, .. }) => {
                Action::Task(Task::Append(Entry::Pixels { tile, attempt, producer, planes: bytes.clone() }))
            }
            composition::Action::Append(Record::Condemned(producer)) => {
                Action::Task(Task::Append(Entry::Condemned(producer)))
            }
            composition::Action::Reply(to, reply) => Action::Send(to, Outgoing(reply)),
            composition::Action::Dismiss(id) => {
                peers.remove(&id);
                Action::Close(id)
            }
            composition::Action::Report(report) => Action::Report(report),
        });
    }
}

impl driver::Incoming for Incoming {
    fn decode(_peer: Role, mut frame: BytesMut) -> Result<Self, CodecError> {
        let (tile, planes) = frame::decode::<TilePixels>(&frame)?;
        let message_bytes = frame.len() - planes.len();
        frame.advance(message_bytes);
        Ok(Self { tile, planes: frame.freeze() })
    }
}

impl driver::Outgoing for Outgoing {
    fn frame(&self, head: &mut Vec<u8>) -> Result<[&[u8]; 4], CodecError> {
        frame::encode_head(&self.0, 0, head)?;
        Ok([&[]; 4])
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
