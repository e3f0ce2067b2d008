//! The commands of the documents, run in their order as they are printed; their outputs compared where they are stable.
//! Commands that are not run are listed in `tests/data/commands-not-run.toml`, with the reason.

use std::collections::BTreeSet;
use std::fs;
use std::iter;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use serde::Deserialize;

const DOCUMENTS: [&str; 3] = ["README.md", "docs/command-line.md", "docs/topology.md"];
const PROGRAMS: [&str; 3] = ["marti ", "cargo ", "("];
/// What of a command has been done when the tests run.
const BUILT: &str = "cargo build --release && ./target/release/";
/// Lines of a summary whose numbers depend on which node was first, and on the time.
const VARYING: [&str; 5] = ["rays", "memory", "ratios", "bus", "seconds"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NotRun {
    command: Vec<Reason>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Reason {
    line: String,
    why: String,
    last_run: String,
}

/// An indented block of a document.
enum Block {
    Commands(Vec<String>),
    Output(Vec<String>),
}

fn blocks(document: &str) -> Vec<Block> {
    let text = fs::read_to_string(project().join(document)).expect("a document");
    let mut blocks: Vec<Vec<&str>> = Vec::new();
    let mut is_within = false;
    for line in text.lines() {
        match line.strip_prefix("    ") {
            Some(line) if is_within => blocks.last_mut().expect("begun").push(line),
            Some(line) => blocks.push(vec![line]),
            None if line.is_empty() && is_within => {
                blocks.last_mut().expect("begun").push("");
                continue;
            }
            None => {}
        }
        is_within = line.starts_with("    ");
    }
    blocks.into_iter().flat_map(|lines| parts(lines.join("\n").trim_end())).collect()
}

/// Commands end with the first empty line: what is indented after it is what the last of them prints, or more commands.
fn parts(text: &str) -> Vec<Block> {
    match text.split_once("\n\n") {
        Some((first, rest)) if is_command(first) => iter::once(block(first)).chain(parts(rest)).collect(),
        _ => vec![block(text)],
    }
}

fn is_command(text: &str) -> bool {
    PROGRAMS.iter().any(|program| text.starts_with(program))
}

fn block(text: &str) -> Block {
    if !is_command(text) {
        return Block::Output(text.lines().map(str::to_owned).collect());
    }
    let commands = text.replace("\\\n", " ");
    let without_comment = |line: &str| line.split("   # ").next().unwrap_or(line).trim().replace(BUILT, "");
    Block::Commands(commands.lines().map(without_comment).filter(|line| !line.is_empty()).collect())
}

fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// What of a line of output does not vary.
fn stable(line: &str) -> String {
    let is_varying = VARYING.iter().any(|name| line.starts_with(name));
    let digits = |digit: char| if is_varying && digit.is_ascii_digit() { '#' } else { digit };
    let masked: String = line.trim_end().chars().map(digits).collect();
    masked
        .split('#')
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join("#")
        .replace("#,#", "#")
        .replace("#.#", "#")
}

#[test]
fn every_command_of_the_documents_runs_as_it_is_printed() {
    let not_run = fs::read_to_string(project().join("tests/data/commands-not-run.toml")).expect("the list");
    let not_run: NotRun = toml::from_str(&not_run).expect("a list of commands");
    let mut unused: BTreeSet<&str> = not_run.command.iter().map(|reason| reason.line.as_str()).collect();
    assert!(not_run.command.iter().all(|reason| !reason.why.is_empty() && reason.last_run.len() == "2026-11-27".len()));

    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("temporary folder");
    for name in ["topologies", "scenes", "docs"] {
        symlink(project().join(name), folder.path().join(name)).expect("a link");
    }
    let programs = Path::new(env!("CARGO_BIN_EXE_marti")).parent().expect("a folder");
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").expect("a path"));
    for document in DOCUMENTS {
        let mut printed = None;
        for block in blocks(document) {
            match block {
                Block::Commands(commands) => {
                    for line in commands {
                        if not_run.command.iter().any(|reason| reason.line == line) {
                            unused.remove(line.as_str());
                            continue;
                        }
                        let mut command = Command::new("sh");
                        command
                            .args(["-c", &line])
                            .current_dir(folder.path())
                            .env("PATH", &path)
                            .env_remove("MARTI_LOG");
                        let output = command.output().expect("there is a shell");
                        let stderr = String::from_utf8_lossy(&output.stderr);
                        assert!(output.status.success(), "{document}: {line}: {}\n{stderr}", output.status);
                        printed = Some((line, String::from_utf8_lossy(&output.stdout).into_owned()));
                    }
                }
                Block::Output(expected) => {
                    let Some((line, output)) = printed.take() else { continue };
                    for expected in expected {
                        let is_printed = output.lines().any(|line| stable(line) == stable(&expected));
                        assert!(is_printed, "{document}: {line} does not print\n{expected}\nbut\n{output}");
                    }
                }
            }
        }
    }
    assert!(unused.is_empty(), "no document has these commands: {unused:?}");
}
