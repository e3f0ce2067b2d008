//! Slots on external hosts: a process that asks for one waits until one is free.

use std::mem::discriminant;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use crate::processes::manager::process::ProcessId;
use crate::protocol::connection::{Connection, ConnectionError};
use crate::protocol::control::Bootstrap;
use crate::protocol::hello::Role;
use crate::protocol::join::{JoinReply, JoinRequest};

/// For a request to follow the hello.
const REQUEST_DEADLINE: Duration = Duration::from_secs(2);
/// Between two words to somebody who waits.
const WAIT_PERIOD: Duration = Duration::from_secs(2);
/// From getting a slot until dialling anew; then it goes to somebody else.
const TAKE_DEADLINE: Duration = Duration::from_secs(10);
/// For processes that wait for the end.
const FAREWELL_DEADLINE: Duration = Duration::from_millis(300);
/// More than these are turned away, and come again.
const WAITING_MAX: usize = 1024;

/// Cheap to clone; all clones are one.
#[derive(Clone, Debug)]
pub(in crate::processes::manager) struct JoinSlots {
    free: Arc<Mutex<Free>>,
    /// Told with every change of what is free, and whether the run is over.
    over: Arc<watch::Sender<bool>>,
}

#[derive(Debug, Default)]
struct Free {
    slots: Vec<JoinSlot>,
}

#[derive(Debug)]
struct JoinSlot {
    id: ProcessId,
    host: String,
    bootstrap: Bootstrap,
    /// Somebody has it and did not dial yet.
    given_until: Option<Instant>,
}

impl JoinSlots {
    pub(in crate::processes::manager) fn new() -> Self {
        Self { free: Arc::default(), over: Arc::new(watch::Sender::new(false)) }
    }

    /// From now on somebody may take it.
    pub(in crate::processes::manager) fn offer(&self, id: ProcessId, host: &str, bootstrap: Bootstrap) {
        self.lock().slots.push(JoinSlot { id, host: host.to_owned(), bootstrap, given_until: None });
        self.over.send_modify(|_| ());
    }

    /// It is taken, or there is no such slot any more.
    pub(in crate::processes::manager) fn withdraw(&self, id: ProcessId) {
        self.lock().slots.retain(|slot| slot.id != id);
    }

    /// The first free slot for this role, on this host if one is named.
    fn give(&self, role: Role, host: Option<&str>, now: Instant) -> Option<Bootstrap> {
        let mut free = self.lock();
        let fits = |slot: &&mut JoinSlot| {
            discriminant(&slot.id.role) == discriminant(&role)
                && host.is_none_or(|host| host == slot.host)
                && slot.given_until.is_none_or(|until| until < now)
        };
        let slot = free.slots.iter_mut().find(fits)?;
        slot.given_until = Some(now + TAKE_DEADLINE);
        Some(slot.bootstrap.clone())
    }

    /// Talks to somebody who wants a slot, in that role, until it has one, leaves, or the run is over.
    pub(in crate::processes::manager) fn welcome(&self, role: Role, connection: Connection) {
        if self.over.receiver_count() >= WAITING_MAX {
            tracing::warn!("{}: turned away, {WAITING_MAX} wait for a place already", connection.peer());
            return;
        }
        let (slots, changed) = (self.clone(), self.over.subscribe());
        tokio::spawn(async move {
            let peer = Arc::clone(connection.peer());
            match slots.converse(role, connection, changed).await {
                Ok(Some(slot)) => tracing::info!("{peer} gets the place of {slot}"),
                Ok(None) => {}
                Err(error) => tracing::warn!("{error}"),
            }
        });
    }

    async fn converse(
        &self,
        role: Role,
        connection: Connection,
        mut changed: watch::Receiver<bool>,
    ) -> Result<Option<Role>, ConnectionError> {
        let (mut sender, mut receiver) = connection.split::<JoinReply, JoinRequest>();
        let Some(JoinRequest { host }) = receiver.receive_within(REQUEST_DEADLINE).await? else { return Ok(None) };
        loop {
            if *changed.borrow_and_update() {
                sender.send(&JoinReply::Over).await?;
                return Ok(None);
            }
            if let Some(bootstrap) = self.give(role, host.as_deref(), Instant::now()) {
                let slot = bootstrap.role;
                sender.send(&JoinReply::Place(Box::new(bootstrap))).await?;
                return Ok(Some(slot));
            }
            sender.send(&JoinReply::Wait).await?;
            tokio::select! {
                // An error means that there are no slots any more.
                _ = timeout(WAIT_PERIOD, changed.changed()) => {}
                // Whatever it is: nothing more is asked.
                _ = receiver.receive() => return Ok(None),
            }
        }
    }

    /// Tells those who wait that the run is over.
    pub(in crate::processes::manager) async fn close(&self) {
        self.over.send_replace(true);
        // A process that does not hear of it in time finds no manager when it comes again.
        let _ = timeout(FAREWELL_DEADLINE, self.over.closed()).await;
    }

    /// A panic of another thread leaves a list as good as it was.
    fn lock(&self) -> MutexGuard<'_, Free> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::hello::RunToken;
    use ground::ids::{ClusterId, Epoch, NodeId};

    fn slots(roles: &[(Role, &str)]) -> JoinSlots {
        let slots = JoinSlots::new();
        for (role, host) in roles {
            let bootstrap = Bootstrap {
                role: *role,
                epoch: Epoch(0),
                token: RunToken::new([0; 32]),
                manager: ([127, 0, 0, 1], 1).into(),
                identity: None,
                bind: None,
                advertise: None,
                log: None,
                heartbeat_milliseconds: 1,
            };
            slots.offer(ProcessId::first(*role), host, bootstrap);
        }
        slots
    }

    fn node(id: u16) -> Role {
        Role::Node(NodeId(id))
    }

    #[tokio::test]
    async fn places_go_to_who_can_fill_them() {
        let slots = slots(&[(Role::Bus(ClusterId(0)), "a"), (node(3), "a"), (node(4), "b")]);
        let now = Instant::now();
        let given = |role, host, now| slots.give(role, host, now).map(|bootstrap| bootstrap.role);
        assert_eq!(given(Role::Display, None, now), None);
        assert_eq!(given(node(0), Some("b"), now), Some(node(4)));
        assert_eq!(given(node(0), Some("b"), now), None, "given already");
        assert_eq!(given(node(0), None, now), Some(node(3)));
        assert_eq!(given(node(0), None, now), None);
        assert_eq!(given(Role::Bus(ClusterId(7)), None, now), Some(Role::Bus(ClusterId(0))));
        // Who got one and never dialled loses it; who dialled keeps it.
        slots.withdraw(ProcessId::first(node(3)));
        let later = now + TAKE_DEADLINE + Duration::from_millis(1);
        assert_eq!(given(node(0), None, later), Some(node(4)));
        assert_eq!(given(node(0), None, later), None);
    }
}
