//! `marti run` with two nodes and "all" beside `marti render --threads 2`, 4096x4096: first tile issued to last
//! acknowledged, interleaved, medians and their ratio.
//!
//! `cargo bench --bench cluster`; `-- 7` for seven runs of each instead of three.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

fn main() {
    // cargo itself passes `--bench`.
    let runs = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(3).max(1);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, image, report) =
        (folder.path().join("run"), folder.path().join("render.png"), folder.path().join("render.json"));
    let (mut run, mut render) = (Vec::new(), Vec::new());
    for _ in 0..runs {
        let mut command = marti();
        command.args(["run", "topologies/two-nodes-4096.toml", "--quiet", "--out"]).arg(&out);
        run.push(measure(command, &out.join("report.json")));
        let mut command = marti();
        command.args(["render", "teapot", "--threads", "2", "--size", "4096x4096", "-o"]).arg(&image);
        command.arg("--report").arg(&report);
        render.push(measure(command, &report));
    }
    assert!(run.iter().chain(&render).all(|m| m.sha256 == run[0].sha256), "the images differ");
    let median = |measured: &mut Vec<Measured>| {
        measured.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        measured[measured.len() / 2].seconds
    };
    let (run, render) = (median(&mut run), median(&mut render));
    println!("marti run, two nodes      {run:8.3} s");
    println!("marti render --threads 2  {render:8.3} s");
    println!("ratio                     {:8.3}", run / render);
}

struct Measured {
    seconds: f64,
    sha256: String,
}

fn marti() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_marti"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).stdout(std::process::Stdio::null());
    command
}

fn measure(mut command: Command, report: &Path) -> Measured {
    assert!(command.status().expect("marti can be started").success());
    let text = std::fs::read_to_string(report).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("a report is JSON");
    Measured {
        seconds: report["seconds"]["render"].as_f64().expect("seconds.render"),
        sha256: report["image"]["sha256"].as_str().expect("image.sha256").to_owned(),
    }
}
