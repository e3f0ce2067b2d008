//! What a run must give: the image of one process that nothing disturbs.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::Value;

/// The hash of a scene's square image; the image itself is then FOLDER/render.png.
pub(crate) fn undisturbed((scene, size): (&str, u32), side: u32, folder: &Path) -> String {
    let report = folder.join("render.json");
    let mut command = quiet(Command::new(env!("CARGO_BIN_EXE_marti")));
    command.args(["render", &format!("{scene}:{size}"), "--size", &format!("{side}x{side}"), "-o"]);
    command.arg(folder.join("render.png")).arg("--report").arg(&report);
    assert!(command.status().expect("marti can be started").success());
    let text = fs::read_to_string(report).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("a report is JSON");
    report["image"]["sha256"].as_str().expect("image.sha256").to_owned()
}

/// In the project's folder, saying nothing.
pub(crate) fn quiet(mut command: Command) -> Command {
    command.current_dir(env!("CARGO_MANIFEST_DIR")).stdout(Stdio::null()).stderr(Stdio::null());
    command
}
