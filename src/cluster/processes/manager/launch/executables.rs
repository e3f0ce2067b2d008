//! The other programs, in the folder of this one.

use std::path::{Path, PathBuf};

use crate::processes::manager::process::ProcessId;

const PROGRAMS: [&str; 4] = ["marti-bus", "marti-display", "marti-master", "marti-node"];

#[derive(Clone, Debug)]
pub(in crate::processes::manager) struct Executables {
    folder: PathBuf,
}

#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{} is missing in {}; `cargo build --release` builds it, and all programs of marti belong into one folder",
        missing.join(" and "), folder.display())]
pub struct MissingExecutable {
    missing: Vec<String>,
    folder: PathBuf,
}

impl Executables {
    /// # Errors
    /// One of them is not there.
    pub(in crate::processes::manager) fn beside_this_one() -> Result<Self, MissingExecutable> {
        let this = std::env::current_exe().unwrap_or_default();
        Self::in_folder(this.parent().unwrap_or(Path::new(".")))
    }

    fn in_folder(folder: &Path) -> Result<Self, MissingExecutable> {
        let executables = Self { folder: folder.to_owned() };
        let missing: Vec<_> = PROGRAMS.into_iter().map(file_name).filter(|name| !folder.join(name).is_file()).collect();
        if missing.is_empty() { Ok(executables) } else { Err(MissingExecutable { missing, folder: folder.to_owned() }) }
    }

    /// The path of its program, in that folder if one is named; for a launcher, which takes text.
    pub(in crate::processes::manager) fn path(&self, process: ProcessId, folder: Option<&str>) -> String {
        let folder = folder.map_or(self.folder.as_path(), Path::new);
        folder.join(file_name(process.program())).to_string_lossy().into_owned()
    }
}

fn file_name(program: &str) -> String {
    format!("{program}{}", std::env::consts::EXE_SUFFIX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        for name in ["marti-bus", "marti-master", "marti-node"] {
            std::fs::write(folder.path().join(file_name(name)), "").expect("writable folder");
        }
        let error = Executables::in_folder(folder.path()).expect_err("no display").to_string();
        assert!(error.starts_with("marti-display is missing in ") && error.contains("cargo build"), "{error}");
        std::fs::write(folder.path().join(file_name("marti-display")), "").expect("writable folder");
        assert!(Executables::in_folder(folder.path()).is_ok());
    }
}
