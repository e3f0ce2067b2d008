//! Instruction counts of the hot paths, compared with those that are recorded: counts, not times, so that one percent shows.
//!
//! ```text
//! just instructions                        compares; more than 1% off is an error
//! just instructions-record "the reason"    records anew
//! ```
//!
//! Each path runs by itself under callgrind, which collects inside of the path's function alone. Only instructions of this
//! program are compared, none of the C library's, which has other code for other processors. Another compiler makes other code:
//! then differences are reported, and are no error.

mod callgrind;
mod paths;
mod recorded;

use std::env;
use std::fs;
use std::process::{Command, ExitCode};

use self::paths::{PATHS, Path};
use self::recorded::{Count, Recorded, TOLERANCE};

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let outcome = match arguments[..] {
        ["--path", name] => run_alone(name),
        ["--record", reason] if !reason.is_empty() => count_all().and_then(|counts| record(counts, reason)),
        // `cargo test --benches` runs each bench with this.
        ["--test"] => Ok(()),
        [] => count_all().and_then(|counts| compare(&counts)),
        _ => Err("expected no arguments, or --record REASON".to_owned()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn run_alone(name: &str) -> Result<(), String> {
    let path = PATHS.iter().find(|path| path.name == name).ok_or_else(|| format!("no path is called {name}"))?;
    println!("{}", (path.run)());
    Ok(())
}

/// Every path that this host can count; none where there is no valgrind.
fn count_all() -> Result<Vec<Count>, String> {
    if Command::new("valgrind").arg("--version").output().is_err() {
        println!(
            "SKIPPED: no instructions are counted, since there is no valgrind here (Debian: apt install valgrind)"
        );
        return Ok(Vec::new());
    }
    let mut counts = Vec::new();
    for path in &PATHS {
        if !(path.is_possible)() {
            println!("SKIPPED: {}: this processor lacks AVX2", path.name);
            continue;
        }
        counts.push(count(path)?);
    }
    Ok(counts)
}

fn count(path: &Path) -> Result<Count, String> {
    let this = env::current_exe().map_err(|error| error.to_string())?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let file = folder.path().join("counts");
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--quiet"])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(format!("--toggle-collect=*paths::{}*", path.name))
        .arg(&this)
        .args(["--path", path.name])
        .output()
        .map_err(|error| format!("valgrind: {error}"))?;
    let said = String::from_utf8_lossy(&output.stdout);
    let failed = |what: &str| format!("{}: {what}: {}", path.name, String::from_utf8_lossy(&output.stderr));
    if !output.status.success() {
        return Err(failed("valgrind failed"));
    }
    let units: u64 = said.trim().parse().map_err(|_| failed("it does not print its number of units"))?;
    let text = fs::read_to_string(&file).map_err(|error| failed(&error.to_string()))?;
    let instructions = callgrind::instructions_of(&text, &this)?;
    if instructions == 0 || units == 0 {
        return Err(failed("nothing was counted"));
    }
    Ok(Count { path: path.name.to_owned(), unit: path.unit.to_owned(), units, instructions })
}

fn record(counts: Vec<Count>, reason: &str) -> Result<(), String> {
    if counts.len() < PATHS.len() {
        return Err("only a host that can count every path can record".to_owned());
    }
    let recorded = Recorded { reason: reason.to_owned(), compiler: compiler()?, counts };
    write(&recorded)?;
    println!("{}recorded with {}", recorded::table(&recorded.counts, None), recorded.compiler);
    Ok(())
}

/// # Errors
/// The file cannot be written.
fn write(recorded: &Recorded) -> Result<(), String> {
    let file = recorded::file();
    let text = toml::to_string(recorded).map_err(|error| error.to_string())?;
    let head = "# Written by `just instructions-record REASON`; docs/performance.md.\n";
    fs::write(&file, format!("{head}{text}")).map_err(|error| format!("{}: {error}", file.display()))
}

/// The compiler that cargo uses here.
///
/// # Errors
/// There is none.
fn compiler() -> Result<String, String> {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let output = Command::new(&rustc).arg("--version").output().map_err(|error| format!("{rustc}: {error}"))?;
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn compare(counts: &[Count]) -> Result<(), String> {
    if counts.is_empty() {
        return Ok(());
    }
    let recorded = Recorded::read()?;
    print!("{}", recorded::table(counts, Some(&recorded)));
    let off = recorded.off(counts);
    let compiler = compiler()?;
    if compiler != recorded.compiler {
        println!("compiled by {compiler}, recorded with {}: differences are no error", recorded.compiler);
    } else if !off.is_empty() {
        return Err(format!(
            "more than {} % off what is recorded: {}; if that is meant, `just instructions-record REASON`",
            100.0 * TOLERANCE,
            off.join(", ")
        ));
    }
    Ok(())
}
