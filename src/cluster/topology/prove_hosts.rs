//! Hosts as written to hosts that a run can be placed on.

use super::document::Document;
use super::file::File;
use super::host::{Host, Launch, is_loopback};
use super::placement::Placement;
use super::{Cluster, host_file};
use ground::ids::{ClusterId, NodeId};
use trace::scene::SourceError;

type Result<T> = std::result::Result<T, SourceError>;

const HOSTS_MAX: usize = 256;

/// # Errors
/// The first host that cannot be, alone or with the others.
pub(super) fn prove(written: &File, cluster: &Cluster, document: &Document<'_>) -> Result<Vec<Host>> {
    if written.host.len() > HOSTS_MAX {
        let what = format!("{} hosts are given, expected at most {HOSTS_MAX}", written.host.len());
        return Err(document.error(&["host"], what));
    }
    let nodes = nodes(&written.host, cluster, document)?;
    let hosts: Vec<Host> = written.host.iter().zip(nodes).map(|(host, nodes)| proven(host, nodes)).collect();
    for (at, host) in hosts.iter().enumerate() {
        let (earlier, refuse) = (&hosts[..at], Refusal { at, document });
        alone(at, host, cluster, &refuse)?;
        beside(host, earlier, &refuse)?;
    }
    let wildcard = |first: &Host| first.bind.is_some_and(|bind| bind.is_unspecified()) && first.advertise.is_none();
    if hosts.len() > 1 && wildcard(&hosts[0]) {
        let what = "is a wildcard, expected host.advertise with it: other hosts must know whom to dial";
        return Err(Refusal { at: 0, document }.of("bind", what));
    }
    reachable(&hosts, cluster, document)?;
    Ok(hosts)
}

fn proven(written: &host_file::Host, nodes: u16) -> Host {
    Host {
        name: written.name.0.clone(),
        bind: written.bind.as_ref().map(|bind| bind.0),
        advertise: written.advertise.as_ref().map(|name| name.0.clone()),
        port: written.port.0,
        launch: written.launch.0.clone(),
        programs: written.programs.clone(),
        shared_files: written.shared_files,
        nodes,
        clusters: written.clusters.iter().map(|cluster| cluster.0).collect(),
        display: written.display,
    }
}

/// Says what is wrong with a host.
struct Refusal<'a> {
    at: usize,
    document: &'a Document<'a>,
}

impl Refusal<'_> {
    fn of(&self, key: &str, what: impl std::fmt::Display) -> SourceError {
        let place = format!("host.{}", self.at);
        let keys = [format!("{place}.{key}"), place];
        self.document.error(&[&keys[0], &keys[1]], format!("host[{}].{key} {what}", self.at))
    }
}

/// How many nodes each holds: what no host claims is spread over those that claim no number.
fn nodes(written: &[host_file::Host], cluster: &Cluster, document: &Document<'_>) -> Result<Vec<u16>> {
    let all = u32::from(cluster.all_nodes());
    let claimed: u32 = written.iter().filter_map(|host| host.nodes).map(|nodes| u32::from(nodes.0)).sum();
    let open = written.iter().filter(|host| host.nodes.is_none()).count() as u32;
    if claimed > all || (claimed < all && open == 0 && !written.is_empty()) {
        let what = format!(
            "the hosts take {claimed} of {all} nodes, expected {all}, or a host without host.nodes that takes the rest"
        );
        let keys: Vec<_> = (0..written.len()).rev().map(|at| format!("host.{at}.nodes")).collect();
        return Err(document.error(&keys.iter().map(String::as_str).collect::<Vec<_>>(), what));
    }
    let rest = all - claimed;
    let mut shares = (0..open).map(|at| rest / open + u32::from(at < rest % open));
    let nodes = written.iter().map(|host| match host.nodes {
        Some(nodes) => nodes.0,
        // At most all nodes, which are a u16.
        None => shares.next().unwrap_or_default() as u16,
    });
    Ok(nodes.collect())
}

