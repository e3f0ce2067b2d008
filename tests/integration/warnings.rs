//! What of a scene cannot be seen, or has no effect, is never passed over in silence.

use std::fs;
use std::path::Path;

use crate::command::{marti, read_report};

/// A sphere in the middle; what comes before and after it is the case's.
fn nff(eye: &str, at: &str, light: &str, rest: &str) -> String {
    format!(
        "b 0.1 0.1 0.1\nv\nfrom {eye}\nat {at}\nup 0 1 0\nangle 45\nhither 0.1\nresolution 16 16\n{light}\nf 1 1 1 1 0 1 0 1\n{rest}\n"
    )
}

/// Runs in a folder; standard error and the exit code.
fn said(folder: &Path, arguments: &[&str]) -> (String, Option<i32>) {
    let output = marti().current_dir(folder).args(arguments).output().expect("marti can be started");
    (String::from_utf8_lossy(&output.stderr).into_owned(), output.status.code())
}

#[test]
fn warnings_are_printed_first_and_reported_and_errors_with_strict() {
    const SPHERE: &str = "s 0 0 0 1";
    let cases = [
        ("no-light", nff("0 0 5", "0 0 0", "", SPHERE), "the scene has no lights: two beside the camera light it"),
        (
            "no-primitives",
            nff("0 0 5", "0 0 0", "l 0 0 9", ""),
            "the scene has no surfaces (points, lines and curves are none)",
        ),
        (
            "out-of-view",
            nff("0 0 5", "0 0 9", "l 0 0 9", SPHERE),
            "the whole scene is behind the camera: the background",
        ),
        (
            "nothing-lit",
            nff("0 0 0.5", "0 0 0", "l 0 0 9", SPHERE),
            "none of the surfaces at 256 of 256 pixels that were tried is lit: the camera sees back",
        ),
    ];
    for (kind, text, expected) in cases {
        let folder = tempfile::tempdir().expect("temporary folder");
        fs::write(folder.path().join("scene.nff"), text).expect("writable folder");
        let warning = format!("warning: {expected}");
        for arguments in
            [&["render", "scene.nff", "-q", "--report", "render.json"][..], &["run", "scene.nff", "-q", "--out", "out"]]
        {
            let (stderr, code) = said(folder.path(), arguments);
            assert!(stderr.starts_with(&warning) && stderr.lines().count() == 1, "{arguments:?}: {stderr}");
            assert_eq!(code, Some(0), "{arguments:?}");
        }
        for report in ["render.json", "out/report.json"] {
            let warnings = &read_report(&folder.path().join(report))["warnings"];
            assert_eq!(
                (&warnings[0]["kind"], &warnings[0]["count"], &warnings[1]),
                (&kind.into(), &1.into(), &().into())
            );
            assert!(
                warnings[0].get("file").is_none()
                    && warnings[0]["text"].as_str().is_some_and(|t| t.starts_with(expected))
            );
        }
        let summary =
            marti().current_dir(folder.path()).args(["render", "scene.nff"]).output().expect("marti can be started");
        let summary = String::from_utf8_lossy(&summary.stdout).into_owned();
        let last = summary.lines().last().expect("a summary");
        assert!(last.starts_with(&format!("warning      {expected}")), "{summary}");

        // What a few pixels make likely is no error.
        if kind == "nothing-lit" {
            assert_eq!(said(folder.path(), &["render", "scene.nff", "--strict"]).1, Some(0));
            continue;
        }
        // Nothing is started, and nothing written.
        fs::remove_dir_all(folder.path().join("out")).expect("our own folder");
        fs::remove_file(folder.path().join("scene.png")).expect("our own file");
        for arguments in [&["render", "scene.nff", "--strict"][..], &["run", "scene.nff", "--strict", "--out", "out"]] {
            let (stderr, code) = said(folder.path(), arguments);
            let expected = "error: the scene has warnings, which --strict makes errors";
            assert!(stderr.starts_with(&warning) && stderr.lines().last() == Some(expected), "{arguments:?}: {stderr}");
            assert_eq!(code, Some(2), "{arguments:?}");
        }
        assert!(!folder.path().join("scene.png").exists() && !folder.path().join("out/report.json").exists());
    }
}

