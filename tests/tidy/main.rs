//! The rules of ARCHITECTURE.md on who may import whom, as a test: what the code names is read by a parser.

mod code_map;
mod imports;
mod paths;
mod planted;
mod roots;
mod source;

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use crate::imports::{Imports, cycles};
use crate::paths::resolve;
use crate::source::{SourceFile, crate_files};

fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The crates of the library, from the ground up: each knows those before it, as the compiler makes sure.
const LAYERS: [&str; 5] = ["ground", "trace", "machine", "cluster", "program"];

/// Every file of the layers, in which a parent comes before its children.
static LIBRARY: LazyLock<Vec<SourceFile>> = LazyLock::new(|| {
    let files =
        LAYERS.iter().flat_map(|layer| crate_files(project(), layer, &Path::new("src").join(layer).join("lib.rs")));
    resolve(files.collect())
});

/// Names that a file must not have: `tokio` is all of that crate, `std::fs` that module, `Instant` and `.mul_add` are names from
/// wherever they come, `println!` is a macro, `scope.spawn` a method of a variable of that name.
fn breaches(files: &[SourceFile], folder: &str, forbidden: &[&str], but: &[&str]) -> Vec<String> {
    let files =
        files.iter().filter(|file| is_below(&file.path, folder) && !but.iter().any(|but| is_below(&file.path, but)));
    let mut found = Vec::new();
    for file in files {
        for word in forbidden {
            let is_word = word.contains(['.', '!']) || word.starts_with(char::is_uppercase);
            // `use std::println as say` is an import of the macro.
            let full = word.strip_suffix('!').map_or_else(|| (*word).to_owned(), |name| format!("std::{name}"));
            if let Some(name) = file.names.iter().find(|name| name.is_in(word) || name.is_in(&full)) {
                found.push(format!("{}:{} names `{name}`", file.path.display(), name.line));
            } else if is_word && file.words.contains(word.trim_start_matches('.')) {
                found.push(format!("{} names `{word}`", file.path.display()));
            }
        }
    }
    found
}

/// Whether a file is in a folder, or is the file of a module.
fn is_below(path: &Path, folder: &str) -> bool {
    path.starts_with(folder) || path == Path::new(&format!("{folder}.rs"))
}

/// No file in `folder`, but those named, names any of these.
#[track_caller]
fn forbid(folder: &str, forbidden: &[&str], but: &[&str], why: &str) {
    assert!(LIBRARY.iter().any(|file| is_below(&file.path, folder)), "{folder} has no sources");
    let found = breaches(&LIBRARY, folder, forbidden, but);
    assert!(found.is_empty(), "{why}:\n{}", found.join("\n"));
}

#[test]
fn files_take_names_from_each_other_in_no_circle() {
    let imports = Imports::of(&LIBRARY);
    let found = cycles(&imports.arrows());
    assert!(found.is_empty(), "{} circles:\n{found:#?}", found.len());
}

#[test]
fn the_core_is_pure() {
    let impure = [
        "tokio",
        "mio",
        "std::net",
        "std::time",
        "std::fs",
        "std::process",
        "std::env",
        "std::thread",
        "SystemTime",
        "Instant",
        "getrandom",
        "RandomState",
    ];
    for core in ["src/trace/tracer", "src/trace/oracle", "src/machine/hardware", "src/machine/replay/contention"] {
        forbid(core, &impure, &[], "the core knows no sockets, no clock, no files, no entropy");
        let outer =
            ["cluster::processes", "cluster::protocol", "machine::recording", "cluster::report", "program::cli"];
        forbid(core, &outer, &[], "the core does not know its callers");
        forbid(core, &["HashMap", "HashSet"], &[], "the order of a hash map is another in every process");
    }
    forbid("src/trace/tracer", &["machine", "cluster::topology"], &[], "the tracer reads through MemoryPort alone");
    let models = ["stack_distance", "curve", "miss_classes", "next_use", "optimal", "recount"];
    let models = models.map(|model| format!("model/{model}"));
    for model in models.into_iter().chain(["stream/reads".to_owned(), "stream/captured".to_owned()]) {
        // Next uses are kept in an unnamed temporary file.
        let forbidden = |word: &&str| model != "model/next_use" || *word != "std::fs";
        let impure: Vec<&str> = impure.into_iter().filter(forbidden).collect();
        let model = format!("src/machine/replay/{model}.rs");
        forbid(&model, &impure, &[], "a model of memories knows no sockets, no clock, no files");
        forbid(&model, &["cluster::processes", "program::cli"], &[], "a model does not know its callers");
    }
}

#[test]
fn a_journal_is_bytes_and_a_file() {
    let outer = ["cluster::processes", "cluster::protocol", "program::cli", "std::net", "SystemTime"];
    forbid("src/cluster/journal", &outer, &[], "a journal does not know its writers");
    forbid(
        "src/cluster/journal",
        &["std::fs", "Instant"],
        &["src/cluster/journal/writer.rs", "src/cluster/journal/tests.rs"],
        "a reader takes any bytes",
    );
}

