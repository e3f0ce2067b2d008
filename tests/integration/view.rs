//! What is seen, and from where: of the scene, of a topology, of the command line.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::command::{number, read_report, run, stderr};

/// A sphere on a triangle, with a camera, a light and a background of its own.
const SCENE: &str = "b 0.1 0.2 0.3\nv\nfrom 0 2 6\nat 0 0 0\nup 0 1 0\nangle 40\nhither 0.1\nresolution 40 30\nl 5 9 5\n\
    f 1 0.5 0.2 0.8 0.2 9 0 1\ns 0 0 0 1\np 3\n-4 -1 4\n4 -1 4\n0 -1 -4\n";

/// Long and low: it has to be seen whole.
const LONG: &str = "v 0 0 0\nv 20 0 0\nv 20 1 0\nv 0 1 0\nv 10 0 2\nf 1 2 3 4\nf 1 2 5\n";

/// Renders with these arguments in a folder, and gives the report.
fn render(folder: &Path, arguments: &[&str]) -> Value {
    let (image, report) = (folder.join("render.png"), folder.join("render.json"));
    let mut line = vec!["render".as_ref(), arguments[0].as_ref(), "-q".as_ref(), "-o".as_ref(), image.as_os_str()];
    line.extend(["--report".as_ref(), report.as_os_str()]);
    line.extend(arguments[1..].iter().map(|argument| std::ffi::OsStr::new(*argument)));
    let output = run(&line);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    assert_eq!(stderr(&output), "", "{arguments:?}");
    read_report(&report)
}

/// Runs with these arguments, and gives the report.
fn run_report(folder: &Path, arguments: &[&str]) -> Value {
    let out = folder.join("run");
    let mut line = vec!["run".as_ref(), arguments[0].as_ref(), "-q".as_ref(), "--out".as_ref(), out.as_os_str()];
    line.extend(arguments[1..].iter().map(|argument| std::ffi::OsStr::new(*argument)));
    let output = run(&line);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    read_report(&out.join("report.json"))
}

fn sha256(report: &Value) -> &str {
    report["image"]["sha256"].as_str().expect("a hash")
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, text).expect("writable folder");
    path.to_str().expect("UTF-8").to_owned()
}

#[test]
fn options_and_topologies_choose_the_same_view() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scene = write(folder.path(), "scene.nff", SCENE);
    let own = render(folder.path(), &[&scene]);
    assert_eq!(own["camera"]["source"], "scene");
    assert_eq!(own["camera"]["chosen"], json!([]));
    assert_eq!(own["scene"]["bounds"], json!({ "low": [-4.0, -1.0, -4.0], "high": [4.0, 1.0, 4.0] }));
    let ways: [(&[&str], &str); 6] = [
        (&["--camera-from", "-3,2,5"], "camera.from = [-3, 2, 5]"),
        (&["--camera-angle", "60", "--camera-at", "0,1,0"], "camera = { angle = 60, at = [0, 1, 0] }"),
        (&["--camera-up", "1,1,0"], "camera.up = [1, 1, 0]"),
        (
            &["--light", "-5,5,5", "--light", "0,9,0,0,0.5,1"],
            "light = [{ position = [-5, 5, 5] }, { position = [0, 9, 0], colour = [0, 0.5, 1] }]",
        ),
        (&["--background", "1,0,0"], "scene.background = [1, 0, 0]"),
        (&["--size", "30x40", "--depth", "0"], "image = { width = 30, height = 40, depth = 0 }"),
    ];
    let mut seen = vec![sha256(&own).to_owned()];
    for (options, keys) in ways {
        let by_options = render(folder.path(), &[&[scene.as_str()], options].concat());
        let topology =
            format!("scene.file = 'scene.nff'\n{keys}\ncluster = {{ nodes = 2, local_memory.size = '1/2' }}\n");
        let topology = write(folder.path(), "view.toml", &topology);
        let by_topology = render(folder.path(), &[&topology]);
        assert_eq!(sha256(&by_options), sha256(&by_topology), "{keys}");
        assert_eq!(by_options["camera"], by_topology["camera"], "{keys}");
        let with_processes = run_report(folder.path(), &[&topology]);
        assert_eq!(sha256(&with_processes), sha256(&by_options), "{keys}");
        assert_eq!(with_processes["camera"], by_options["camera"], "{keys}");
        seen.push(sha256(&by_options).to_owned());
    }
    seen.sort();
    seen.dedup();
    assert_eq!(seen.len(), 7, "each of them is another image");
}

