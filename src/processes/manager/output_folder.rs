//! `--out DIR`: what a run writes, and where.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::atomic_file;
use crate::topology::Topology;

#[derive(Debug)]
pub(super) struct OutputFolder {
    root: PathBuf,
}

impl OutputFolder {
    /// Makes the folder, takes away what an earlier run wrote there (and nothing else), and writes the resolved
    /// topology.
    ///
    /// # Errors
    /// Something cannot be made, removed or written; the error names it.
    pub(super) fn prepare(root: &Path, topology: &Topology) -> io::Result<Self> {
        let folder = Self { root: root.to_owned() };
        for path in [folder.root.clone(), folder.recording(), folder.logs()] {
            fs::create_dir_all(&path).map_err(|error| named(&path, &error))?;
        }
        for (path, is_ours) in [
            (&folder.root, is_ours_in_root as fn(&str) -> bool),
            (&folder.recording(), |name| {
                ["bus.", "references", "octree-levels."].iter().any(|ours| name.starts_with(ours))
            }),
            (&folder.logs(), |name| name.ends_with(".log")),
        ] {
            remove(path, is_ours)?;
        }
        let toml = topology.to_toml().map_err(io::Error::other)?;
        atomic_file::write(&folder.root.join("topology.toml"), |file| io::Write::write_all(file, toml.as_bytes()))?;
        Ok(folder)
    }

    pub(super) fn image(&self) -> PathBuf {
        self.root.join("image.png")
    }

    pub(super) fn report(&self) -> PathBuf {
        self.root.join("report.json")
    }

    /// What a process needs to join without keys: the run's token, for its owner alone.
    pub(super) fn join_token(&self) -> PathBuf {
        self.root.join("join.token")
    }

    /// The display's journal.
    pub(super) fn journal(&self) -> PathBuf {
        self.root.join("tiles")
    }

    pub(super) fn recording(&self) -> PathBuf {
        self.root.join("recording")
    }

    pub(super) fn logs(&self) -> PathBuf {
        self.root.join("logs")
    }

    pub(super) fn log(&self, process: &str) -> PathBuf {
        self.logs().join(format!("{process}.log"))
    }
}

/// Image files, the report, the topology, and parts of them that were cut short.
fn is_ours_in_root(name: &str) -> bool {
    let name = name.strip_suffix(".part").unwrap_or(name);
    let image = ["png", "t.npy", "n.npy", "prim.npy", "exr"];
    let is_image = name.strip_prefix("image.").is_some_and(|extension| image.contains(&extension));
    is_image || ["report.json", "topology.toml", "join.token"].contains(&name)
}

fn remove(folder: &Path, is_ours: fn(&str) -> bool) -> io::Result<()> {
    for entry in fs::read_dir(folder).map_err(|error| named(folder, &error))? {
        let path = entry.map_err(|error| named(folder, &error))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if is_ours(&name) && path.is_file() {
            fs::remove_file(&path).map_err(|error| named(&path, &error))?;
        }
    }
    Ok(())
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_runs_files_go_and_others_stay() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("logs")).expect("writable folder");
        let stale = ["image.png", "image.prim.npy", "report.json", "report.json.part", "logs/bus.log"];
        let others = ["notes.txt", "image.jpg", "my-image.png", "logs/notes.txt"];
        for name in stale.into_iter().chain(others) {
            fs::write(path(name), "x").expect("writable folder");
        }
        let topology = Topology::read(Path::new("topologies/teapot.toml"), &[]).expect("a topology of this project");
        OutputFolder::prepare(folder.path(), &topology).expect("writable folder");
        assert_eq!(stale.map(|name| path(name).exists()), [false; 5]);
        assert_eq!(others.map(|name| path(name).exists()), [true; 4]);
        let written = Topology::read(&path("topology.toml"), &[]).expect("reads back");
        assert_eq!(written.cluster, topology.cluster);
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let file = folder.path().join("file");
        fs::write(&file, "x").expect("writable folder");
        let topology = Topology::read(Path::new("topologies/teapot.toml"), &[]).expect("a topology of this project");
        let error = OutputFolder::prepare(&file.join("out"), &topology).expect_err("below a file");
        assert!(error.to_string().contains("file/out"), "{error}");
    }
}