fn alone(at: usize, host: &Host, cluster: &Cluster, refuse: &Refusal<'_>) -> Result<()> {
    if at == 0 && host.launch != Launch::Local {
        return Err(refuse.of("launch", "is not \"local\", expected it: the first host is the manager's own"));
    }
    if at > 0 && host.port != 0 {
        return Err(refuse.of("port", "has no meaning here, expected it on the first host, the manager's own"));
    }
    if let Launch::Command(template) = &host.launch {
        template_is_sane(template).map_err(|what| refuse.of("launch", what))?;
    }
    if host.programs.as_ref().is_some_and(|folder| folder.is_empty() || folder.contains('\0')) {
        return Err(refuse.of("programs", "is no folder, expected the path of one"));
    }
    if let Some(number) = host.clusters.iter().find(|&&number| number >= cluster.count) {
        return Err(refuse.of("clusters", format!("names {number}, expected numbers below {}", cluster.count)));
    }
    if host.display && !host.shares_files() {
        let what = "is true on another machine, expected host.shared_files = true with it: \
                    image and journal belong into the output folder";
        return Err(refuse.of("display", what));
    }
    Ok(())
}

fn beside(host: &Host, earlier: &[Host], refuse: &Refusal<'_>) -> Result<()> {
    if earlier.iter().any(|other| other.name == host.name) {
        return Err(refuse.of("name", format!("is {:?} once more, expected another name", host.name)));
    }
    if host.display && earlier.iter().any(|other| other.display) {
        return Err(refuse.of("display", "is true once more, expected one display"));
    }
    let twice = |number: &u16| earlier.iter().any(|other| other.clusters.contains(number));
    match host.clusters.iter().find(|number| twice(number)) {
        Some(number) => Err(refuse.of("clusters", format!("names {number} once more, expected one host for it"))),
        None => Ok(()),
    }
}

/// A command that names its program and holds nothing that looks like a placeholder and is none.
fn template_is_sane(template: &[String]) -> std::result::Result<(), String> {
    if template.first().is_none_or(String::is_empty) || template.iter().any(|part| part.contains('\0')) {
        return Err("is no command, expected one such as [\"ssh\", \"{host}\", \"{program}\"]".to_owned());
    }
    for part in template {
        for (start, _) in part.match_indices('{') {
            let rest = &part[start..];
            let name = &rest[..rest.find('}').map_or(rest.len(), |end| end + 1)];
            let looks_like_one = name.len() > 2
                && name.ends_with('}')
                && name[1..name.len() - 1].chars().all(|c| c.is_ascii_lowercase() || c == '_')
                && !part[..start].ends_with('$');
            if looks_like_one && name != Launch::HOST && name != Launch::PROGRAM {
                return Err(format!("has {name}, expected {} and {} alone", Launch::HOST, Launch::PROGRAM));
            }
        }
    }
    if !template.iter().any(|part| part.contains(Launch::PROGRAM)) {
        return Err(format!("starts no program of marti, expected {} in it", Launch::PROGRAM));
    }
    Ok(())
}

/// A server whose address means another machine to its clients is refused here, where the file says so; else the
/// manager refuses it when it reports that address.
fn reachable(hosts: &[Host], cluster: &Cluster, document: &Document<'_>) -> Result<()> {
    if hosts.is_empty() {
        return Ok(());
    }
    let placement = Placement::new(hosts, cluster);
    let node = |id: u16| placement.of_node(NodeId(id));
    for host in hosts {
        check("the manager", placement.of_manager(), host, hosts, document)?;
    }
    for number in cluster.ids() {
        let server = placement.of_cluster(number);
        check(&format!("the bus of {number}"), server, placement.of_manager(), hosts, document)?;
        let ClusterId(at) = number;
        for id in (at * cluster.nodes)..((at + 1) * cluster.nodes) {
            check(&format!("the bus of {number}"), server, node(id), hosts, document)?;
        }
    }
    for id in 0..cluster.all_nodes() {
        check("the display", placement.of_display(), node(id), hosts, document)?;
    }
    Ok(())
}

