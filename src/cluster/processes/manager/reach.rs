//! Who can dial whom: the manager's own address, and the servers' as their clients get them.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use super::process::Command;
use crate::processes::listening;
use crate::protocol::control::{MasterCommand, NodeCommand};
use crate::topology::Host;
use ground::outlet;

/// Where processes of other machines reach the manager, which listens here.
///
/// # Errors
/// The name that its host is to be known by is not known.
pub(super) async fn advertised(first: &Host, listens: SocketAddr) -> io::Result<SocketAddr> {
    listening::advertised(first.advertise.as_deref(), listens, from_here(listens).ip()).await
}

/// Where processes of this machine reach the manager.
pub(super) fn from_here(listens: SocketAddr) -> SocketAddr {
    let ip = match listens.ip() {
        IpAddr::V4(Ipv4Addr::UNSPECIFIED) => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(Ipv6Addr::UNSPECIFIED) => Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    (ip, listens.port()).into()
}

/// Tells the person who starts the other processes where to.
pub(super) fn say(address: SocketAddr, quiet: bool) {
    tracing::info!("listening at {address} for those who join");
    if !quiet {
        outlet::say(format_args!("listening at {address} for those who join"));
    }
}

/// Says what must not be overlooked.
pub(super) fn warn(what: &str) {
    tracing::warn!("{what}");
    outlet::say(format_args!("warning: {what}"));
}

/// Why the manager cannot dial a server at the address that it reports, when it has dialled from there.
pub(super) fn tells_its_own(origin: IpAddr, address: SocketAddr) -> Option<String> {
    means_itself(address, origin).then(|| {
        format!(
            "it dials from {origin} and says that it is at {address}, which is no address of another machine; expected \
             host.bind or host.advertise with an address that others can reach"
        )
    })
}

/// Whether an address is nobody's but the dialling machine's, reported by or to another machine.
fn means_itself(address: SocketAddr, elsewhere: IpAddr) -> bool {
    (address.ip().is_loopback() || address.ip().is_unspecified()) && !elsewhere.is_loopback()
}

/// Why a process that has dialled from there cannot use an address that it is to get; as the rest of a sentence that
/// begins with its name.
pub(super) fn unreachable(origin: IpAddr, command: &Command) -> Option<String> {
    let (server, address) = servers(command).into_iter().find(|(_, address)| means_itself(*address, origin))?;
    Some(format!(
        "is on another machine, at {origin}, and cannot reach the {server} at {address}, which means that machine \
         itself; expected host.bind or host.advertise with an address that it can reach"
    ))
}

fn servers(command: &Command) -> Vec<(&'static str, SocketAddr)> {
    match command {
        Command::Master(MasterCommand::Configure(master)) => vec![("bus", master.bus)],
        Command::Node(NodeCommand::Configure(node)) => {
            vec![("master", node.master), ("bus", node.bus), ("display", node.display)]
        }
        Command::Node(NodeCommand::Display(display)) => vec![("display", *display)],
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_of_the_dialling_machine_itself_is_refused() {
        let there = IpAddr::from([10, 0, 0, 2]);
        let display = |address: &str| Command::Node(NodeCommand::Display(address.parse().expect("an address")));
        let why = unreachable(there, &display("127.0.0.1:4242")).expect("its own");
        assert!(why.contains("at 10.0.0.2, and cannot reach the display at 127.0.0.1:4242"), "{why}");
        assert!(unreachable(there, &display("[::]:1")).is_some());
        assert_eq!(unreachable(there, &display("10.0.0.1:1")), None);
        assert_eq!(unreachable([127, 0, 0, 1].into(), &display("127.0.0.1:1")), None);
        let told = tells_its_own(there, "127.0.0.1:7".parse().expect("an address")).expect("its own");
        assert!(told.starts_with("it dials from 10.0.0.2 and says that it is at 127.0.0.1:7"), "{told}");
    }

    #[test]
    fn this_machine_reaches_a_wildcard_by_loopback() {
        let from = |address: &str| from_here(address.parse().expect("an address")).to_string();
        assert_eq!(from("0.0.0.0:7"), "127.0.0.1:7");
        assert_eq!(from("10.0.0.1:7"), "10.0.0.1:7");
    }
}