#[test]
fn every_command_that_reads_a_scene_warns() {
    let folder = tempfile::tempdir().expect("temporary folder");
    fs::write(folder.path().join("scene.nff"), nff("0 0 5", "0 0 0", "", "s 0 0 0 1")).expect("writable folder");
    for arguments in [
        &["check", "scene.nff"][..],
        &["inspect", "scene.nff"],
        &["verify", "scene.nff", "--rays", "10"],
        &["study", "sweep", "scene.nff", "-q", "--nodes", "1", "--local-memory", "all"],
    ] {
        let (stderr, code) = said(folder.path(), arguments);
        assert_eq!(stderr, "warning: the scene has no lights: two beside the camera light it\n", "{arguments:?}");
        assert_eq!(code, Some(0), "{arguments:?}");
    }
    assert_eq!(said(folder.path(), &["check", "scene.nff", "--strict"]).1, Some(2));
}

#[test]
fn a_check_warns_of_all_that_a_run_warns_of() {
    let folder = tempfile::tempdir().expect("temporary folder");
    // From inside of a sphere, beside a polygon that crosses itself.
    let crossing = "s 0 0 0 1\np 4\n0 0 -9\n1 1 -9\n1 0 -9\n0 1 -9";
    fs::write(folder.path().join("scene.nff"), nff("0 0 0.5", "0 0 0", "l 0 0 9", crossing)).expect("writable folder");
    let (checked, _) = said(folder.path(), &["check", "scene.nff"]);
    let (ran, _) = said(folder.path(), &["run", "scene.nff", "-q", "--out", "out"]);
    assert_eq!(checked, ran);
    assert!(
        checked.starts_with("warning: scene.nff:12:1: a polygon of 4 corners crosses itself")
            && checked.lines().count() == 2,
        "{checked}"
    );
}

#[test]
fn what_is_chosen_leaves_nothing_to_warn_of() {
    let folder = tempfile::tempdir().expect("temporary folder");
    fs::write(folder.path().join("scene.nff"), nff("0 0 0.5", "0 0 0", "", "s 0 0 0 1")).expect("writable folder");
    let view = ["--camera-from", "0,0,5", "--light", "0,0,9"];
    let arguments = [&["render", "scene.nff", "-q", "--strict"][..], &view].concat();
    assert_eq!(said(folder.path(), &arguments), (String::new(), Some(0)));
    let sets = ["--set", "camera.from=[0, 0, 5]", "--set", "light=[{ position = [0, 0, 9] }]"];
    let arguments = [&["run", "scene.nff", "-q", "--strict", "--out", "out"][..], &sets].concat();
    assert_eq!(said(folder.path(), &arguments), (String::new(), Some(0)));
}

#[test]
fn a_vertical_axis_that_decides_nothing_is_warned_of() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let warning = "warning: the vertical axis z has no effect: the scene has a camera of its own\n";
    let render = ["render", "gears:1", "-q", "--size", "8x8", "--up", "z"];
    assert_eq!(said(folder.path(), &render), (warning.to_owned(), Some(0)));
    let check = ["check", "gears:1", "--set", "scene.up=z", "--strict"];
    let (stderr, code) = said(folder.path(), &check);
    assert_eq!((stderr.starts_with(warning), code), (true, Some(2)));
}

#[test]
fn scenes_that_come_along_have_no_warnings() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/");
    let [primitives, house] = ["primitives.nff", "house.obj"].map(|name| format!("{scenes}{name}"));
    for scene in [
        "gears:1",
        "teapot:2",
        "balls:2",
        "tetra:2",
        "slivers:1",
        "plane:2",
        "decades:1",
        "giant:1",
        "corner:2",
        &primitives,
        &house,
    ] {
        let arguments = ["render", scene, "-q", "--size", "64x64", "--strict", "-o", "a.png"];
        assert_eq!(said(folder.path(), &arguments), (String::new(), Some(0)), "{scene}");
    }
}
