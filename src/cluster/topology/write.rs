//! A [`Topology`] as a file that reads back to it, every key spelt out.

use std::path::Path;

use glam::DVec3;

use super::file::{self, File};
use super::value::{
    Angle, Channel, Clusters, Coordinate, Cutoff, Cycles, CyclesPerWord, Depth, LeafSize, Line, MaxDepth, Nodes,
    ProceduralSize, Quantum, RecordBytes, Seconds, Seed, Side, Size, Threads, Tile, Verify, Version, Ways, Width,
};
use super::{Image, Run, Topology};
use machine::hardware::specification::{Arbiter, Bus, Cluster, Processor};
use trace::database::RecordLayout;
use trace::preparation::{CameraChoices, ViewChoices};
use trace::scene::SceneSource;
use trace::scene::procedural::Board;
use trace::tracer::octree::Octree;

impl Topology {
    /// The resolved topology as TOML. The scene's path becomes absolute, so that the text may be in any folder.
    ///
    /// # Errors
    /// None is known: the file consists of what TOML can hold.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(&File::from(self))
    }

    /// The same as a table, which can be written as JSON: docs/topology.schema.json has its keys.
    ///
    /// # Errors
    /// As of [`Self::to_toml`].
    pub fn to_table(&self) -> Result<toml::Table, toml::ser::Error> {
        toml::Table::try_from(File::from(self))
    }
}

impl From<&Topology> for File {
    fn from(topology: &Topology) -> Self {
        let light =
            |light: &trace::scene::Light| file::Light { position: point(light.position), colour: colour(light.colour) };
        Self {
            topology: file::Header { version: Version(1), name: Some(topology.name.clone()) },
            scene: scene(&topology.scene, &topology.view),
            camera: camera(&topology.view.camera),
            light: topology.view.lights.iter().map(light).collect(),
            image: image(&topology.image),
            octree: octree(topology.octree),
            database: database(topology.records),
            cluster: cluster(&topology.cluster, topology.run.threads),
            host: topology.hosts.iter().map(file::Host::from).collect(),
            run: run(&topology.run),
        }
    }
}

fn scene(source: &SceneSource, view: &ViewChoices) -> file::Scene {
    let mut scene = file::Scene { background: view.background.map(colour), up: view.up, ..file::Scene::default() };
    match source {
        SceneSource::File(path) => scene.file = Some(absolute(path)),
        SceneSource::Procedural(procedural) => {
            scene.procedural = Some(procedural.kind);
            scene.size = Some(ProceduralSize(procedural.size));
            // Few scenes have one.
            scene.board = Some(procedural.board).filter(|board| *board != Board::Squares);
        }
    }
    scene
}

/// As it stands where the working directory is gone.
fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

fn camera(camera: &CameraChoices) -> Option<file::Camera> {
    let angle = camera.angle_degrees.map(Angle);
    let [from, at, up] = [camera.from, camera.at, camera.up].map(|chosen| chosen.map(point));
    (!camera.parts().is_empty()).then_some(file::Camera { from, at, up, angle })
}

fn image(image: &Image) -> file::Image {
    file::Image {
        width: image.width.map(Side),
        height: image.height.map(Side),
        tile: Some(Tile(image.tile.0, image.tile.1)),
        depth: Depth(image.depth),
        cutoff: Cutoff(image.cutoff),
        terminator: image.terminator,
    }
}

fn octree(octree: Octree) -> file::Octree {
    file::Octree {
        leaf_size: LeafSize(octree.leaf_size),
        max_depth: MaxDepth(octree.max_depth),
        mailbox: octree.mailbox,
    }
}

fn database(records: RecordLayout) -> file::Database {
    file::Database {
        records: records.objects(),
        numbers: records.numbers(),
        record_bytes: records.record_bytes().map(RecordBytes),
    }
}

fn cluster(cluster: &Cluster, threads: u16) -> file::Cluster {
    let memory = cluster.local_memory;
    file::Cluster {
        count: Clusters(cluster.count),
        nodes: Nodes(cluster.nodes),
        threads: Threads(threads),
        processor: cluster.processor.into(),
        local_memory: file::LocalMemory {
            size: Size(memory.size),
            line: Line(memory.line),
            ways: memory.ways.map(Ways),
            replacement: memory.replacement,
        },
        bus: cluster.bus.into(),
    }
}

impl From<Processor> for file::Processor {
    fn from(processor: Processor) -> Self {
        Self {
            octree_node: Cycles(processor.octree_node),
            primitive_test: Cycles(processor.primitive_test),
            shading: Cycles(processor.shading),
            local_access: Cycles(processor.local_access),
        }
    }
}

impl From<Bus> for file::Bus {
    fn from(bus: Bus) -> Self {
        let (arbiter, quantum) = match bus.arbiter {
            Arbiter::Fifo => (file::Arbiter::Fifo, None),
            Arbiter::RoundRobin { quantum } => (file::Arbiter::RoundRobin, Some(Quantum(quantum))),
            Arbiter::FixedPriority => (file::Arbiter::FixedPriority, None),
        };
        Self {
            arbiter,
            quantum,
            width: Width(bus.width),
            cycles_per_word: CyclesPerWord(bus.cycles_per_word),
            latency: Cycles(bus.latency),
            transactions: bus.transactions,
        }
    }
}

