//! `marti check TOPOLOGY`: what would run, without running it.

use std::fmt::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::options::TextOrJson;
use super::{Failure, json, print, subject};
use cluster::processes::scene_warnings;
use cluster::report::incident;
use cluster::report::{Bounds, Camera};
use cluster::topology::{Host, Launch, Override, Topology};
use machine::hardware::specification::{Arbiter, LocalMemory, MemorySize};
use machine::tile_order::Assignment;
use trace::database::RecordLayout;
use trace::picture::{ImageSettings, Tiling};
use trace::preparation::{ImageDefaults, PreparationError, Prepared};
use trace::scene::SceneSource;
use trace::scene::procedural::Procedural;
use trace::scene::{Scene, Warning};

/// Check a topology and its scene, and print what would run
#[derive(Clone, Debug, Args)]
pub struct CheckArguments {
    /// Topology file (docs/topology.md), or a scene by itself, as for `marti run`
    pub topology: PathBuf,
    /// Set a key of the topology, such as cluster.nodes=9
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<Override>,
    /// Warnings about the scene are errors
    #[arg(long)]
    strict: bool,
    /// How the result is printed; as JSON it is the topology with every key, as in docs/topology.schema.json
    #[arg(long, value_enum, default_value_t = TextOrJson::Text)]
    format: TextOrJson,
}

pub(super) fn check(arguments: &CheckArguments) -> Result<(), Failure> {
    let topology = subject::topology(&arguments.topology, &arguments.set)?;
    let subject = match &topology.scene {
        // It takes its time, and nothing can be wrong with it.
        SceneSource::Procedural(Procedural { kind, size, .. }) if *size > kind.default_size() => {
            Subject::unseen(&topology)
        }
        _ => topology.prepare().map(Subject::from),
    };
    let subject = subject.map_err(|error| match error {
        PreparationError::View(what) => Failure::bad_input(format!("{}: {what}", arguments.topology.display())),
        error => error.into(),
    })?;
    scene_warnings::show(&subject.warnings);
    if arguments.strict && subject.warnings.iter().any(trace::preparation::is_certain) {
        return Err(Failure::of_warnings());
    }
    print(&match arguments.format {
        TextOrJson::Text => summary(&topology, &subject),
        TextOrJson::Json => json(&topology.to_table().map_err(|error| Failure::failed(error.to_string()))?)?,
    })
}

/// What would be rendered.
struct Subject {
    image: ImageSettings,
    /// `None` where the scene was not read.
    scene: Option<Seen>,
    warnings: Vec<Warning>,
}

struct Seen {
    primitives: u64,
    bounds: Option<Bounds>,
    camera: Camera,
}

impl Subject {
    fn unseen(topology: &Topology) -> Result<Self, PreparationError> {
        let image = topology.image_settings(&ImageDefaults::of(&Scene::default())).map_err(PreparationError::View)?;
        Ok(Self { image, scene: None, warnings: Vec::new() })
    }
}

impl From<Prepared> for Subject {
    fn from(prepared: Prepared) -> Self {
        let primitives = prepared.database.database().header.scene_primitives;
        let (bounds, camera) = (prepared.bounds.map(Bounds::new), (&prepared).into());
        let scene = Some(Seen { primitives, bounds, camera });
        Self { image: prepared.view.image, scene, warnings: prepared.warnings }
    }
}

/// One line a subject.
fn summary(topology: &Topology, Subject { image, scene, .. }: &Subject) -> String {
    let mut text = String::new();
    let mut line = |subject: &str, said: fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{subject:<13} {said}");
    };
    line("topology", format_args!("{}", topology.name));
    match scene {
        Some(Seen { primitives, bounds, camera }) => {
            line("scene", format_args!("{}, {primitives} primitives", incident::line(&topology.scene.to_string())));
            if let Some(bounds) = bounds {
                line("bounds", format_args!("{bounds}"));
            }
            line("camera", format_args!("{camera}"));
        }
        None => line("scene", format_args!("{}", incident::line(&topology.scene.to_string()))),
    }
    let (width, height, depth, cutoff) = (image.width(), image.height(), image.depth(), image.cutoff());
    let terminator = image.terminator();
    line("image", format_args!("{width}x{height} pixels, depth {depth}, cutoff {cutoff}, {terminator} terminator"));
    let (tile_width, tile_height) = topology.image.tile;
    // Its settings were made from the same topology, which has checked them.
    let tiles = topology.image.tiling(width, height).map_or(0, Tiling::tile_count);
    let assignment = match topology.run.assignment {
        Assignment::OnDemand => "handed out on demand",
        Assignment::Interleaved => "interleaved over the nodes",
    };
    line(
        "tiles",
        format_args!("{tiles} of {tile_width}x{tile_height} pixels in {} order, {assignment}", topology.run.order),
    );
    let octree = topology.octree;
    let mailbox = if octree.mailbox { "with" } else { "without" };
    line(
        "octree",
        format_args!("leaves of {} primitives, depth {}, {mailbox} mailbox", octree.leaf_size, octree.max_depth),
    );
    if topology.records != RecordLayout::DEFAULT {
        line("database", format_args!("{}", topology.records));
    }
    let nodes = topology.cluster.nodes;
    line("processes", format_args!("{}: manager, bus, master, display and {nodes} nodes", 4 + u32::from(nodes)));
    line("local memory", format_args!("{}", local_memory(&topology.cluster.local_memory)));
    line("bus", format_args!("{}", arbiter(topology.cluster.bus.arbiter)));
    for host in &topology.hosts {
        line("host", format_args!("{}", described(host, topology)));
    }
    let idle = topology.without_effect_live();
    if !idle.is_empty() {
        line("no effect live", format_args!("{}", idle.join(", ")));
    }
    let deadlines = topology.run.deadlines;
    let [startup, heartbeat, tile] =
        [deadlines.startup, deadlines.heartbeat, deadlines.tile].map(|deadline: Duration| deadline.as_secs_f64());
    line("deadlines", format_args!("start-up {startup} s, heartbeat {heartbeat} s, tile {tile} s"));
    text
}

