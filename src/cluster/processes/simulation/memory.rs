//! A bus's memory loop in virtual time: the real state decides who may ask for what, who is served next and with which bytes.

use super::host::{Context, Worker};
use super::network::{Message, Parcel, Timer, Wire};
use crate::processes::bus::control::{Answer, Control, Task};
use crate::processes::bus::memory_loop::LEAVE_DEADLINE;
use crate::processes::bus::state::{Refusal, State, initiator};
use crate::processes::manager::process::ProcessId;
use crate::protocol::frame::{self, PREFIX_BYTES};
use crate::protocol::memory::{MemoryReply, MemoryRequest};
use machine::hardware::totals::{BusTotals, LostAttempt};
use machine::hardware::transaction::Initiator;

#[derive(Default)]
pub(super) struct Memory {
    state: Option<State>,
    clients: Vec<Client>,
    /// Of the log.
    rows: u64,
    /// Once it is to finish.
    lost: Option<Vec<LostAttempt>>,
}

#[derive(Clone, Copy)]
struct Client {
    initiator: Initiator,
    peer: ProcessId,
    wire: Wire,
}

impl Memory {
    pub(super) fn clients(&self) -> usize {
        self.clients.len()
    }

    fn request(&mut self, context: &mut Context, client: Client, frame: &[u8]) -> Vec<Answer> {
        let body = frame.get(PREFIX_BYTES..).unwrap_or_default();
        let (request, bulk) = match frame::decode::<MemoryRequest>(body) {
            Ok(request) => request,
            Err(error) => return self.drop_client(context, client, format!("dropped {}: {error}", client.peer)),
        };
        let now = context.network.now.as_nanos() as u64;
        let Some(state) = &mut self.state else { return Vec::new() };
        if let Err(refusal) = state.request(client.initiator, request, bulk, now) {
            return self.refuse(context, client, &refusal);
        }
        let mut answers = Vec::new();
        while let Some(grant) = self.state.as_mut().and_then(|state| state.grant(now)) {
            let served = self.clients.iter().copied().find(|client| client.initiator == grant.initiator);
            let (Some(state), Some(served)) = (&mut self.state, served) else { break };
            let mut reply = Vec::new();
            match state.serve(grant, &mut reply, || now) {
                Ok(_) => {
                    self.rows += 1;
                    if !reply.is_empty() {
                        context.network.send(context.me, served.wire, Message::Frame(reply));
                    }
                }
                Err(refusal) => answers.extend(self.refuse(context, served, &refusal)),
            }
        }
        answers
    }

    fn refuse(&mut self, context: &mut Context, client: Client, refusal: &Refusal) -> Vec<Answer> {
        if let Ok(frame) = frame::encode(&MemoryReply::Refused(refusal.to_string()), &[]) {
            context.network.send(context.me, client.wire, Message::Frame(frame));
        }
        self.drop_client(context, client, format!("refused {}: {refusal}", client.peer))
    }

    fn drop_client(&mut self, context: &mut Context, client: Client, why: String) -> Vec<Answer> {
        self.remove(context, client.wire);
        vec![Answer::Incident(why)]
    }

    fn remove(&mut self, context: &mut Context, wire: Wire) {
        context.network.close(context.me, wire);
        if let Some(at) = self.clients.iter().position(|client| client.wire == wire) {
            let client = self.clients.remove(at);
            if let Some(state) = &mut self.state {
                state.disconnect(client.initiator);
            }
        }
    }

    /// The end, once it is to finish and all but the loader have left.
    fn finish(&mut self, is_late: bool) -> Vec<Answer> {
        if !is_late && self.clients.iter().any(|client| client.initiator != Initiator::Loader) {
            return Vec::new();
        }
        let (Some(state), Some(lost)) = (&self.state, self.lost.take()) else { return Vec::new() };
        vec![Answer::Ended(Ok(BusTotals { log_rows: self.rows, ..state.totals(&lost) }))]
    }
}

impl Worker<Control> for Memory {
    fn begin(&mut self, context: &mut Context, task: Task) -> Result<Option<Answer>, String> {
        match task {
            Task::Serve(configuration) => self.state = Some(State::new(&configuration, context.id.epoch)),
            Task::Finish { lost } => {
                self.lost = Some(lost);
                context.network.wake(context.me, LEAVE_DEADLINE, Timer::Leave);
                return Ok(self.finish(false).pop());
            }
        }
        Ok(None)
    }

    fn take_over(&mut self, context: &mut Context, wire: Wire, peer: ProcessId) -> Option<Vec<Answer>> {
        let Some(initiator) = initiator(peer.role) else { return Some(Vec::new()) };
        if let Some(before) = self.clients.iter().copied().find(|client| client.initiator == initiator) {
            if before.peer.epoch > peer.epoch {
                context.network.close(context.me, wire);
                return Some(vec![Answer::Incident(format!("{peer} comes after its successor: not admitted"))]);
            }
            self.remove(context, before.wire);
        }
        self.clients.push(Client { initiator, peer, wire });
        Some(Vec::new())
    }

    fn arrived(&mut self, context: &mut Context, wire: Wire, parcel: &Parcel) -> Option<Vec<Answer>> {
        let client = self.clients.iter().copied().find(|client| client.wire == wire)?;
        Some(match parcel {
            Parcel::Message(Message::Frame(frame)) => self.request(context, client, frame),
            Parcel::End => {
                self.remove(context, wire);
                self.finish(false)
            }
            _ => Vec::new(),
        })
    }

    fn timer(&mut self, _desk: &mut Context, timer: Timer) -> Vec<Answer> {
        if timer == Timer::Leave { self.finish(true) } else { Vec::new() }
    }
}