fn check(what: &str, server: &Host, client: &Host, hosts: &[Host], document: &Document<'_>) -> Result<()> {
    let apart = server.name != client.name && (server.is_elsewhere() || client.is_elsewhere());
    let Some(address) = server.advertised().filter(|address| apart && is_loopback(address)) else {
        return Ok(());
    };
    let at = hosts.iter().position(|host| host.name == server.name).unwrap_or_default();
    let (name, client) = (&server.name, &client.name);
    let place = [format!("host.{at}.advertise"), format!("host.{at}.bind"), format!("host.{at}")];
    let what = format!(
        "host[{at}]: {what} on {name} would be known as {address}, which means {client} itself to {client}, expected \
         host.bind or host.advertise with an address that {client} can reach"
    );
    Err(document.error(&place.each_ref().map(String::as_str), what))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::Topology;
    use trace::scene::source::Source;

    /// Eight nodes in two clusters.
    fn read(hosts: &str) -> Result<Topology> {
        let text = format!("scene.procedural = 'gears'\ncluster = {{ count = 2, nodes = 4 }}\n{hosts}");
        Topology::from_source(&Source::from_bytes("t.toml", text.as_bytes()), &[])
    }

    fn counts(hosts: &str) -> Vec<u16> {
        read(hosts).unwrap_or_else(|error| panic!("{error}")).hosts.iter().map(|host| host.nodes).collect()
    }

    #[test]
    fn nodes_are_spread() {
        assert!(counts("").is_empty());
        assert_eq!(counts("host = [{ name = 'a' }]"), [8]);
        assert_eq!(counts("host = [{ name = 'a', nodes = 1 }, { name = 'b' }, { name = 'c' }]"), [1, 4, 3]);
        assert_eq!(counts("host = [{ name = 'a', nodes = 0 }, { name = 'b', nodes = 8 }, { name = 'c' }]"), [0, 8, 0]);
    }

    #[test]
    fn what_no_host_claims_is_the_first_ones() {
        let text = "host = [{ name = 'a', nodes = 3 }, { name = 'b', clusters = [1] }, { name = 'c', display = true }]";
        let placement = read(text).unwrap_or_else(|error| panic!("{error}")).placement();
        assert_eq!((0..8).map(|id| placement.of_node(NodeId(id)).name.as_str()).collect::<String>(), "aaabbbcc");
        assert_eq!([0, 1].map(|id| placement.of_cluster(ClusterId(id)).name.as_str()), ["a", "b"]);
        assert_eq!((placement.of_manager().name.as_str(), placement.of_display().name.as_str()), ("a", "c"));
        assert!(!placement.has_joiners() && placement.nodes_without_files().is_none());
        assert_eq!(placement.open_address(), None);
        let alone = read("").unwrap_or_else(|error| panic!("{error}")).placement();
        assert_eq!(alone.of_node(NodeId(7)), alone.of_manager());
        assert_eq!(alone.open_address(), None);
    }

    #[test]
    fn an_address_that_others_can_reach_is_open() {
        let open = |host: &str| {
            let text = format!("host = [{{ name = 'a', {host} }}]");
            read(&text).unwrap_or_else(|error| panic!("{error}")).placement().open_address()
        };
        assert_eq!(open("bind = '10.0.0.1'").as_deref(), Some("10.0.0.1"));
        assert_eq!(open("bind = '0.0.0.0'").as_deref(), Some("0.0.0.0"));
        assert_eq!(open("advertise = 'there.example'").as_deref(), Some("there.example"));
        for own in ["bind = '127.0.0.7'", "advertise = 'localhost'", "bind = '::1'"] {
            assert_eq!(open(own), None, "{own}");
        }
    }

    #[test]
    fn a_command_is_filled_in() {
        let text = "host = [{ name = 'a', bind = '10.0.0.1' }, { name = 'me@b', launch = ['ssh', '{host}', 'exec {program}'] }]";
        let topology = read(text).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(topology.hosts[0].command("/x/marti-node"), None);
        let command = topology.hosts[1].command("/x/marti-node").expect("a command");
        assert_eq!(command, ["ssh", "me@b", "exec /x/marti-node"]);
    }

    #[test]
    fn hosts_that_cannot_be_are_refused_at_their_place() {
        let refused = |hosts: &str| read(hosts).expect_err(hosts).to_string();
        let ssh = "launch = ['ssh', '{host}', '{program}']";
        let table = [
            ("host = 'a'".to_owned(), "3:8: host is 'a', expected an array of tables"),
            ("host = [{ nodes = 1 }]".to_owned(), "3:9: host[0].name is missing, expected a value"),
            (
                "host = [{ name = '-oProxyCommand' }]".to_owned(),
                "3:18: host[0].name is '-oProxyCommand', expected a host's name: 1 to 253 letters, digits and . - _ @ :, beginning with a letter or digit",
            ),
            (
                "host = [{ name = 'a', bind = 'a' }]".to_owned(),
                "3:30: host[0].bind is 'a', expected an IP address such as 10.0.0.1, or 0.0.0.0 for all of the host's own",
            ),
            (
                "host = [{ name = 'a', advertise = 'a:80' }]".to_owned(),
                "3:35: host[0].advertise is 'a:80', expected an IP address or a host name that others can dial, without a port",
            ),
            (
                "host = [{ name = 'a', advertise = '0.0.0.0' }]".to_owned(),
                "3:35: host[0].advertise is '0.0.0.0', expected an IP address or a host name that others can dial, without a port",
            ),
            (
                "host = [{ name = 'a', launch = 'ssh' }]".to_owned(),
                "3:32: host[0].launch is 'ssh', expected \"local\", \"external\", or a command such as [\"ssh\", \"{host}\", \"{program}\"] of at most 64 parts",
            ),
            (
                "host = [{ name = 'a', launch = 'external' }]".to_owned(),
                "3:32: host[0].launch is not \"local\", expected it: the first host is the manager's own",
            ),
            (
                "host = [{ name = 'a' }, { name = 'b', launch = ['ssh', '{host}'] }]".to_owned(),
                "3:48: host[1].launch starts no program of marti, expected {program} in it",
            ),
            (
                "host = [{ name = 'a' }, { name = 'b', launch = ['ssh', '{hots}', '{program}'] }]".to_owned(),
                "3:48: host[1].launch has {hots}, expected {host} and {program} alone",
            ),
            (
                "host = [{ name = 'a' }, { name = 'b', launch = [] }]".to_owned(),
                "3:48: host[1].launch is no command, expected one such as [\"ssh\", \"{host}\", \"{program}\"]",
            ),
            (
                "host = [{ name = 'a' }, { name = 'a' }]".to_owned(),
                "3:34: host[1].name is \"a\" once more, expected another name",
            ),
            (
                "host = [{ name = 'a' }, { name = 'b', port = 80 }]".to_owned(),
                "3:46: host[1].port has no meaning here, expected it on the first host, the manager's own",
            ),
            (
                "host = [{ name = 'a', nodes = 3 }, { name = 'b', nodes = 4 }]".to_owned(),
                "3:58: the hosts take 7 of 8 nodes, expected 8, or a host without host.nodes that takes the rest",
            ),
            (
                "host = [{ name = 'a', nodes = 9 }, { name = 'b' }]".to_owned(),
                "3:31: the hosts take 9 of 8 nodes, expected 8, or a host without host.nodes that takes the rest",
            ),
            (
                "host = [{ name = 'a', clusters = [2] }]".to_owned(),
                "3:34: host[0].clusters names 2, expected numbers below 2",
            ),
            (
                "host = [{ name = 'a', clusters = [1] }, { name = 'b', clusters = [0, 1] }]".to_owned(),
                "3:66: host[1].clusters names 1 once more, expected one host for it",
            ),
            (
                "host = [{ name = 'a', display = true }, { name = 'b', display = true }]".to_owned(),
                "3:65: host[1].display is true once more, expected one display",
            ),
            (
                format!("host = [{{ name = 'a', bind = '10.0.0.1' }}, {{ name = 'b', display = true, {ssh} }}]"),
                "3:68: host[1].display is true on another machine, expected host.shared_files = true with it: image and journal belong into the output folder",
            ),
            (
                "host = [{ name = 'a', bind = '0.0.0.0' }, { name = 'b', launch = 'external' }]".to_owned(),
                "3:30: host[0].bind is a wildcard, expected host.advertise with it: other hosts must know whom to dial",
            ),
            (
                format!("host = [{{ name = 'a' }}, {{ name = 'b', {ssh} }}]"),
                "3:9: host[0]: the manager on a would be known as 127.0.0.1, which means b itself to b, expected host.bind or host.advertise with an address that b can reach",
            ),
            (
                format!(
                    "host = [{{ name = 'a', bind = '10.0.0.1', advertise = 'localhost' }}, {{ name = 'b', {ssh} }}]"
                ),
                "3:54: host[0]: the manager on a would be known as localhost, which means b itself to b, expected host.bind or host.advertise with an address that b can reach",
            ),
            (
                format!(
                    "host = [{{ name = 'a', bind = '10.0.0.1' }}, {{ name = 'b', clusters = [1], advertise = '127.0.0.1', {ssh} }}]"
                ),
                "3:86: host[1]: the bus of cluster 1 on b would be known as 127.0.0.1, which means a itself to a, expected host.bind or host.advertise with an address that a can reach",
            ),
        ];
        for (hosts, reason) in table {
            assert_eq!(refused(&hosts), format!("t.toml:{reason}"), "{hosts}");
        }
        assert!(read(&format!("host = [{{ name = 'a' }}, {{ name = 'b', bind = '127.0.0.2', {ssh} }}]")).is_ok());
    }
}
