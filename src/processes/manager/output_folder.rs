//! `--out DIR`: what a run writes, and where.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::atomic_file;
use crate::recording::bus_log;
use crate::topology::Topology;

/// The resolved topology.
pub(super) const TOPOLOGY_NAME: &str = "topology.toml";

/// The display's journal.
pub(super) fn journal(out: &Path) -> PathBuf {
    out.join("tiles")
}

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
        folder.make()?;
        let mut recordings = vec![folder.recording()];
        recordings
            .extend(bus_log::inner_folders(&folder.recording()).map_err(|error| named(&folder.recording(), &error))?);
        recordings.iter().try_for_each(|recording| remove(recording, is_ours_in_recording))?;
        remove(&folder.logs(), |name| name.ends_with(".log"))?;
        remove(&folder.root, is_ours_in_root)?;
        folder.write_topology(topology)?;
        Ok(folder)
    }

    /// Puts recording, logs and report of an earlier run aside, into `earlier/1` or the next number that is free, and
    /// leaves its journal.
    ///
    /// # Errors
    /// As [`Self::prepare`]'s.
    pub(super) fn resume(root: &Path, topology: &Topology) -> io::Result<Self> {
        let folder = Self { root: root.to_owned() };
        let aside = |number: u32| folder.root.join("earlier").join(number.to_string());
        // Each number stands for a run.
        let aside = (1..=u32::MAX).map(aside).find(|path| !path.exists()).unwrap_or_else(|| aside(u32::MAX));
        fs::create_dir_all(&aside).map_err(|error| named(&aside, &error))?;
        for path in [folder.recording(), folder.logs(), folder.report()] {
            let to = aside.join(path.file_name().unwrap_or_default());
            match fs::rename(&path, &to) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(named(&path, &error)),
                _ => {}
            }
        }
        folder.make()?;
        folder.write_topology(topology)?;
        Ok(folder)
    }

    fn make(&self) -> io::Result<()> {
        for path in [self.root.clone(), self.recording(), self.logs()] {
            fs::create_dir_all(&path).map_err(|error| named(&path, &error))?;
        }
        Ok(())
    }

    fn write_topology(&self, topology: &Topology) -> io::Result<()> {
        let toml = topology.to_toml().map_err(io::Error::other)?;
        atomic_file::write(&self.root.join(TOPOLOGY_NAME), |file| io::Write::write_all(file, toml.as_bytes()))
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

fn is_ours_in_recording(name: &str) -> bool {
    ["bus.", "references", "octree-levels."].iter().any(|ours| name.starts_with(ours))
}

/// Image files, the report, the topology, the journal, and parts of them that were cut short.
fn is_ours_in_root(name: &str) -> bool {
    let name = name.strip_suffix(".part").unwrap_or(name);
    let image = ["png", "t.npy", "n.npy", "prim.npy", "exr"];
    let is_image = name.strip_prefix("image.").is_some_and(|extension| image.contains(&extension));
    is_image || ["report.json", "tiles", "join.token", TOPOLOGY_NAME].contains(&name)
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
        fs::create_dir_all(path("recording/cluster-1/epoch-2")).expect("writable folder");
        let inner = "recording/cluster-1/epoch-2/bus.arrows";
        let stale = ["image.png", "image.prim.npy", "report.json", "report.json.part", "tiles", "logs/bus.log", inner];
        let others = ["notes.txt", "image.jpg", "my-image.png", "logs/notes.txt"];
        for name in stale.into_iter().chain(others) {
            fs::write(path(name), "x").expect("writable folder");
        }
        let topology = Topology::read(Path::new("topologies/teapot.toml"), &[]).expect("a topology of this project");
        OutputFolder::prepare(folder.path(), &topology).expect("writable folder");
        assert_eq!(stale.map(|name| path(name).exists()), [false; 7]);
        assert_eq!(others.map(|name| path(name).exists()), [true; 4]);
        let written = Topology::read(&path("topology.toml"), &[]).expect("reads back");
        assert_eq!(written.cluster, topology.cluster);
    }

    #[test]
    fn what_an_interrupted_run_recorded_is_put_aside_and_its_journal_stays() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        let topology = Topology::read(Path::new("topologies/teapot.toml"), &[]).expect("a topology of this project");
        OutputFolder::prepare(folder.path(), &topology).expect("writable folder");
        for number in 1..3 {
            for name in ["recording/bus.arrows", "logs/bus.log", "tiles"] {
                fs::write(path(name), number.to_string()).expect("writable folder");
            }
            OutputFolder::resume(folder.path(), &topology).expect("writable folder");
            for name in ["recording/bus.arrows", "logs/bus.log"] {
                assert!(!path(name).exists());
                let aside = fs::read_to_string(path(&format!("earlier/{number}/{name}"))).expect("put aside");
                assert_eq!(aside, number.to_string());
            }
            assert!(path("tiles").exists());
        }
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