#[test]
fn the_command_line_wins_over_a_topology_part_by_part() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write(folder.path(), "scene.nff", SCENE);
    let text =
        "scene.file = 'scene.nff'\ncamera = { from = [1, 2, 5], angle = 20 }\nimage = { width = 20, depth = 1 }\n";
    let topology = write(folder.path(), "view.toml", text);
    let report = render(folder.path(), &[&topology, "--camera-angle", "50", "--size", "24x24"]);
    let expected = json!({
        "from": [1.0, 2.0, 5.0],
        "at": [0.0, 0.0, 0.0],
        "up": [0.0, 1.0, 0.0],
        "angle": 50.0,
        "source": "scene",
        "chosen": ["from", "angle"],
    });
    assert_eq!(report["camera"], expected);
    assert_eq!((number(&report, "image.width"), number(&report, "image.height")), (24, 24));
}

#[test]
fn a_scene_without_a_camera_is_seen_whole_in_every_format_and_with_either_axis_up() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scene = write(folder.path(), "long.obj", LONG);
    let camera = |arguments: &[&str]| render(folder.path(), &[&[scene.as_str()], arguments].concat())["camera"].clone();
    let (square, wide) = (camera(&["--size", "32x32"]), camera(&["--size", "96x32"]));
    assert_eq!(square["source"], "framing");
    let tall = camera(&["--size", "32x96"]);
    let distance = |camera: &Value| {
        let part = |key: &str, axis: usize| camera[key][axis].as_f64().expect("a number");
        (0..3).map(|axis| (part("from", axis) - part("at", axis)).powi(2)).sum::<f64>().sqrt()
    };
    // It is as wide as it is long, and three times as wide then.
    assert!(distance(&wide) < 0.7 * distance(&square), "{wide} {square}");
    // Three times as narrow, and it is its width that counts.
    assert!(distance(&tall) > 2.0 * distance(&square), "{tall} {square}");
    assert_eq!(tall["up"], json!([0.0, 1.0, 0.0]));
    let z = camera(&["--up", "z"]);
    assert_eq!(z["up"], json!([0.0, 0.0, 1.0]));
    let from = camera(&["--up", "z", "--camera-from", "10,-30,9"]);
    let expected = json!({
        "from": [10.0, -30.0, 9.0],
        "at": [10.0, 0.5, 1.0],
        "up": [0.0, 0.0, 1.0],
        "angle": 45.0,
        "source": "framing",
        "chosen": ["from"],
    });
    assert_eq!(from, expected);
}

#[test]
fn a_scene_runs_by_itself() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scene = write(folder.path(), "scene.nff", SCENE);
    let expected = render(folder.path(), &[&scene]);
    let report = run_report(folder.path(), &[&scene]);
    assert_eq!(sha256(&report), sha256(&expected));
    assert_eq!(report["nodes"].as_array().map(Vec::len), Some(4));
    assert_eq!(report["kernel"]["name"], "packets", "each of them has all of the scene");
    let fewer =
        run_report(folder.path(), &[&scene, "--set", "cluster.nodes=1", "--set", "cluster.local_memory.size=1/2"]);
    assert_eq!((sha256(&fewer), fewer["nodes"].as_array().map(Vec::len)), (sha256(&expected), Some(1)));
    assert_eq!(fewer["kernel"]["name"], "single");
    let gears = ["gears:1", "--set", "image.width=24", "--set", "image.height=24", "--set", "image.tile=8"];
    assert_eq!(
        sha256(&run_report(folder.path(), &gears)),
        sha256(&render(folder.path(), &["gears:1", "--size", "24x24"]))
    );
    // Without --out, in a folder of the scene's name.
    let output = crate::command::marti().current_dir(folder.path()).args(["run", "-q", "scene.nff"]).output();
    assert!(output.expect("marti can be started").status.success());
    assert!(folder.path().join("out/scene/image.png").is_file());
}

#[test]
fn checks_and_inspections_say_what_is_seen() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scene = write(folder.path(), "long.obj", LONG);
    let output = run(&["check", &scene, "--set", "camera.from=[10, 5, 40]"]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("\nbounds        (0, 0, 0) to (20, 1, 2)\n"), "{said}");
    assert!(
        said.contains(
            "\ncamera        from (10, 5, 40) at (10, 0.5, 1), up (0, 1, 0), angle 45; from chosen, else what frames"
        ),
        "{said}"
    );
    let output = run(&["inspect", &scene]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("\nbounds    (0, 0, 0) to (20, 1, 2)\ncamera    from ("), "{said}");
    let output = run(&["inspect", "--json", &scene]);
    let inspection: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(inspection["bounds"]["high"], json!([20.0, 1.0, 2.0]));
    assert_eq!(inspection["camera"]["source"], "framing");
}
