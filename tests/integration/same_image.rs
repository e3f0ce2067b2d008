//! The image is bit-identical whatever renders it, and the books balance.

use std::path::Path;

use serde_json::Value;
use trace::tracer::simd::Simd;

use crate::command::{TEAPOT, marti, number, read_report, report_of, run, stderr};

fn sha256(report: &Value) -> String {
    report["image"]["sha256"].as_str().expect("a report has the image's hash").to_owned()
}

fn render(out: &Path, extra: &[&str]) -> Value {
    render_scene("teapot:6", "64x64", out, extra)
}

fn render_scene(scene: &str, size: &str, out: &Path, extra: &[&str]) -> Value {
    let (png, report) = (out.join("render.png"), out.join("render.json"));
    let (png, report_file) = (png.to_string_lossy(), report.to_string_lossy());
    let mut arguments = vec!["render", scene, "-o", &png, "--size", size, "--report", &report_file];
    arguments.extend(extra);
    let output = run(&arguments);
    assert!(output.status.success(), "{extra:?}: {}", stderr(&output));
    read_report(&report)
}

/// Runs with these overrides and expects the image of `marti render`.
fn expect_same(expected: &str, sets: &[&str]) -> Value {
    let out = tempfile::tempdir().expect("temporary folder");
    let report = report_of(TEAPOT, out.path(), sets);
    assert_eq!(sha256(&report), expected, "{sets:?}");
    assert_eq!(report["conservation"]["holds"], true, "{sets:?}: {}", report["conservation"]);
    assert_eq!(number(&report, "tiles.done"), number(&report, "tiles.total"), "{sets:?}");
    let logged = number(&report, "bus.log_rows");
    assert_eq!(logged, number(&report, "bus.transactions"), "{sets:?}");
    report
}

#[test]
fn one_process_gives_the_same_image_for_any_threads_octree_and_mailbox() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    let ways: [&[&str]; 6] = [
        &["--threads", "2"],
        &["--kernel", "single", "--mailbox", "off"],
        &["--leaf-size", "1", "--max-depth", "6"],
        &["--leaf-size", "4", "--max-depth", "14"],
        &["--leaf-size", "1000", "--max-depth", "0"],
        &["--aov", "depth,normal,primitive", "--repeat", "2"],
    ];
    for way in ways {
        assert_eq!(sha256(&render(out.path(), way)), expected, "{way:?}");
    }
}

#[test]
fn a_node_with_threads_gives_the_same_image_with_one_copy_of_the_database() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    let all = "cluster.local_memory.size=all";
    let alone = expect_same(&expected, &[all, "cluster.nodes=1"]);
    let threads = expect_same(&expected, &[all, "cluster.nodes=1", "cluster.threads=3"]);
    let two = expect_same(&expected, &[all, "cluster.nodes=2"]);
    assert_eq!(number(&threads, "bus.bytes"), number(&alone, "bus.bytes"), "the database is sent once");
    assert!(number(&two, "bus.bytes") > number(&threads, "bus.bytes"));
    expect_same(&expected, &[all, "cluster.nodes=3", "cluster.threads=2", "run.verify=0.2"]);
}

#[test]
fn a_node_with_threads_is_killed_or_corrupted_and_the_image_is_the_same() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    for (fault, verify) in [("kill node@30%", "0"), ("corrupt node 1@20%", "1")] {
        let output = marti()
            .args(["run", TEAPOT, "--quiet", "--set", "cluster.local_memory.size=all", "--set", "cluster.threads=2"])
            .args(["--set", "cluster.nodes=3", "--set", &format!("run.verify={verify}"), "--chaos", fault, "--out"])
            .arg(out.path().join(&fault[..4]))
            .output()
            .expect("marti can be started");
        assert!(output.status.success(), "{fault}: {}", stderr(&output));
        assert_eq!(sha256(&read_report(&out.path().join(&fault[..4]).join("report.json"))), expected, "{fault}");
    }
}

