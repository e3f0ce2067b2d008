//! The real binaries, run in folders of their own.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The manager's binary; the others stand beside it.
pub(crate) fn marti() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_marti"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("MARTI_LOG");
    command
}

/// Runs `marti` to its end.
pub(crate) fn run(arguments: &[impl AsRef<OsStr>]) -> Output {
    marti().args(arguments).output().expect("marti can be started")
}

/// Standard error of a finished command.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A small topology of the teapot, to which a test adds by `--set`.
pub(crate) const TEAPOT: &str = "tests/data/teapot-64.toml";

/// Runs a topology into a folder of its own and returns its report; the run must succeed.
pub(crate) fn report_of(topology: &str, out: &Path, sets: &[&str]) -> Value {
    report_with(topology, out, sets, &[])
}

/// [`report_of`] a run whose references are recorded.
pub(crate) fn recorded_report_of(topology: &str, out: &Path, sets: &[&str]) -> Value {
    report_with(topology, out, sets, &["--record", "references"])
}

fn report_with(topology: &str, out: &Path, sets: &[&str], options: &[&str]) -> Value {
    let mut command = marti();
    command.args(["run", topology, "--quiet", "--out"]).arg(out).args(options);
    for set in sets {
        command.args(["--set", set]);
    }
    let output = command.output().expect("marti can be started");
    assert!(output.status.success(), "{sets:?}: {:?}\n{}", output.status, stderr(&output));
    read_report(&out.join("report.json"))
}

pub(crate) fn read_report(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).expect("a report is JSON")
}

/// The number at a dotted path of a report.
pub(crate) fn number(report: &Value, path: &str) -> u64 {
    let at = path.split('.').fold(report, |value, key| &value[key]);
    at.as_u64().unwrap_or_else(|| panic!("{path} is {at}"))
}

/// The folder of reference data, or `None` after saying loudly that a test cannot run without it.
pub(crate) fn reference(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED {test}: there is no reference data at {}", folder.display());
    None
}

/// Whether Python with these modules is here; says loudly when not, and fails where it is required.
pub(crate) fn python_with(modules: &str, test: &str) -> bool {
    let import = Command::new("python3").args(["-c", &format!("import {modules}")]).output();
    if import.is_ok_and(|output| output.status.success()) {
        return true;
    }
    assert!(std::env::var_os("MARTI_REQUIRE_PYTHON").is_none(), "{test} needs python3 with {modules}");
    eprintln!("SKIPPED {test}: it needs python3 with {modules}");
    false
}
