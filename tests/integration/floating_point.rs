//! A floating-point environment that could change the image is refused by each of the programs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::command::{TEAPOT, stderr};
use crate::preload;

const PROGRAMS: [(&str, &[&str]); 7] = [
    (env!("CARGO_BIN_EXE_marti"), &["render", "teapot:2", "--size", "8x8", "-o", "x.png", "--quiet"]),
    (env!("CARGO_BIN_EXE_marti"), &["verify", "teapot:2", "--rays", "10"]),
    (env!("CARGO_BIN_EXE_marti"), &["run", TEAPOT, "--out", "out", "--quiet"]),
    (env!("CARGO_BIN_EXE_marti-bus"), &[]),
    (env!("CARGO_BIN_EXE_marti-master"), &[]),
    (env!("CARGO_BIN_EXE_marti-node"), &[]),
    (env!("CARGO_BIN_EXE_marti-display"), &[]),
];

/// A library whose constructor does this to every process that loads it.
fn library(folder: &Path, set: &str) -> Option<PathBuf> {
    let source = format!("#include <fenv.h>\n__attribute__((constructor)) static void set(void) {{ {set} }}\n");
    preload::object(folder, &source, "a floating-point environment")
}

/// Exit code and standard error.
fn play(program: &str, arguments: &[&str], library: &Path, folder: &Path) -> (Option<i32>, String) {
    let topology = Path::new(env!("CARGO_MANIFEST_DIR")).join(TEAPOT);
    let arguments =
        arguments.iter().map(|argument| if *argument == TEAPOT { topology.as_os_str() } else { argument.as_ref() });
    let mut command = Command::new(program);
    command.args(arguments).current_dir(folder).env("LD_PRELOAD", library).stdin(Stdio::null());
    let output = command.output().expect("it can be started");
    (output.status.code(), stderr(&output))
}

#[test]
fn another_rounding_or_no_subnormals_are_refused_with_exit_1() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let rounding = ["FE_UPWARD", "FE_DOWNWARD", "FE_TOWARDZERO"]
        .map(|mode| (format!("fesetround({mode});"), "rounded to the nearest"));
    let mut cases = rounding.to_vec();
    if cfg!(target_arch = "x86_64") {
        for bit in ["0x8000", "0x0040"] {
            let set = format!("__builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | {bit});");
            cases.push((set, "below the normal range are taken for zero"));
        }
    }
    for (set, told) in cases {
        let Some(library) = library(folder.path(), &set) else { return };
        for (program, arguments) in PROGRAMS {
            let (code, said) = play(program, arguments, &library, folder.path());
            assert_eq!(code, Some(1), "{set} {program} {arguments:?}: {said}");
            assert!(said.starts_with("error: the floating-point environment") && said.contains(told), "{set}: {said}");
        }
        assert!(
            !folder.path().join("out").exists() && !folder.path().join("x.png").exists(),
            "{set}: nothing is touched"
        );
    }
}

#[test]
fn a_library_that_leaves_the_default_is_not_refused() {
    let folder = tempfile::tempdir().expect("temporary folder");
    // Of x87, which no code here uses on this architecture, the precision does not matter.
    let set = if cfg!(target_arch = "x86_64") {
        "unsigned short word = 0x007f; __asm__ volatile(\"fldcw %0\" : : \"m\"(word));"
    } else {
        "fesetround(FE_TONEAREST);"
    };
    let Some(library) = library(folder.path(), set) else { return };
    let render = |name: &str, library: &Path| {
        let arguments = ["render", "teapot:3", "--size", "32x32", "--quiet", "--report", name];
        let (code, said) = play(env!("CARGO_BIN_EXE_marti"), &arguments, library, folder.path());
        assert_eq!(code, Some(0), "{said}");
        let report = fs::read_to_string(folder.path().join(name)).expect("a report");
        serde_json::from_str::<serde_json::Value>(&report).expect("JSON")["image"]["sha256"].clone()
    };
    assert_eq!(render("with.json", &library), render("without.json", Path::new("")));
}