#[test]
fn a_local_memory_is_of_one_thread() {
    let output = run(&["run", TEAPOT, "--set", "cluster.threads=2", "--set", "cluster.local_memory.size=1/8"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("cluster.threads is 2, expected 1, or cluster.local_memory.size = \"all\""));
}

/// What is read is another, what is seen is not.
#[test]
fn polygons_as_objects_and_padded_records_give_the_same_image() {
    let out = tempfile::tempdir().expect("temporary folder");
    let gears = ["scene.procedural=gears", "scene.size=1"];
    let expected = sha256(&render_scene("gears:1", "64x64", out.path(), &[]));
    let layouts: [&[&str]; 4] = [
        &["database.records=polygons", "database.numbers=f64", "database.record_bytes=300"],
        &[
            "database.records=polygons",
            "octree.leaf_size=1",
            "octree.mailbox=false",
            "run.verify=0.5",
            "cluster.nodes=3",
        ],
        &["database.numbers=f64", "cluster.local_memory.line=16", "cluster.local_memory.size=1/32"],
        &["database.records=polygons", "cluster.local_memory.size=all"],
    ];
    for sets in layouts {
        let report = expect_same(&expected, &[&gears[..], sets].concat());
        let by_section = report["memory"]["by_section"].as_array();
        let polygons = by_section.and_then(|rows| rows.iter().find(|row| row["section"] == "polygons").cloned());
        let reads = polygons.map(|row| row["record_accesses"].as_u64().expect("a count"));
        match (sets.contains(&"cluster.local_memory.size=all"), sets[0] == "database.records=polygons") {
            (true, _) => assert_eq!(reads, None, "packets count nothing"),
            (false, true) => {
                assert!(reads > Some(1000), "{reads:?}");
                assert!(report["tests"]["polygon_triangles"].as_u64() > reads);
            }
            (false, false) => assert_eq!((reads, report["tests"].get("polygon_triangles")), (Some(0), None)),
        }
    }
}

#[test]
fn any_number_of_nodes_and_any_memory_give_the_same_image() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    expect_same(&expected, &["cluster.nodes=1", "cluster.local_memory.size=all"]);
    for nodes in [2, 4, 9] {
        for size in ["1/8", "1/32", "4 KiB"] {
            let (nodes, size) = (format!("cluster.nodes={nodes}"), format!("cluster.local_memory.size={size}"));
            let report = expect_same(&expected, &[&nodes, &size]);
            assert!(number(&report, "memory.misses") > 0, "{nodes} {size}");
            assert_eq!(number(&report, "bus.fetches"), number(&report, "memory.misses"), "{nodes} {size}");
        }
    }
}

#[test]
fn any_number_of_clusters_gives_the_same_image_and_closes_all_books() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    for (count, nodes) in [(1, 3), (2, 2), (3, 1)] {
        for assignment in ["on_demand", "interleaved"] {
            let sets = [
                format!("cluster.count={count}"),
                format!("cluster.nodes={nodes}"),
                format!("run.assignment={assignment}"),
                "run.verify=0.2".to_owned(),
            ];
            let report = expect_same(&expected, &sets.each_ref().map(String::as_str));
            assert_eq!(report["nodes"].as_array().map(Vec::len), Some(count * nodes), "{sets:?}");
            // Six equations a cluster, one a node that counts, one of all tiles.
            let checks = report["conservation"]["checks"].as_array().map(Vec::len);
            assert_eq!(checks, Some(6 * count + count * nodes + 1), "{sets:?}");
            assert!(report["conservation"]["unverifiable"].is_null());
            assert!(number(&report, "tiles.verified") >= 3, "the first tile of every node: {sets:?}");
            assert_eq!(number(&report, "tiles.disagreements"), 0);
        }
    }
}

