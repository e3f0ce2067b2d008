//! What every mode needs: the control connection, the configuration, and dialling any process as any other.

use std::net::SocketAddr;
use std::time::Duration;

use cluster::processes::{Child, ControlLink};
use cluster::protocol::connection::{Connection, ConnectionError, Introduction, Receiver, Sender, Socket, connect};
use cluster::protocol::control::{NodeCommand, NodeConfiguration, NodeReport};
use cluster::protocol::frame::Message;
use cluster::protocol::hello::Role;
use ground::ids::Epoch;
use ground::pulse::Pulse;

use super::Outcome;
use super::mode::Mode;

const CONNECT_DEADLINE: Duration = Duration::from_secs(5);

pub(crate) struct Ground {
    pub(crate) mode: Mode,
    pub(crate) introduction: Introduction,
    pub(crate) pulse: Pulse,
    pub(crate) manager: SocketAddr,
    pub(crate) configuration: NodeConfiguration,
    pub(crate) link: ControlLink<NodeCommand, NodeReport>,
}

impl Ground {
    /// `None`: the run was over before it began.
    pub(crate) async fn reach(child: &Child, mode: Mode) -> Outcome<Option<Self>> {
        let mut link = ControlLink::open(child)?;
        let configuration = loop {
            match link.commands.recv().await {
                Some(NodeCommand::Configure(configuration)) => break *configuration,
                Some(NodeCommand::Finish) | None => return Ok(None),
                Some(_) => {}
            }
        };
        let (introduction, pulse, manager) = (child.introduction(), child.pulse.clone(), child.bootstrap.manager);
        Ok(Some(Self { mode, introduction, pulse, manager, configuration, link }))
    }

    /// As itself.
    pub(crate) async fn dial(&self, role: Role) -> Result<Connection, ConnectionError> {
        connect(role, self.address(role), &self.introduction, CONNECT_DEADLINE).await
    }

    /// As another process.
    pub(crate) async fn dial_as(&self, me: Role, epoch: Epoch, role: Role) -> Result<Connection, ConnectionError> {
        let mut introduction = self.introduction.clone();
        (introduction.hello.role, introduction.hello.epoch) = (me, epoch);
        connect(role, self.address(role), &introduction, CONNECT_DEADLINE).await
    }

    pub(crate) async fn talk<Out: Message, In: Message>(&self, role: Role) -> Outcome<(Sender<Out>, Receiver<In>)> {
        Ok(self.dial(role).await?.split())
    }

    /// A socket for bytes of any kind, and blocking.
    pub(crate) async fn raw(&self, role: Role) -> Outcome<Socket<std::net::TcpStream>> {
        let mut socket = self.dial(role).await?.into_std()?;
        socket.inner_mut().set_nonblocking(false)?;
        Ok(socket)
    }

    fn address(&self, role: Role) -> SocketAddr {
        match role {
            Role::Display => self.configuration.display,
            Role::Master(_) => self.configuration.master,
            Role::Bus(_) => self.configuration.bus,
            Role::Manager | Role::Node(_) => self.manager,
        }
    }

    pub(crate) fn master(&self) -> Role {
        Role::Master(self.configuration.cluster)
    }

    pub(crate) fn bus(&self) -> Role {
        Role::Bus(self.configuration.cluster)
    }

    /// Obeys, and does nothing else.
    pub(crate) async fn idle(&mut self) -> Outcome {
        while !matches!(self.link.commands.recv().await, Some(NodeCommand::Finish) | None) {}
        Ok(())
    }

    /// The last words, as of a true node.
    pub(crate) async fn leave(self, outcome: &Outcome) {
        let report = match outcome {
            Ok(()) => NodeReport::Finished,
            Err(error) => NodeReport::Failed(error.to_string()),
        };
        let _ = self.link.reports.send(report).await;
        self.link.close();
    }
}