#[test]
fn keys_are_files_alone() {
    let outer = ["cluster::processes", "cluster::protocol", "program::cli", "tokio", "std::net"];
    forbid("src/cluster/keys", &outer, &[], "keys do not know their callers");
}

#[test]
fn replays_start_nothing() {
    let outer = ["cluster::processes", "program::cli", "program::study", "tokio", "std::net", "SystemTime", "Instant"];
    forbid("src/machine/replay", &outer, &[], "a replay reads a recording and counts");
}

#[test]
fn faults_are_planned_here_and_carried_out_elsewhere() {
    let impure = ["tokio", "std::net", "std::fs", "std::process", "SystemTime", "Instant", "getrandom", "nix"];
    forbid("src/cluster/chaos", &impure, &[], "a schedule gets the time and the list of processes");
    forbid(
        "src/cluster/chaos",
        &["cluster::processes", "cluster::protocol", "program::cli"],
        &[],
        "a schedule knows no process",
    );
}

#[test]
fn studies_replay_and_start_nothing() {
    let outer = ["cluster::processes", "program::cli", "std::net", "SystemTime", "Instant"];
    forbid("src/program/study", &outer, &[], "a study is a function of its scenes");
}

#[test]
fn no_process_imports_another() {
    let processes = ["manager", "master", "node", "bus", "display", "player"];
    for process in processes {
        let others: Vec<String> = processes
            .into_iter()
            .filter(|other| *other != process)
            .map(|other| format!("cluster::processes::{other}"))
            .collect();
        let others: Vec<&str> = others.iter().map(String::as_str).collect();
        forbid(
            &format!("src/cluster/processes/{process}"),
            &others,
            &[],
            "processes share meaning through protocol alone",
        );
    }
}

#[test]
fn the_simulation_has_no_clock_and_nobody_knows_of_it() {
    let real = ["tokio", "mio", "TcpStream", "Instant", "SystemTime", "std::fs", "std::thread", "std::process"];
    forbid("src/cluster/processes/simulation", &real, &[], "time, network and processes of a simulation are numbers");
    forbid(
        "src",
        &["cluster::processes::simulation"],
        &["src/cluster/processes/simulation"],
        "a process does not know that it is simulated",
    );
}

#[test]
fn each_foreign_thing_has_its_place() {
    forbid("src", &["bincode"], &["src/cluster/protocol/frame.rs"], "the wire codec is named in one file");
    forbid(
        "src",
        &["tokio"],
        &["src/cluster/protocol", "src/cluster/processes"],
        "only protocol, processes and bin are async",
    );
    forbid("src", &["arrow_"], &["src/machine/recording"], "only recordings are Arrow");
    forbid(
        "src",
        &["rustls"],
        &["src/cluster/protocol/connection", "src/cluster/keys"],
        "only connections speak TLS, only keys are certified",
    );
    forbid("src", &["rcgen"], &["src/cluster/keys"], "certificates are made in one folder");
    forbid("src", &["toml"], &["src/cluster/topology"], "only topologies are TOML");
    forbid("src", &[".mul_add"], &[], "a fused multiply-add gives other bits on other hosts");
}

#[test]
fn nothing_panics_where_standard_error_a_thread_or_a_descriptor_is_missing() {
    // And what does not: outlet::say and cli::print, thread::Builder and event_queue::aside, event_queue::event_queue.
    let panicking = ["eprintln!", "eprint!", "println!", "print!", "scope.spawn", ".spawn_blocking", ".lookup_host"];
    let threads = ["std::thread::spawn", "thread::spawn"];
    let words: Vec<&str> = panicking.into_iter().chain(threads).collect();
    let why = "it may panic";
    forbid("src", &words, &[], why);
    forbid("src", &[".new_current_thread"], &["src/cluster/processes/event_queue.rs"], why);
    for program in programs() {
        let found = breaches(&[program], "bin", &words, &[]);
        assert!(found.is_empty(), "{why}: {found:?}");
    }
}

/// The five programs' files.
fn programs() -> Vec<SourceFile> {
    let entries = fs::read_dir(project().join("bin")).expect("a readable folder").map(|entry| entry.expect("an entry"));
    let paths = entries.map(|entry| Path::new("bin").join(entry.file_name()));
    resolve(paths.map(|path| crate_files(project(), "program", &path).remove(0)).collect())
}

#[test]
fn no_spelling_hides_what_is_named() {
    let programs = programs();
    let hidden = |file: &SourceFile| {
        let found = file.hidden.iter().map(|(line, what)| format!("{}:{line} has {what}", file.path.display()));
        found.collect::<Vec<_>>()
    };
    let found: Vec<String> = LIBRARY.iter().chain(&programs).flat_map(hidden).collect();
    assert!(found.is_empty(), "the other rules cannot follow it:\n{}", found.join("\n"));
}

#[test]
fn main_functions_are_short_and_files_have_one_noun() {
    for program in programs() {
        assert!(program.lines < 40, "{} has 40 lines or more", program.path.display());
    }
    for SourceFile { path, lines, .. } in LIBRARY.iter() {
        assert!(*lines <= 500 || path.ends_with("teapot_patches.rs"), "{} has {lines} lines", path.display());
    }
}