fn described(host: &Host, topology: &Topology) -> String {
    let placement = topology.placement();
    let holds = |holder: &Host| holder.name == host.name;
    let mut held = Vec::new();
    if holds(placement.of_manager()) {
        held.push("manager".to_owned());
    }
    if holds(placement.of_display()) {
        held.push("display".to_owned());
    }
    let servers = topology.cluster.ids().filter(|cluster| holds(placement.of_cluster(*cluster)));
    held.extend(servers.map(|cluster| format!("bus and master of {cluster}")));
    if host.nodes > 0 {
        held.push(format!("{} nodes", host.nodes));
    }
    let launch = match &host.launch {
        Launch::Local => "started here".to_owned(),
        Launch::External => "which join".to_owned(),
        Launch::Command(_) => format!("started by {}", host.command("PROGRAM").unwrap_or_default().join(" ")),
    };
    format!("{}: {}, {launch}", host.name, held.join(", "))
}

fn local_memory(memory: &LocalMemory) -> String {
    let size = match memory.size {
        MemorySize::All => return "the whole database".to_owned(),
        MemorySize::Share { .. } => format!("{} of the database", memory.size),
        MemorySize::Bytes(_) => memory.size.to_string(),
    };
    let ways = memory.ways.map_or_else(|| "fully associative".to_owned(), |ways| format!("{ways} ways"));
    format!("{size}, lines of {} bytes, {ways}, {}", memory.line, memory.replacement)
}

fn arbiter(arbiter: Arbiter) -> String {
    match arbiter {
        Arbiter::Fifo => "first come, first served".to_owned(),
        Arbiter::RoundRobin { quantum } => format!("round robin, {quantum} transactions a turn"),
        Arbiter::FixedPriority => "the lowest node first".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn summary_of(name: &str, overrides: &[&str]) -> String {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies").join(name);
        let overrides: Vec<Override> = overrides.iter().map(|text| text.parse().expect("an override")).collect();
        let topology = Topology::read(&path, &overrides).unwrap_or_else(|error| panic!("{error}"));
        summary(&topology, &topology.prepare().expect("a procedural scene, and the tile fits").into())
    }

    #[test]
    fn a_check_says_what_would_run() {
        assert_eq!(
            summary_of("paper-teapot-9.toml", &[]),
            "topology      paper-teapot-9\n\
             scene         teapot:12, 9264 primitives\n\
             bounds        (-4, -4, 0) to (4, 4, 3.15)\n\
             camera        from (4.86, 7.2, 5.4) at (0, 0, 0), up (0, 0, 1), angle 45; the scene's\n\
             image         250x250 pixels, depth 4, cutoff 0, hard terminator\n\
             tiles         2500 of 5x5 pixels in scanline order, interleaved over the nodes\n\
             octree        leaves of 12 primitives, depth 10, with mailbox\n\
             processes     13: manager, bus, master, display and 9 nodes\n\
             local memory  1/32 of the database, lines of 64 bytes, fully associative, lru\n\
             bus           first come, first served\n\
             deadlines     start-up 10 s, heartbeat 5 s, tile 600 s\n"
        );
    }

    #[test]
    fn a_check_says_who_runs_where() {
        let hosts = "host=[{ name = 'here', nodes = 1 }, { name = 'there', bind = '127.0.0.2', launch = ['ssh', '{host}', \
                     '{program}'], clusters = [0] }, { name = 'cloud', launch = 'external', nodes = 5 }]";
        let text = summary_of("teapot.toml", &["cluster.nodes=8", hosts]);
        let hosts = "host          here: manager, display, 1 nodes, started here\n\
                     host          there: bus and master of cluster 0, 2 nodes, started by ssh there PROGRAM\n\
                     host          cloud: 5 nodes, which join\n";
        assert!(text.contains(hosts), "{text}");
    }

    #[test]
    fn a_check_is_of_the_overridden_topology() {
        let text =
            summary_of("teapot.toml", &["cluster.nodes=2", "cluster.local_memory={ size = \"64 KiB\", ways = 4 }"]);
        assert!(text.contains("6: manager, bus, master, display and 2 nodes"), "{text}");
        assert!(text.contains("64 KiB, lines of 64 bytes, 4 ways, lru"), "{text}");
    }
}
