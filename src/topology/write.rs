//! A [`Topology`] as a file that reads back to it, every key spelt out.

use std::path::Path;

use glam::DVec3;

use super::file::{self, File};
use super::value::{
    Angle, Channel, Coordinate, Cutoff, Depth, LeafSize, Line, MaxDepth, Nodes, ProceduralSize, Quantum, Seconds, Seed,
    Side, Size, Tile, Version, Ways,
};
use super::{Arbiter, Bus, Cluster, Image, Octree, Run, SceneSource, Topology};

impl Topology {
    /// The resolved topology as TOML. The scene's path becomes absolute, so that the text may stand anywhere.
    ///
    /// # Errors
    /// None is known: the file consists of what TOML can hold.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&File::from(self))
    }
}

impl From<&Topology> for File {
    fn from(topology: &Topology) -> Self {
        let light =
            |light: &crate::scene::Light| file::Light { position: point(light.position), colour: colour(light.colour) };
        let camera = |camera: &crate::scene::Camera| file::Camera {
            from: point(camera.from),
            at: point(camera.at),
            up: point(camera.up),
            angle: Angle(camera.angle_degrees),
        };
        Self {
            topology: file::Header { version: Version(1), name: Some(topology.name.clone()) },
            scene: scene(&topology.scene, topology.background),
            camera: topology.camera.as_ref().map(camera),
            light: topology.lights.iter().map(light).collect(),
            image: image(&topology.image),
            octree: octree(topology.octree),
            cluster: cluster(&topology.cluster),
            run: run(&topology.run),
        }
    }
}

fn scene(source: &SceneSource, background: Option<DVec3>) -> file::Scene {
    let mut scene = file::Scene { background: background.map(colour), ..file::Scene::default() };
    match source {
        SceneSource::File(path) => scene.file = Some(absolute(path)),
        SceneSource::Procedural(procedural) => {
            scene.procedural = Some(procedural.kind);
            scene.size = Some(ProceduralSize(procedural.size));
        }
    }
    scene
}

/// As it stands where the working directory is gone.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

fn image(image: &Image) -> file::Image {
    file::Image {
        width: image.width.map(Side),
        height: image.height.map(Side),
        tile: Some(Tile(image.tile.0, image.tile.1)),
        depth: Depth(image.depth),
        cutoff: Cutoff(image.cutoff),
    }
}

fn octree(octree: Octree) -> file::Octree {
    file::Octree {
        leaf_size: LeafSize(octree.leaf_size),
        max_depth: MaxDepth(octree.max_depth),
        mailbox: octree.mailbox,
    }
}

fn cluster(cluster: &Cluster) -> file::Cluster {
    let memory = cluster.local_memory;
    file::Cluster {
        nodes: Nodes(cluster.nodes),
        local_memory: file::LocalMemory {
            size: Size(memory.size),
            line: Line(memory.line),
            ways: memory.ways.map(Ways),
            replacement: memory.replacement,
        },
        bus: bus(cluster.bus),
    }
}

fn bus(bus: Bus) -> file::Bus {
    match bus.arbiter {
        Arbiter::Fifo => file::Bus { arbiter: file::Arbiter::Fifo, quantum: None },
        Arbiter::RoundRobin { quantum } => {
            file::Bus { arbiter: file::Arbiter::RoundRobin, quantum: Some(Quantum(quantum)) }
        }
        Arbiter::FixedPriority => file::Bus { arbiter: file::Arbiter::FixedPriority, quantum: None },
    }
}

fn run(run: &Run) -> file::Run {
    file::Run {
        order: run.order,
        assignment: run.assignment,
        seed: Seed(run.seed),
        deadlines: file::Deadlines {
            startup_seconds: Seconds(run.deadlines.startup.as_secs_f64()),
            heartbeat_seconds: Seconds(run.deadlines.heartbeat.as_secs_f64()),
            tile_seconds: Seconds(run.deadlines.tile.as_secs_f64()),
        },
    }
}

fn point(point: DVec3) -> [Coordinate; 3] {
    point.to_array().map(Coordinate)
}

fn colour(colour: DVec3) -> [Channel; 3] {
    colour.to_array().map(Channel)
}
