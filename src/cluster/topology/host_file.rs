//! `[[host]]` as written.

use std::fmt;
use std::net::IpAddr;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::host::Launch;
use super::value::{ClusterNumber, HostNodes, Port, inline_schema};

/// A machine that processes run on. The first one is the manager's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Host {
    /// Unique; stands for {host} in the launcher's command.
    pub name: HostName,
    /// IP address at which servers listen; default: 127.0.0.1 on the first host, elsewhere the interface by which a
    /// process reaches the manager.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bind: Option<Interface>,
    /// IP address or name under which others reach the servers; default: where they listen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub advertise: Option<Advertised>,
    /// On the first host: the manager's port, for those who join; 0: any.
    #[serde(default, skip_serializing_if = "Port::is_any")]
    pub port: Port,
    /// "local": the manager starts processes itself; "external": they are started by somebody else and join; else the
    /// command that starts them, with {host} and {program} in it.
    #[serde(default)]
    pub launch: LaunchBy,
    /// Folder of the programs; default: that of the manager's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub programs: Option<String>,
    /// Whether it sees the output folder, at the same path.
    #[serde(default)]
    pub shared_files: bool,
    /// Processing nodes, of all clusters; default: an even share of those that no host claims.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodes: Option<HostNodes>,
    /// Clusters whose bus and master run here; default: on the first host, those that no other claims.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clusters: Vec<ClusterNumber>,
    /// Whether the display runs here; default: on the first host, if no other claims it.
    #[serde(default)]
    pub display: bool,
}

macro_rules! text {
    ($(#[$doc:meta])* $name:ident($type:ty), $expected:expr, $pattern:expr, $parse:expr) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Eq)]
        pub struct $name(pub $type);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                struct Text;

                impl Visitor<'_> for Text {
                    type Value = $name;

                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str($expected)
                    }

                    fn visit_str<E: de::Error>(self, text: &str) -> Result<$name, E> {
                        let parse: fn(&str) -> Option<$type> = $parse;
                        parse(text).map($name).ok_or_else(|| E::invalid_value(Unexpected::Str(text), &self))
                    }
                }

                deserializer.deserialize_any(Text)
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(&self.0)
            }
        }

        inline_schema!($name, |_| json_schema!({ "type": "string", "pattern": $pattern }));
    };
}

/// What DNS allows.
const NAME_BYTES_MAX: usize = 253;

text!(
    /// A name that no shell and no launcher takes for anything else.
    HostName(String),
    "a host's name: 1 to 253 letters, digits and . - _ @ :, beginning with a letter or digit",
    "^[A-Za-z0-9][A-Za-z0-9.@:_-]{0,252}$",
    |text| is_plain(text, b".-_@:").then(|| text.to_owned())
);
text!(
    /// An IP address of the host itself, or the wildcard of all of them.
    Interface(IpAddr),
    "an IP address such as 10.0.0.1, or 0.0.0.0 for all of the host's own",
    r"^[0-9A-Fa-f.:]+$",
    |text| text.parse().ok()
);
text!(
    /// What others dial: an IP address, or a name.
    Advertised(String),
    "an IP address or a host name that others can dial, without a port",
    "^[A-Za-z0-9:][A-Za-z0-9.:_-]{0,252}$",
    |text| match text.parse::<IpAddr>() {
        Ok(address) => (!address.is_unspecified()).then(|| address.to_string()),
        Err(_) => is_plain(text, b".-_").then(|| text.to_owned()),
    }
);

fn is_plain(text: &str, also: &[u8]) -> bool {
    let allowed = |c: u8| c.is_ascii_alphanumeric() || also.contains(&c);
    text.len() <= NAME_BYTES_MAX && text.starts_with(|c: char| c.is_ascii_alphanumeric()) && text.bytes().all(allowed)
}

/// [`Launch`] as a person writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LaunchBy(pub Launch);

impl Default for LaunchBy {
    fn default() -> Self {
        Self(Launch::Local)
    }
}

impl LaunchBy {
    const PARTS_MAX: usize = 64;
    const LOCAL: &str = "local";
    const EXTERNAL: &str = "external";
}

impl<'de> Deserialize<'de> for LaunchBy {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LaunchVisitor).map(Self)
    }
}

struct LaunchVisitor;

impl<'de> Visitor<'de> for LaunchVisitor {
    type Value = Launch;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            r#""local", "external", or a command such as ["ssh", "{{host}}", "{{program}}"] of at most {} parts"#,
            LaunchBy::PARTS_MAX
        )
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Launch, E> {
        match text {
            LaunchBy::LOCAL => Ok(Launch::Local),
            LaunchBy::EXTERNAL => Ok(Launch::External),
            _ => Err(E::invalid_value(Unexpected::Str(text), &self)),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut parts: A) -> Result<Launch, A::Error> {
        let mut template = Vec::new();
        while let Some(part) = parts.next_element::<String>()? {
            template.push(part);
            if template.len() > LaunchBy::PARTS_MAX {
                return Err(de::Error::invalid_length(template.len(), &self));
            }
        }
        Ok(Launch::Command(template))
    }
}

impl Serialize for LaunchBy {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0 {
            Launch::Local => serializer.serialize_str(Self::LOCAL),
            Launch::External => serializer.serialize_str(Self::EXTERNAL),
            Launch::Command(template) => template.serialize(serializer),
        }
    }
}

inline_schema!(LaunchBy, |_| {
    json_schema!({ "oneOf": [
        { "type": "string", "enum": [LaunchBy::LOCAL, LaunchBy::EXTERNAL] },
        { "type": "array", "items": { "type": "string" }, "minItems": 1, "maxItems": LaunchBy::PARTS_MAX },
    ] })
});

impl From<&super::Host> for Host {
    fn from(host: &super::Host) -> Self {
        Self {
            name: HostName(host.name.clone()),
            bind: host.bind.map(Interface),
            advertise: host.advertise.clone().map(Advertised),
            port: Port(host.port),
            launch: LaunchBy(host.launch.clone()),
            programs: host.programs.clone(),
            shared_files: host.shared_files,
            nodes: Some(HostNodes(host.nodes)),
            clusters: host.clusters.iter().copied().map(ClusterNumber).collect(),
            display: host.display,
        }
    }
}