/// The packets with any instructions, the single-ray kernel, nodes with all of the database, nodes with little of it.
#[test]
fn every_kernel_and_every_way_to_run_give_the_same_image_of_every_scene() {
    let scenes = [
        ("gears", 2),
        ("teapot", 12),
        ("balls", 4),
        ("tetra", 6),
        ("slivers", 2),
        ("plane", 6),
        ("decades", 2),
        ("giant", 2),
        ("corner", 3),
    ];
    for (scene, size) in scenes {
        let out = tempfile::tempdir().expect("temporary folder");
        let named = format!("{scene}:{size}");
        let render = |kernel: &[&str]| render_scene(&named, "48x40", out.path(), kernel);
        let single = render(&["--kernel", "single"]);
        assert_eq!(single["kernel"]["name"], "single");
        assert!(number(&single, "tests.primitive") > 0);
        let expected = sha256(&single);
        for simd in Simd::available() {
            let packets = render(&["--kernel", "packets", "--simd", simd.name()]);
            assert_eq!(sha256(&packets), expected, "{named} {simd}");
            assert_eq!(packets["rays"], single["rays"], "{named} {simd}");
            assert_eq!(packets["kernel"]["simd"], simd.name());
            assert_eq!(packets["tests"], Value::Null, "nothing of the kind was counted");
        }
        let (scene, size) = (format!("scene.procedural={scene}"), format!("scene.size={size}"));
        let line = "cluster.local_memory.line=256";
        let sets = [&scene, &size, "image.width=48", "image.height=40", line];
        let run = |memory| expect_same(&expected, &[&sets[..], &[memory]].concat());
        let (all, little) = (run("cluster.local_memory.size=all"), run("cluster.local_memory.size=1/4"));
        assert_eq!((&all["kernel"]["name"], &little["kernel"]["name"]), (&"packets".into(), &"single".into()));
        assert!(number(&all, "kernel.derived_bytes") > 0 && all["octree"]["levels"][0]["accesses"].is_null());
        assert!(number(&little, "memory.misses") > 0 && number(&little, "tests.primitive") > 0);
        assert_eq!((&all["rays"], &little["rays"]), (&single["rays"], &single["rays"]));
    }
}

#[test]
fn tiles_mailbox_replacement_arbiter_and_order_give_the_same_image() {
    let out = tempfile::tempdir().expect("temporary folder");
    let expected = sha256(&render(out.path(), &[]));
    let ways: [&[&str]; 13] = [
        &["image.tile=5"],
        &["image.tile=16"],
        &["image.tile=[64, 1]"],
        &["octree.mailbox=false"],
        &["octree.leaf_size=3", "octree.max_depth=7"],
        &["cluster.local_memory.replacement=fifo", "cluster.local_memory.line=16"],
        &["cluster.local_memory.replacement=clock", "cluster.local_memory.line=256"],
        &["cluster.local_memory.replacement=random", "cluster.local_memory.ways=4"],
        &["cluster.local_memory.replacement=lru", "cluster.local_memory.ways=1"],
        &["cluster.bus.arbiter=round_robin", "cluster.bus.quantum=2"],
        &["cluster.bus.arbiter=fixed_priority"],
        &["run.order=random", "run.seed=7", "run.assignment=interleaved"],
        &["run.order=morton"],
    ];
    for way in ways {
        expect_same(&expected, way);
    }
}

/// Under interleaved assignment every count of memory is reproducible.
#[test]
fn interleaved_counts_are_reproducible() {
    let out = tempfile::tempdir().expect("temporary folder");
    let sets = ["run.assignment=interleaved", "cluster.nodes=3", "cluster.local_memory.size=1/16"];
    let mut first = report_of(TEAPOT, out.path(), &sets)["nodes"].clone();
    let mut second = report_of(TEAPOT, out.path(), &sets)["nodes"].clone();
    for nodes in [&mut first, &mut second] {
        for node in nodes.as_array_mut().expect("nodes are a list") {
            node.as_object_mut().expect("a node is an object").remove("stall_seconds");
        }
    }
    assert_eq!(first, second);
}

/// The planes of the first hits are the same from one process and from many.
#[test]
fn planes_of_first_hits_are_the_same_from_one_process_and_from_many() {
    let out = tempfile::tempdir().expect("temporary folder");
    let aov = "depth,normal,primitive";
    render(out.path(), &["--aov", aov]);
    let output = marti().args(["run", TEAPOT, "--quiet", "--aov", aov, "--out"]).arg(out.path().join("run")).output();
    let output = output.expect("marti can be started");
    assert!(output.status.success(), "{}", stderr(&output));
    for plane in ["t.npy", "n.npy", "prim.npy"] {
        let read = |name: String| std::fs::read(out.path().join(&name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(read(format!("render.{plane}")) == read(format!("run/image.{plane}")), "{plane}");
    }
}
