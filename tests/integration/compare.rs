//! `marti compare`, of what two runs leave.

use std::path::Path;

use serde_json::Value;

use crate::command::{TEAPOT, number, report_of, run, stderr};

fn compare(arguments: &[&Path], options: &[&str]) -> (Option<i32>, String, String) {
    let mut line: Vec<&str> = vec!["compare"];
    line.extend(arguments.iter().map(|path| path.to_str().expect("UTF-8")));
    line.extend(options);
    let output = run(&line);
    (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output))
}

#[test]
fn two_runs_differ_in_what_was_asked_and_in_what_followed() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let [a, b, dark, picture] = ["a", "b", "dark", "d.png"].map(|name| folder.path().join(name));
    let first = report_of(TEAPOT, &a, &["image.width=32", "image.height=32", "cluster.nodes=1"]);
    let second = report_of(TEAPOT, &b, &["image.width=32", "image.height=32", "cluster.nodes=2"]);
    report_of(TEAPOT, &dark, &["image.width=32", "image.height=32", "image.depth=0"]);

    let (code, json, _) = compare(&[&a, &b], &["--format", "json", "--exit-code"]);
    assert_eq!(code, Some(1), "a setting differs");
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["picture"]["differing_pixels"], 0);
    assert_eq!(json["settings"][0]["key"], "cluster.nodes");
    assert_eq!((&json["settings"][0]["a"], &json["settings"][0]["b"]), (&"1".into(), &"2".into()));
    let fetches = json["counts"].as_array().expect("a list").iter().find(|row| row["key"] == "bus.fetches");
    let fetches = fetches.expect("two nodes miss more than one");
    assert_eq!(fetches["a"], number(&first, "bus.fetches"));
    assert_eq!(fetches["b"], number(&second, "bus.fetches"));

    let (code, text, error) = compare(&[&a, &dark], &["-o", picture.to_str().expect("UTF-8")]);
    assert_eq!(code, Some(0), "{error}");
    assert!(text.contains("of 1024 pixels differ") && text.contains("PSNR") && text.contains("image.depth"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    let same = compare(&[&a.join("image.png"), &b.join("image.png")], &["--exit-code"]);
    assert_eq!(same.0, Some(0), "{}", same.2);
    let (_, json, _) = compare(&[&picture, &a.join("image.png")], &["--format", "json"]);
    assert!(json.contains("\"width\": 32"), "the picture of the differences has the size of the others: {json}");

    for (paths, options, expected) in [
        (
            [a.as_path(), Path::new("Cargo.toml")],
            &[][..],
            "expected the output folder of a run, or a file in .png or .json",
        ),
        ([&a.join("image.png"), &b.join("report.json")], &[], "nothing of the same kind"),
        ([&a.join("report.json"), &b.join("report.json")], &["-o", "d.png"], "--out has no effect"),
        ([&a, &b], &["-o", a.join("image.png").to_str().expect("UTF-8")], "the command reads this file"),
        ([Path::new("src"), &b], &[], "neither image.png nor report.json"),
        ([&a.join("image.png"), Path::new("docs/images/gears.png")], &[], "expected pictures of the same size"),
    ] {
        let (code, _, error) = compare(&paths, options);
        assert_eq!(code, Some(2), "{error}");
        assert!(error.contains(expected), "{expected}: {error}");
    }
}
