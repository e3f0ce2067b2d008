//! From a file's bytes to a [`Topology`].

use std::path::Path;

use super::document::Document;
use super::file::{File, Preamble};
use super::prove::prove;
use super::{Override, Topology};
use trace::scene::SourceError;
use trace::scene::source::Source;

/// Longer files are no topologies.
const FILE_BYTES_MAX: u64 = 1 << 20;

impl Topology {
    /// Reads a topology file with the overrides in place of its own values.
    ///
    /// # Errors
    /// What is wrong and what was expected, at its place in the file, or with the override that it is about.
    pub fn read(path: &Path, overrides: &[Override]) -> Result<Self, SourceError> {
        Self::from_source(&Source::read(path, FILE_BYTES_MAX)?, overrides)
    }

    /// [`Self::read`] of bytes that are there already.
    ///
    /// # Errors
    /// As of `read`.
    pub(crate) fn from_source(source: &Source, overrides: &[Override]) -> Result<Self, SourceError> {
        let document = Document::parse(source, overrides)?;
        document.read::<Preamble>()?;
        let written: File = document.read()?;
        prove(&source.file, &written, &document)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;
    use crate::topology::{Deadlines, Image, Run};
    use machine::hardware::specification::{
        Arbiter, Bus, Cluster, LocalMemory, MemorySize, Processor, Replacement, Transactions,
    };
    use machine::tile_order::{Assignment, TileOrder};
    use trace::database::RecordLayout;
    use trace::preparation::ViewChoices;
    use trace::scene::SceneSource;
    use trace::tracer::octree::Octree;

    fn read(text: &[u8]) -> Result<Topology, SourceError> {
        Topology::from_source(&Source::from_bytes("t.toml", text), &[])
    }

    fn assert_refused(text: &str, place_and_reason: &str) {
        let error = read(text.as_bytes()).expect_err(text);
        assert_eq!(error.to_string(), format!("t.toml:{place_and_reason}"), "{text}");
    }

    #[test]
    fn bad_files_are_refused_at_their_place() {
        let table = [
            ("", " no scene is given, expected scene.file or scene.procedural"),
            ("[scene]", "1:1: no scene is given, expected scene.file or scene.procedural"),
            ("scene = 'teapot'", "1:9: scene is 'teapot', expected a table"),
            ("scene", "1:6: key with no value, expected `=`"),
            ("[scene", "1:7: unclosed table, expected `]`"),
            ("[scene]\nprocedural = 'teapot'\nprocedural = 'gears'", "3:1: duplicate key, expected valid TOML"),
            (
                "[scnee]",
                "1:2: unknown key scnee, expected one of topology, scene, camera, light, image, octree, database, cluster, host, run; did you mean scene?",
            ),
            (
                "[scene]\nprocedural = 'teapots'",
                "2:14: scene.procedural is 'teapots', expected one of gears, teapot, balls, tetra, slivers, plane, decades, giant, corner; did you mean teapot?",
            ),
            ("[scene]\nprocedural = ['teapot']", "2:14: scene.procedural is ['teapot'], expected a string"),
            (
                "[scene]\nprocedural = 'teapot'\nfile = 'a.nff'",
                "2:14: both scene.file and scene.procedural are given, expected one of them",
            ),
            (
                "[scene]\nfile = 'a.nff'\nsize = 3",
                "3:8: scene.size has no meaning for a file, expected it with scene.procedural only",
            ),
            ("[scene]\nprocedural = 'teapot'\nsize = 0", "3:8: scene.size is 0, expected an integer from 1 to 1000"),
            (
                "[scene]\nprocedural = 'balls'\nsize = 8",
                "3:8: scene.size: balls of size 8: not made, it would be 48427563 triangles or spheres, expected a size from 1 to 7",
            ),
            (
                "[scene]\nfile = 'a.nff'\nboard = 'none'",
                "3:9: scene.board has no meaning for a file, expected it with scene.procedural = \"teapot\" only",
            ),
            (
                "[scene]\nprocedural = 'gears'\nboard = 'squares'",
                "3:9: scene.board: gears has no board, expected teapot",
            ),
            (
                "[scene]\nprocedural = 'teapot'\nboard = 'square'",
                "3:9: scene.board is 'square', expected one of squares, none; did you mean squares?",
            ),
            ("[scene]\nfile = ''", "2:8: scene.file is empty, expected the path of an .nff or .obj file"),
            ("[scene]\nfile = 12", "2:8: scene.file is 12, expected a string"),
            ("image = [512, 512]\nscene.procedural = 'gears'", "1:9: image is [512, 512], expected a table"),
            ("light = [[[1, 1, 1]]]\nscene.procedural = 'gears'", "1:10: light[0] is [[1, 1, 1]], expected a table"),
            ("topology.version = 2\nfuture = 1", "1:20: topology.version is 2, expected 1"),
            ("topology.version = 'one'", "1:20: topology.version is 'one', expected 1"),
            (
                "topology.name = '../x'\nscene.procedural = 'gears'",
                "1:17: topology.name is \"../x\", expected the name of a folder: 1 to 255 bytes, no slashes, not . or ..",
            ),
            (
                "topology.name = ''\nscene.procedural = 'gears'",
                "1:17: topology.name is \"\", expected the name of a folder: 1 to 255 bytes, no slashes, not . or ..",
            ),
            (
                "\"\\u001b[2J\" = 1",
                "1:1: unknown key �[2J, expected one of topology, scene, camera, light, image, octree, database, cluster, host, run",
            ),
            ("scene.procedural = 'gears' é", "1:28: unexpected key or value, expected newline, `#`"),
        ];
        for (text, reason) in table {
            assert_refused(text, reason);
        }
    }

    #[test]
    fn bad_values_are_refused_at_their_place() {
        let table = [
            ("scene.size = 3", "2:14: scene.size has no meaning for a file, expected it with scene.procedural only"),
            (
                "scene.background = [0.1, nan, 0]",
                "2:26: scene.background[1] is nan, expected a number from 0 to 1000000",
            ),
            ("scene.background = [0.1, 0]", "2:20: scene.background is [0.1, 0], expected three numbers"),
            ("scene.background = 'black'", "2:20: scene.background is 'black', expected three numbers"),
            ("[camera]", "2:1: camera is empty, expected at least one of from, at, up, angle"),
            ("scene.up = 'x'", "2:12: scene.up is 'x', expected one of y, z"),
            ("[camera]\nfrom = [1, 2, 3]\nat = [1, 2, 3]", "2:1: camera: from and at are the same point, expected two"),
            (
                "[camera]\nfrom = [0, 0, 0]\nat = [0, 2, 0]\nup = [0, 1, 0]",
                "2:1: camera: up is along the view direction, expected it to point aside",
            ),
            (
                "[camera]\nfrom = [0, 0, 9]\nat = [0, 0, 0]\nup = [0, 0, 0]",
                "2:1: camera: up has no direction, expected a vector longer than 0",
            ),
            (
                "[camera]\nfrom = [0, 0, inf]\nat = [0, 2, 0]",
                "3:15: camera.from[2] is inf, expected a number from -1e12 to 1e12",
            ),
            (
                "[camera]\nfrom = [0, 0, 1e999]\nat = [0, 2, 0]",
                "3:15: camera.from[2] is 1e999, expected a smaller number",
            ),
            (
                "[camera]\nfrom = [0, 0, 1]\nat = [0, 2, 0]\nangle = 180",
                "5:9: camera.angle is 180, expected a number from 0.001 to 179.9",
            ),
            ("[[light]]\ncolour = [1, 1, 1]", "2:1: light[0].position is missing, expected a value"),
            (
                "[[light]]\nposition = [1, 1, 'x']",
                "3:19: light[0].position[2] is 'x', expected a number from -1e12 to 1e12",
            ),
            (
                "[[light]]\nposition = [1, 1, 1]\ncolor = [1, 1, 1]",
                "4:1: unknown key light[0].color, expected one of position, colour; did you mean colour?",
            ),
            ("[light]\nposition = [1, 1, 1]", "2:1: light is [light], expected an array of tables"),
            ("[image]\nwidth = 0", "3:9: image.width is 0, expected an integer from 1 to 65536"),
            ("[image]\nwidth = 512.0", "3:9: image.width is 512.0, expected an integer from 1 to 65536"),
            ("[image]\nheight = 65537", "3:10: image.height is 65537, expected an integer from 1 to 65536"),
            (
                "[image]\nwidth = 99999999999999999999999999999999999999999999",
                "3:9: image.width is 9999999999999999999999999999999999999999…, expected a smaller number",
            ),
            (
                "[image]\nwidth = 32\nheight = 32\ntile = 64",
                "5:8: image.tile is 64x64 pixels, expected at most the image's 32x32",
            ),
            (
                "[image]\nheight = 32\ntile = [64, 64]",
                "4:8: image.tile is 64x64 pixels, expected at most the image's 65536x32",
            ),
            (
                "[image]\nwidth = 65536\nheight = 65536\ntile = 1",
                "5:8: image.tile is 1x1 pixels, which makes 4294967296 tiles, expected at most 16777216",
            ),
            (
                "[image]\ntile = [1, 1, 1]",
                "3:8: image.tile is [1, 1, 1], expected an integer or [width, height], each from 1 to 65536",
            ),
            (
                "[image]\ntile = []",
                "3:8: image.tile is [], expected an integer or [width, height], each from 1 to 65536",
            ),
            ("[image]\ntile = [1, 0]", "3:12: image.tile[1] is 0, expected an integer from 1 to 65536"),
            ("[image]\ntile = 0", "3:8: image.tile is 0, expected an integer or [width, height], each from 1 to 65536"),
            (
                "[image]\ntile = '5x5'",
                "3:8: image.tile is '5x5', expected an integer or [width, height], each from 1 to 65536",
            ),
            ("[image]\ndepth = 65", "3:9: image.depth is 65, expected an integer from 0 to 64"),
            ("[image]\ncutoff = -0.5", "3:10: image.cutoff is -0.5, expected a number from 0 to 1"),
            ("[image]\ncutoff = nan", "3:10: image.cutoff is nan, expected a number from 0 to 1"),
            (
                "[image]\nterminator = 'sotf'",
                "3:14: image.terminator is 'sotf', expected one of hard, soft; did you mean soft?",
            ),
            ("[octree]\nmailbox = 'on'", "3:11: octree.mailbox is 'on', expected a boolean"),
            (
                "[octree]\nleafsize = 8",
                "3:1: unknown key octree.leafsize, expected one of leaf_size, max_depth, mailbox; did you mean leaf_size?",
            ),
            (
                "[database]\nrecords = 'polygon'",
                "3:11: database.records is 'polygon', expected one of triangles, polygons; did you mean polygons?",
            ),
            ("[database]\nnumbers = 64", "3:11: database.numbers is 64, expected a string"),
            ("[database]\nrecord_bytes = 500", "3:16: database.record_bytes is 500, expected an integer from 8 to 496"),
            (
                "[database]\nrecord_bytes = 36",
                "3:16: database.record_bytes: a record of 36 bytes, expected a multiple of 4 from 40 to 496",
            ),
            (
                "[database]\nnumbers = 'f64'\nrecord_bytes = 72",
                "4:16: database.record_bytes: a record of 72 bytes, expected a multiple of 4 from 76 to 496",
            ),
            (
                "[database]\nrecords = 'polygons'\nrecord_bytes = 30",
                "4:16: database.record_bytes: a record of 30 bytes, expected a multiple of 4 from 8 to 496",
            ),
            ("[octree]\nmax_depth = 21", "3:13: octree.max_depth is 21, expected an integer from 0 to 20"),
            ("[cluster]\nnodes = 0", "3:9: cluster.nodes is 0, expected an integer from 1 to 256"),
            ("[cluster]\nnodes = 257", "3:9: cluster.nodes is 257, expected an integer from 1 to 256"),
            ("[cluster]\nnodes = 'four'", "3:9: cluster.nodes is 'four', expected an integer from 1 to 256"),
            ("[cluster]\nnodes = 2024-01-01", "3:9: cluster.nodes is 2024-01-01, expected an integer from 1 to 256"),
            ("[cluster]\nlocal_memory = '1/8'", "3:16: cluster.local_memory is '1/8', expected a table"),
            (
                "[cluster.local_memory]\nsize = '9/8'",
                "3:8: cluster.local_memory.size is '9/8', expected \"all\", a share of the database above 0 and at most 1 such as \"1/8\", or 1 B to 1 TiB such as \"64 KiB\"",
            ),
            (
                "[cluster.local_memory]\nsize = 0",
                "3:8: cluster.local_memory.size is 0, expected \"all\", a share of the database above 0 and at most 1 such as \"1/8\", or 1 B to 1 TiB such as \"64 KiB\"",
            ),
            (
                "[cluster.local_memory]\nsize = 1023",
                "3:8: cluster.local_memory.size is 1023 bytes, expected at least 1024: 16 lines of 64 bytes",
            ),
            (
                "[cluster.local_memory]\nsize = '2 KiB'\nline = 256",
                "3:8: cluster.local_memory.size is 2048 bytes, expected at least 4096: 16 lines of 256 bytes",
            ),
            (
                "[cluster.local_memory]\nline = 48",
                "3:8: cluster.local_memory.line is 48, expected a power of two from 16 to 256",
            ),
            (
                "[cluster.local_memory]\nways = 0",
                "3:8: cluster.local_memory.ways is 0, expected an integer from 1 to 1048576",
            ),
            (
                "[cluster.local_memory]\nreplacement = 'lfu'",
                "3:15: cluster.local_memory.replacement is 'lfu', expected one of lru, fifo, clock, clock:1, random, clock:0, srrip, sieve, s3-fifo, s3_fifo, plru",
            ),
            (
                "[cluster.local_memory]\nreplacement = { lru = {} }",
                "3:15: cluster.local_memory.replacement is { lru = {} }, expected a string",
            ),
            (
                "[cluster.bus]\nquantum = 2",
                "3:11: cluster.bus.quantum has no meaning here, expected it with arbiter = \"round_robin\" only",
            ),
            (
                "[cluster.bus]\narbiter = 'roundrobin'",
                "3:11: cluster.bus.arbiter is 'roundrobin', expected one of fifo, round_robin, fixed_priority; did you mean round_robin?",
            ),
            (
                "[cluster.bus]\narbiter = 'round_robin'\nquantum = 0",
                "4:11: cluster.bus.quantum is 0, expected an integer from 1 to 1024",
            ),
            ("[cluster.bus]\nwidth = 3", "3:9: cluster.bus.width is 3, expected a power of two from 1 to 64"),
            ("[cluster.bus]\nwidth = 128", "3:9: cluster.bus.width is 128, expected a power of two from 1 to 64"),
            (
                "[cluster.bus]\ncycles_per_word = 0",
                "3:19: cluster.bus.cycles_per_word is 0, expected an integer from 1 to 1024",
            ),
            ("[cluster.bus]\nlatency = 1.5", "3:11: cluster.bus.latency is 1.5, expected an integer from 0 to 1000000"),
            (
                "[cluster.bus]\ntransactions = 'spilt'",
                "3:16: cluster.bus.transactions is 'spilt', expected one of locked, split; did you mean split?",
            ),
            ("[cluster]\nprocessor = 20", "3:13: cluster.processor is 20, expected a table"),
            (
                "[cluster.processor]\nshading = 1000001",
                "3:11: cluster.processor.shading is 1000001, expected an integer from 0 to 1000000",
            ),
            (
                "[cluster.processor]\noctreenode = 1",
                "3:1: unknown key cluster.processor.octreenode, expected one of octree_node, primitive_test, shading, local_access; did you mean octree_node?",
            ),
            ("[run]\nseed = -1", "3:8: run.seed is -1, expected an integer from 0 to 9007199254740991"),
            ("[run]\norder = 'hilbert'", "3:9: run.order is 'hilbert', expected one of scanline, morton, random"),
            (
                "[run.deadlines]\ntile_seconds = 0",
                "3:16: run.deadlines.tile_seconds is 0, expected a number from 0.1 to 86400",
            ),
            (
                "[run.deadlines]\ntile = 10",
                "3:1: unknown key run.deadlines.tile, expected one of startup_seconds, heartbeat_seconds, tile_seconds, join_seconds; did you mean tile_seconds?",
            ),
        ];
        for (section, reason) in table {
            assert_refused(&format!("scene.file = 'a.obj'\n{section}"), reason);
        }
    }

    #[test]
    fn files_that_cannot_be_text_are_refused() {
        let error = |bytes: &[u8]| read(bytes).expect_err("no topology").to_string();
        assert_eq!(error(b"# \xc3\xbc\n# \xc3\xbc\xff"), "t.toml:2:4: not UTF-8, expected a text file");
        let folder = tempfile::tempdir().expect("a folder");
        let long = folder.path().join("long.toml");
        std::fs::write(&long, vec![b'#'; 1 + FILE_BYTES_MAX as usize]).expect("a file");
        let error = Topology::read(&long, &[]).expect_err("too long").what;
        assert_eq!(error, "1048577 bytes are too many, expected at most 1048576");
    }

    #[test]
    fn deep_nesting_is_refused() {
        for open in ["[", "{ a = "] {
            assert!(read(format!("a = {}", open.repeat(100_000)).as_bytes()).is_err());
        }
    }

    #[test]
    fn a_topology_of_a_scene_alone_has_the_documented_defaults() {
        let topology = read(b"scene.file = 'scenes/a.obj'").expect("a scene is enough");
        let defaults = Topology {
            name: "t".to_owned(),
            scene: SceneSource::File("scenes/a.obj".into()),
            view: ViewChoices::default(),
            image: Image { width: None, height: None, tile: (16, 16), depth: 4, cutoff: 0.0, terminator: None },
            octree: Octree { leaf_size: 8, max_depth: 12, mailbox: true },
            records: RecordLayout::DEFAULT,
            cluster: Cluster {
                count: 1,
                nodes: 4,
                processor: Processor { octree_node: 20, primitive_test: 60, shading: 200, local_access: 1 },
                local_memory: LocalMemory {
                    size: MemorySize::Share { numerator: 1, denominator: 8 },
                    line: 64,
                    ways: None,
                    replacement: Replacement::Lru,
                },
                bus: Bus {
                    arbiter: Arbiter::Fifo,
                    width: 4,
                    cycles_per_word: 1,
                    latency: 8,
                    transactions: Transactions::Locked,
                },
            },
            hosts: Vec::new(),
            run: Run {
                order: TileOrder::Scanline,
                assignment: Assignment::OnDemand,
                seed: 1,
                verify: 0.0,
                threads: 1,
                deadlines: Deadlines {
                    startup: Duration::from_secs(10),
                    heartbeat: Duration::from_secs(5),
                    tile: Duration::from_secs(600),
                    join: Duration::from_secs(600),
                },
            },
        };
        assert_eq!(topology, defaults);
    }

    #[test]
    fn the_default_tile_fits_a_small_image() {
        let topology = read(b"scene.procedural = 'gears'\nimage = { width = 8, height = 100 }").expect("is possible");
        assert_eq!(topology.image.tile, (8, 16));
    }

    #[test]
    fn a_scene_is_found_from_the_topologys_folder() {
        let source = Source::from_bytes("somewhere/t.toml", b"scene.file = '../a.nff'");
        let topology = Topology::from_source(&source, &[]).expect("is possible");
        assert_eq!(topology.scene, SceneSource::File("somewhere/../a.nff".into()));
    }

    /// A line of a topology file, right or nearly so.
    fn line() -> impl Strategy<Value = String> {
        let words = |words: &'static [&'static str]| proptest::sample::select(words);
        let key = words(&[
            "scene.file",
            "scene.procedural",
            "scene.size",
            "scene.board",
            "scene.background",
            "scene.up",
            "camera.from",
            "camera.at",
            "camera.up",
            "camera.angle",
            "light",
            "image.width",
            "image.height",
            "image.tile",
            "image.depth",
            "image.cutoff",
            "image.terminator",
            "octree.leaf_size",
            "database.records",
            "database.numbers",
            "database.record_bytes",
            "cluster.nodes",
            "cluster.local_memory.size",
            "cluster.local_memory.line",
            "cluster.local_memory.ways",
            "cluster.local_memory.replacement",
            "cluster.bus.arbiter",
            "cluster.bus.quantum",
            "cluster.bus.width",
            "cluster.bus.latency",
            "cluster.bus.transactions",
            "cluster.processor.shading",
            "run.order",
            "run.seed",
            "run.deadlines.tile_seconds",
            "topology.name",
            "topology.version",
        ]);
        let value = prop_oneof![
            words(&[
                "'gears'",
                "'a.obj'",
                "[0, 1, 2]",
                "[1, 0.5]",
                "[{position = [1, 2, 3]}]",
                "'all'",
                "'1/8'",
                "'4 KiB'",
                "64",
                "'random'",
                "'clock:0'",
                "'s3-fifo'",
                "'round_robin'",
                "'morton'",
                "'soft'",
                "'polygons'",
                "'f64'",
                "'z'",
                "1",
                "true",
                "1979-05-27",
                "{}",
                "[]",
                "''",
                "1_0",
            ])
            .prop_map(str::to_owned),
            any::<i64>().prop_map(|number| number.to_string()),
            any::<f64>().prop_map(|number| format!("{number:?}").to_lowercase()),
            any::<String>(),
        ];
        (key, value).prop_map(|(key, value)| format!("{key} = {value}\n"))
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = read(&bytes);
        }

        #[test]
        fn what_is_accepted_is_written_as_it_was_read(lines in proptest::collection::vec(line(), 0..6)) {
            let text = format!("scene.procedural = 'gears'\n{}", lines.concat());
            if let Ok(topology) = read(text.as_bytes()) {
                let written = topology.to_toml().expect("is TOML");
                prop_assert_eq!(read(written.as_bytes()).expect("reads back"), topology);
            }
        }
    }
}
