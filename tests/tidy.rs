//! The rules of ARCHITECTURE.md on who may import whom, as a test.

use std::fs;
use std::path::{Path, PathBuf};

/// Every Rust source below `folder`, with its text up to its own tests.
fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let mut rest = vec![root.join(folder)];
    while let Some(path) = rest.pop() {
        if path.is_dir() {
            rest.extend(fs::read_dir(&path).expect("a readable folder").map(|e| e.expect("an entry").path()));
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = fs::read_to_string(&path).expect("a readable source");
            let code = text.split("#[cfg(test)]").next().unwrap_or_default().to_owned();
            let code = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
            found.push((path.strip_prefix(root).expect("below the root").to_owned(), code));
        }
    }
    assert!(!found.is_empty(), "{folder} has no sources");
    found
}

/// No source below `folder`, but those named, contains any of these.
fn forbid(folder: &str, words: &[&str], but: &[&str], why: &str) {
    for (path, code) in sources(folder) {
        if but.iter().any(|allowed| path.starts_with(allowed)) {
            continue;
        }
        for word in words {
            assert!(!code.contains(word), "{} names `{word}`: {why}", path.display());
        }
    }
}

#[test]
fn the_core_is_pure() {
    let impure =
        ["tokio", "mio::", "std::net", "std::time", "std::fs", "std::process", "SystemTime", "Instant", "getrandom"];
    for core in ["src/tracer", "src/oracle", "src/machine", "src/replay/contention"] {
        forbid(core, &impure, &[], "the core knows no sockets, no clock, no files, no entropy");
        let outer = ["crate::processes", "crate::protocol", "crate::recording", "crate::report", "crate::cli"];
        forbid(core, &outer, &[], "the core does not know who uses it");
    }
    forbid("src/tracer", &["crate::machine", "crate::topology"], &[], "the tracer reads through MemoryPort alone");
    let models = ["stack_distance", "curve", "miss_classes", "next_use", "optimal", "verify", "reads", "captured"];
    for model in models {
        // Next uses are kept in an unnamed temporary file.
        let forbidden = |word: &&str| model != "next_use" || *word != "std::fs";
        let impure: Vec<&str> = impure.into_iter().filter(forbidden).collect();
        let model = format!("src/replay/{model}.rs");
        forbid(&model, &impure, &[], "a model of memories knows no sockets, no clock, no files");
        forbid(&model, &["crate::processes", "crate::cli"], &[], "a model does not know who uses it");
    }
}

#[test]
fn a_journal_is_bytes_and_a_file() {
    let outer = ["crate::processes", "crate::protocol", "crate::cli", "std::net", "SystemTime"];
    forbid("src/journal", &outer, &[], "a journal does not know who appends to it");
    forbid(
        "src/journal",
        &["std::fs", "Instant"],
        &["src/journal/writer.rs", "src/journal/tests.rs"],
        "a reader takes any bytes",
    );
}

#[test]
fn keys_are_files_alone() {
    let outer = ["crate::processes", "crate::protocol", "crate::cli", "tokio", "std::net"];
    forbid("src/keys", &outer, &[], "keys do not know who uses them");
}

#[test]
fn replays_start_nothing() {
    let outer = ["crate::processes", "crate::cli", "crate::study", "tokio", "std::net", "SystemTime", "Instant"];
    forbid("src/replay", &outer, &[], "a replay reads a recording and counts");
}

#[test]
fn faults_are_planned_here_and_carried_out_elsewhere() {
    let impure = ["tokio", "std::net", "std::fs", "std::process", "SystemTime", "Instant", "getrandom", "nix"];
    forbid("src/chaos", &impure, &[], "a schedule is told the time and what lives");
    forbid("src/chaos", &["crate::processes", "crate::protocol", "crate::cli"], &[], "a schedule knows no process");
}

#[test]
fn studies_replay_and_start_nothing() {
    let outer = ["crate::processes", "crate::cli", "std::net", "SystemTime", "Instant"];
    forbid("src/study", &outer, &[], "a study is a function of its scenes");
}

#[test]
fn no_process_imports_another() {
    let processes = ["manager", "master", "node", "bus", "display", "player"];
    for process in processes {
        for other in processes.into_iter().filter(|other| *other != process) {
            let names = [format!("processes::{other}"), format!("super::super::{other}")];
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            forbid(&format!("src/processes/{process}"), &names, &[], "processes share meaning through protocol alone");
        }
    }
}

#[test]
fn the_simulation_has_no_clock_and_nobody_knows_of_it() {
    let real = ["tokio", "mio::", "TcpStream", "Instant", "SystemTime", "std::fs", "std::thread", "std::process"];
    forbid("src/processes/simulation", &real, &[], "time, network and processes of a simulation are numbers");
    forbid("src", &["processes::simulation", "super::simulation"], &[], "a process does not know who rehearses it");
}

#[test]
fn each_foreign_thing_has_its_place() {
    forbid("src", &["bincode"], &["src/protocol/frame.rs"], "the wire codec is named in one file");
    forbid("src", &["tokio"], &["src/protocol", "src/processes"], "only protocol, processes and bin are async");
    forbid("src", &["arrow_"], &["src/recording"], "only recordings are Arrow");
    forbid(
        "src",
        &["rustls"],
        &["src/protocol/connection", "src/keys"],
        "only connections speak TLS, only keys are certified",
    );
    forbid("src", &["rcgen"], &["src/keys"], "certificates are made in one folder");
    forbid("src", &["toml::"], &["src/topology"], "only topologies are TOML");
    forbid("src", &["plotters"], &["src/study/plot.rs"], "charts are drawn in one file");
    forbid("src", &["mul_add"], &[], "a fused multiply-add gives other bits on other hosts");
}

#[test]
fn nothing_panics_where_standard_error_a_thread_or_a_descriptor_is_missing() {
    // And what does not: outlet::say and cli::print, thread::Builder and event_queue::aside, event_queue::event_queue.
    let print = ["eprintln!(", "eprint!(", "println!(", "print!("];
    let spawn = ["thread::spawn(", "scope.spawn(", "spawn_blocking", "lookup_host", "new_current_thread"];
    for (path, code) in sources("src").into_iter().chain(sources("bin")) {
        let is_exempt = path.to_string_lossy().ends_with("tests.rs");
        for word in print.into_iter().chain(spawn) {
            let is_event_queue = word == "new_current_thread" && path.ends_with("event_queue.rs");
            assert!(is_exempt || is_event_queue || !code.contains(word), "{}: `{word}` may panic", path.display());
        }
    }
}

#[test]
fn main_functions_are_short_and_files_have_one_noun() {
    for (path, code) in sources("bin") {
        assert!(code.lines().count() < 40, "{} has 40 lines or more", path.display());
    }
    for (path, code) in sources("src") {
        let lines = code.lines().count();
        assert!(lines <= 500 || path.ends_with("teapot_patches.rs"), "{} has {lines} lines", path.display());
    }
}