fn run(run: &Run) -> file::Run {
    file::Run {
        order: run.order,
        assignment: run.assignment,
        seed: Seed(run.seed),
        verify: Verify(run.verify),
        deadlines: file::Deadlines {
            startup_seconds: Seconds(run.deadlines.startup.as_secs_f64()),
            heartbeat_seconds: Seconds(run.deadlines.heartbeat.as_secs_f64()),
            tile_seconds: Seconds(run.deadlines.tile.as_secs_f64()),
            join_seconds: Seconds(run.deadlines.join.as_secs_f64()),
        },
    }
}

fn point(point: DVec3) -> [Coordinate; 3] {
    point.to_array().map(Coordinate)
}

fn colour(colour: DVec3) -> [Channel; 3] {
    colour.to_array().map(Channel)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use super::*;

    fn read_text(text: &str) -> Topology {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("topology.toml");
        fs::write(&path, text).expect("a file");
        Topology::read(&path, &[]).unwrap_or_else(|error| panic!("{error}\n{text}"))
    }

    /// Every key, and none with its default: what a writer forgets is not there when it is read again.
    const UNUSUAL: &str = "\
        topology.name = 'unusual ü'\n\
        scene = { file = '/scenes/a.obj', background = [0.1, 0.2, 1e-9], up = 'z' }\n\
        camera = { from = [1e9, -2.5, 0.1], at = [1, 2, 3], up = [0, 0, 1], angle = 33.3 }\n\
        light = [{ position = [1, 2, 3] }, { position = [4, 5, 6], colour = [0.25, 0, 3] }]\n\
        image = { width = 640, height = 480, tile = [250, 1], depth = 7, cutoff = 0.1, terminator = 'soft' }\n\
        octree = { leaf_size = 3, max_depth = 20, mailbox = false }\n\
        database = { records = 'polygons', numbers = 'f64', record_bytes = 300 }\n\
        cluster.count = 3\n\
        cluster.nodes = 256\n\
        cluster.local_memory = { size = '1.5 KiB', line = 32, ways = 3, replacement = 'random' }\n\
        cluster.processor = { octree_node = 0, primitive_test = 7, shading = 1000000, local_access = 3 }\n\
        cluster.bus = { arbiter = 'round_robin', quantum = 17, width = 64, cycles_per_word = 1024, latency = 0,\n\
            transactions = 'split' }\n\
        run = { order = 'morton', assignment = 'interleaved', seed = 9007199254740991, verify = 0.25, deadlines = {\n\
            startup_seconds = 0.1, heartbeat_seconds = 1.7, tile_seconds = 86399.999999999,\n\
            join_seconds = 61.5 } }\n\
        host = [{ name = 'here', bind = '0.0.0.0', advertise = 'here.example', port = 4242, nodes = 100 },\n\
            { name = 'u@b-2', bind = '10.0.0.2', launch = ['ssh', '{host}', 'exec {program}'], programs = '/opt/marti',\n\
            shared_files = true, clusters = [2, 1], display = true },\n\
            { name = 'cloud', launch = 'external', nodes = 0 }]\n";

    #[test]
    fn every_key_is_written_as_it_was_read() {
        let topology = read_text(UNUSUAL);
        assert_eq!(read_text(&topology.to_toml().expect("is TOML")), topology);
    }

    #[test]
    fn what_few_scenes_have_is_written_where_it_is_chosen() {
        let text = "scene = { procedural = 'teapot', size = 3, board = 'none' }\n";
        let topology = read_text(text);
        let written = topology.to_toml().expect("is TOML");
        assert!(written.contains("board = \"none\"") && !written.contains("[database]"), "{written}");
        assert_eq!(read_text(&written), topology);
    }

    #[test]
    fn the_scenes_path_becomes_absolute() {
        let mut topology = read_text(UNUSUAL);
        topology.scene = SceneSource::File(PathBuf::from("scenes/a.obj"));
        let written = read_text(&topology.to_toml().expect("is TOML"));
        let here = std::env::current_dir().expect("a working directory");
        assert_eq!(written.scene, SceneSource::File(here.join("scenes/a.obj")));
    }

    #[test]
    fn every_shipped_topology_asks_a_question_and_reads_back() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies");
        let paths: Vec<PathBuf> =
            fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
        assert!(paths.len() >= 4, "{paths:?}");
        for path in paths {
            let text = fs::read_to_string(&path).expect("a text");
            let comment: String = text.lines().take_while(|line| line.starts_with('#')).collect();
            assert!(comment.contains('?'), "{} begins without a question", path.display());
            let topology = Topology::read(&path, &[]).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(read_text(&topology.to_toml().expect("is TOML")), topology);
        }
    }
}
