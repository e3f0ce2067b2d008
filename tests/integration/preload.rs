//! Shared objects that a process finds loaded into it (LD_PRELOAD), made by this host's C compiler.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The object of a C source; `None` after saying loudly that a test cannot run without a C compiler.
pub(crate) fn object(folder: &Path, source: &str, test: &str) -> Option<PathBuf> {
    let (input, object) = (folder.join("preload.c"), folder.join("preload.so"));
    fs::write(&input, source).expect("writable folder");
    let compiled = Command::new("cc").args(["-shared", "-fPIC", "-o"]).args([&object, &input]).arg("-lm").output();
    match compiled {
        Ok(output) if output.status.success() => Some(object),
        Ok(output) => panic!("{test}: cc: {}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => {
            eprintln!("SKIPPED {test}: cc: {error}");
            None
        }
    }
}
