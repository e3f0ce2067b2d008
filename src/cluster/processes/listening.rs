//! Under which address a server is known to others.

use std::io;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::time::Duration;

use tokio::time::timeout;

use super::event_queue::aside;
use ground::pulse::Pulse;

/// For a name to be looked up.
const LOOKUP_DEADLINE: Duration = Duration::from_secs(5);

/// The addresses of a name or an address, those of `like`'s family first.
///
/// # Errors
/// The name is not known, or there is no answer within 5 s.
pub(super) async fn look_up(name: &str, port: u16, like: IpAddr) -> io::Result<SocketAddr> {
    if let Ok(address) = name.parse::<IpAddr>() {
        return Ok((address, port).into());
    }
    let asked = name.to_owned();
    // It waits for other machines, and has a deadline of its own: not to be watched.
    let unwatched = Pulse::default();
    let look_up = aside(&unwatched, "look-up", move || (asked.as_str(), port).to_socket_addrs());
    let found = match timeout(LOOKUP_DEADLINE, look_up).await {
        Ok(found) => found.flatten().map_err(|error| io::Error::new(error.kind(), format!("{name}: {error}")))?,
        Err(_) => {
            return Err(io::Error::other(format!("{name}: not looked up within {} s", LOOKUP_DEADLINE.as_secs())));
        }
    };
    let found: Vec<SocketAddr> = found.collect();
    let same_family = found.iter().find(|address| address.is_ipv4() == like.is_ipv4()).or(found.first());
    same_family.copied().ok_or_else(|| io::Error::other(format!("{name} has no address")))
}

/// What others get as the address of a server that listens at an address: what the topology says; else where it listens, or,
/// where that is every interface, the one by which this process `reached` the manager.
///
/// # Errors
/// As [`look_up`]'s.
pub(super) async fn advertised(name: Option<&str>, listens: SocketAddr, reached: IpAddr) -> io::Result<SocketAddr> {
    match name {
        Some(name) => look_up(name, listens.port(), listens.ip()).await,
        None if listens.ip().is_unspecified() => Ok((reached, listens.port()).into()),
        None => Ok(listens),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_server_is_known_by_what_reaches_it() {
        let reached = IpAddr::from([10, 0, 0, 7]);
        let known = async |name, listens: &str| {
            advertised(name, listens.parse().expect("an address"), reached).await.expect("known").to_string()
        };
        assert_eq!(known(None, "127.0.0.1:80").await, "127.0.0.1:80");
        assert_eq!(known(None, "0.0.0.0:80").await, "10.0.0.7:80");
        assert_eq!(known(Some("192.0.2.1"), "0.0.0.0:80").await, "192.0.2.1:80");
        assert_eq!(known(Some("localhost"), "127.0.0.1:80").await, "127.0.0.1:80");
    }

    #[tokio::test]
    async fn a_name_that_nobody_knows_is_named() {
        let error = look_up("nobody.invalid", 80, [127, 0, 0, 1].into()).await.expect_err("not a name");
        assert!(error.to_string().starts_with("nobody.invalid"), "{error}");
    }
}
