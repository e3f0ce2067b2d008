//! `seeds MARTI FOLDER`: what the fuzz targets begin with, made by a `marti` program: `FOLDER/TARGET/NAME`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use cluster::journal::{Journal, Record, Subject};
use ground::ids::{Attempt, Epoch, NodeId, Producer, RunId, TileId};
use trace::database::{Numbers, Objects, RecordLayout, Section};
use trace::picture::{AovSet, Sides, Tiling};
use trace::scene::load;
use trace::tracer::octree::{BuildParameters, build_database_as};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [marti, corpus] = arguments.as_slice() else { return Err("expected MARTI FOLDER".into()) };
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("the crate is in a folder of the project")?;
    let scratch = tempfile::tempdir()?;
    let seeds = Seeds { marti, corpus, project, scratch: scratch.path() };
    seeds.wire()?;
    seeds.texts()?;
    seeds.scenes()?;
    seeds.recordings()?;
    seeds.journal()?;
    seeds.keys()
}

struct Seeds<'a> {
    marti: &'a Path,
    corpus: &'a Path,
    project: &'a Path,
    scratch: &'a Path,
}

impl Seeds<'_> {
    /// Nothing has to be guessed in these but lengths.
    fn wire(&self) -> Result<()> {
        for message in 0..20u8 {
            self.put("messages", &format!("{message}"), &[&[message], &[0; 300]])?;
        }
        self.put("frames", "three", &[&[2, 0, 0, 0, 1, 7, 0, 0, 0, 0, 0, 0, 1, 0, 1]])
    }

    fn texts(&self) -> Result<()> {
        for entry in fs::read_dir(self.project.join("topologies"))? {
            let path = entry?.path();
            let name = path.file_name().ok_or("a file")?.to_string_lossy().into_owned();
            self.put("topology", &name, &[&fs::read(&path)?, b"\0cluster.nodes=3\0cluster.local_memory.size=1/4"])?;
        }
        let hosts = "scene.procedural = 'teapot'\n[cluster]\ncount = 2\nnodes = 2\n[[host]]\nname = 'a'\nbind = '10.0.0.1'\n\
                     port = 4242\nnodes = 1\n[[host]]\nname = 'b'\nbind = '0.0.0.0'\nadvertise = '10.0.0.2'\n\
                     launch = ['ssh', '{host}', '{program}']\nclusters = [1]\n[[host]]\nname = 'c'\nlaunch = 'external'\n";
        self.put("topology", "hosts", &[hosts.as_bytes()])?;
        let chaos =
            "kill node@10%; stop bus@30% for 2s; cut node 3@50% for 5s; corrupt node 2@1.5s; random(3 master); seed=7";
        self.put("chaos", "all", &[chaos.as_bytes()])?;
        let lines = [
            "run t.toml --out o --set cluster.nodes=9 --aov depth,normal --verify --chaos random(3) --listen 1.2.3.4:5",
            "render teapot:12 -o a.png --size 640x480 --threads 2 --depth 0 --cutoff 0.01 --mailbox off --simd avx2",
            "replay o --local-memory 1/32..1/4,all --line 16..256 --ways 1..8,full --replacement lru,optimal --nodes 1..64x2",
            "replay o --replacement clock:0,s3-fifo,optimal --clusters 1,2 --tile-order morton --bus-width 1..64 --arbiter fifo,round_robin:4 --format csv",
            "study sweep t.toml --set a.b=1 --local-memory 1/32..1/4 --nodes 4,9 --timings",
            "keys new k --days 7",
        ];
        for (number, line) in lines.iter().enumerate() {
            self.put("command_line", &number.to_string(), &[line.replace(' ', "\n").as_bytes()])?;
        }
        self.traces()
    }

    /// Of each format, behind its number; 15: it is recognised.
    fn traces(&self) -> Result<()> {
        let din = b"0 7fff\n2 10\n1 20 comment\n4 20\n5 20\n";
        let traces: [(&str, u8, &[u8]); 16] = [
            ("din", 0, din),
            ("din_extended", 0, b"r 7fff 4\nw 10 8\nc 10 4\nv 0 0\nc 0 0\n"),
            ("oracle_general", 1, &[1; 48]),
            ("csv", 2, b"address,bytes\n0x10,4\n32,8\n"),
            ("csv_objects", 2, b"time;op;size;lbn\n1;r;512;100\n2;w;4096;a\n"),
            ("csv_numbers", 2 | 5 << 4, b"a b 1 7\nc \"d\" 1 8\n"),
            ("ids", 3, b"7\n0x7\nseven\n"),
            ("vscsi_1", 4, &[1; 64]),
            ("vscsi_2", 4, &[2; 80]),
            ("lackey", 5, b"==1== x\nI  0401ab70,3\n M 04a17de0,8\n"),
            ("champsim", 6, &[1; 128]),
            ("ramulator", 7, b"LD 0x40\nST 64\n0x40 R\n64 W\n"),
            ("json", 8, b"{\"address\":60,\"bytes\":8}\n"),
            ("recognised", 15, b"0x40 R\n64 W\n"),
            ("gzip", 0, include_bytes!("traces/t.din.gz")),
            ("xz", 0, include_bytes!("traces/t.din.xz")),
        ];
        for (name, format, trace) in traces {
            self.put("imports", name, &[&[format], trace])?;
        }
        self.put("imports", "zstd", &[&[0], include_bytes!("traces/t.din.zst")])
    }

    fn scenes(&self) -> Result<()> {
        for name in ["tetra:1", "balls:1", "slivers:1", "plane:1"] {
            let file = self.scratch.join("scene.nff");
            let (kind, size) = name.split_once(':').ok_or("a kind and a size")?;
            // Not every kind has such a size.
            if !self.marti(&["scene", kind, "--size", size, "-o", &file.to_string_lossy()])? {
                continue;
            }
            self.put("nff", name, &[&fs::read(&file)?])?;
            let parameters = BuildParameters { leaf_size: 4, max_depth: 3 };
            for objects in [Objects::Triangles, Objects::Polygons] {
                let layout = RecordLayout::new(objects, Numbers::F32, None)?;
                let database = build_database_as(&load(&file)?, parameters, layout)?;
                let database = database.database();
                let mut counts = Vec::new();
                for section in Section::ALL {
                    counts.extend(u8::try_from(database.header.layout.span(section).records));
                }
                if counts.len() == Section::COUNT {
                    let seed = format!("{name}-{}", objects.name());
                    self.put("database", &seed, &[&counts, &[3, 0], database.bytes()])?;
                }
            }
        }
        let primitives = fs::read(self.project.join("scenes/primitives.nff"))?;
        self.put("nff", "primitives", &[&primitives])?;
        let house = fs::read_to_string(self.project.join("scenes/house.obj"))?.replace("house.mtl", "m");
        self.put("obj", "house", &[house.as_bytes(), &[0], &fs::read(self.project.join("scenes/house.mtl"))?])
    }

    fn recordings(&self) -> Result<()> {
        let out = self.scratch.join("out");
        let topology = self.project.join("topologies/teapot.toml");
        let (topology, out_text) = (topology.to_string_lossy(), out.to_string_lossy());
        let small = ["scene.procedural=tetra", "scene.size=2", "image.width=16", "image.height=16", "cluster.nodes=1"];
        let mut arguments = vec!["run", &topology, "--record", "references", "--out", &out_text];
        arguments.extend(small.iter().flat_map(|set| ["--set", set]));
        if !self.marti(&arguments)? {
            return Err("marti run failed".into());
        }
        let read = |name: &str| fs::read(out.join("recording").join(name));
        self.put("bus_log", "run", &[&read("bus.json")?, &[0], &read("bus.arrows")?])?;
        let stream = machine::recording::references::file_name(NodeId(0), Epoch(0));
        self.put("references", "run", &[&read("references.json")?, &[0], &read(&stream)?])?;
        self.put("report", "run", &[&fs::read(out.join("report.json"))?])
    }

    /// As the target expects it.
    fn journal(&self) -> Result<()> {
        let aov = AovSet { depth: true, normal: false, primitive: false };
        let tiling = Tiling::new(Sides { width: 5, height: 3, tile_width: 2, tile_height: 2 }).expect("possible");
        let path = self.scratch.join("tiles");
        let subject = Subject { tiling, aov, fingerprint: [7; 32] };
        let (mut journal, _) = Journal::open(&path, &subject, false, |_| ())?;
        let producer = Producer { run: RunId(1), node: NodeId(1), epoch: Epoch(0) };
        for tile in 0..4 {
            let pixels = tiling.rect(TileId(tile)).ok_or("a tile")?.pixel_count();
            let planes = vec![1; pixels * 16];
            journal.append(&Record::Pixels {
                tile: TileId(tile),
                attempt: Attempt(tile),
                producer,
                planes: &planes,
            })?;
        }
        journal.append(&Record::Condemned(producer))?;
        self.put("journal", "five", &[&fs::read(&path)?])
    }

    fn keys(&self) -> Result<()> {
        let folder = self.scratch.join("keys");
        if !self.marti(&["keys", "new", &folder.to_string_lossy()])? {
            return Err("marti keys failed".into());
        }
        self.put("keys", "node", &[&fs::read(folder.join("node.pem"))?])?;
        self.put("keys", "authority", &[&fs::read(folder.join("ca.key"))?])
    }

    fn put(&self, target: &str, name: &str, parts: &[&[u8]]) -> Result<()> {
        let folder = self.corpus.join(target);
        fs::create_dir_all(&folder)?;
        Ok(fs::write(folder.join(name), parts.concat())?)
    }

    fn marti(&self, arguments: &[&str]) -> Result<bool> {
        Ok(Command::new(self.marti).args(arguments).stdout(Stdio::null()).status()?.success())
    }
}
