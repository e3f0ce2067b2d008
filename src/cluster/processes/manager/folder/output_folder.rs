//! `--out DIR`: what a run writes, and where.
//!
//! The folder is one run's from [`OutputFolder::open`] on. What earlier runs left there stays as it is until
//! [`OutputFolder::begin`]; until then this run's files are in `starting`. Where nothing is in the way, they are at their
//! place from the start.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::journal::Journal;
use crate::processes::folder_claim::{ClaimError, EARLIER, FolderClaim, named};
use crate::report::json;
use crate::topology::Topology;
use ground::atomic_file;
use ground::regular_file;

/// The resolved topology.
pub(in crate::processes::manager) const TOPOLOGY_NAME: &str = "topology.toml";
/// How a resolved topology begins: by it the folder of a run is known.
const RESOLVED: &str = "# Resolved by marti run\n";
const STARTING: &str = "starting";
const JOURNAL_NAME: &str = "tiles";
const REPORT_NAME: &str = "report.json";
const TOKEN_NAME: &str = "join.token";
/// What a run writes, besides the journal.
const RESULTS: [&str; 9] = [
    "image.png",
    "image.t.npy",
    "image.n.npy",
    "image.prim.npy",
    "image.exr",
    REPORT_NAME,
    TOPOLOGY_NAME,
    "recording",
    "logs",
];

/// The display's journal.
pub(in crate::processes::manager) fn journal(out: &Path) -> PathBuf {
    out.join(JOURNAL_NAME)
}

/// The report of a run that has ended.
pub(in crate::processes::manager) fn report(out: &Path) -> PathBuf {
    out.join(REPORT_NAME)
}

/// SHA-256 of the image file, in hexadecimal; `None` where there is none.
pub(in crate::processes::manager) fn image_sha256(out: &Path) -> Option<String> {
    let mut file = regular_file::open(&out.join("image.png")).ok()?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).ok()? {
            0 => break,
            bytes => hash.update(&buffer[..bytes]),
        }
    }
    Some(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// What is to become of what the folder holds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in crate::processes::manager) enum Opening {
    /// It is put aside; without `force` nothing may be there that no run wrote.
    Anew { force: bool },
    /// The same, but for the journal.
    Resume,
}

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error(transparent)]
    Claim(#[from] ClaimError),
    #[error("{}: is not empty ({entry}) and holds nothing that says that a run wrote it: expected another folder, or --force", root.display())]
    Foreign { root: PathBuf, entry: String },
    #[error("{}: is not UTF-8, expected a name that is", .0.display())]
    NotUnicode(PathBuf),
}

impl From<io::Error> for OutputError {
    fn from(error: io::Error) -> Self {
        Self::Claim(error.into())
    }
}

#[derive(Debug)]
pub(in crate::processes::manager) struct OutputFolder {
    root: PathBuf,
    claim: FolderClaim,
    keeps_journal: bool,
    stage: Stage,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Stage {
    /// Nothing is worth keeping yet, and nothing of an earlier run is in the way.
    Fresh,
    /// Nothing is worth keeping yet, and results of an earlier run are in the way.
    Starting,
    Begun,
    /// It came to its end before it had begun.
    Failed,
}

impl OutputFolder {
    /// Makes the folder if need be, locks it, and prepares the place for topology and logs.
    ///
    /// # Errors
    /// Another process writes into it, no run wrote what it holds, or something cannot be made; the error names it.
    pub(in crate::processes::manager) fn open(
        root: &Path,
        topology: &Topology,
        opening: Opening,
    ) -> Result<Self, OutputError> {
        if root.to_str().is_none() {
            return Err(OutputError::NotUnicode(root.to_owned()));
        }
        let claim = FolderClaim::take(root)?;
        if opening != (Opening::Anew { force: true })
            && let Some(entry) = foreign_entry(root)?
        {
            return Err(OutputError::Foreign { root: root.to_owned(), entry });
        }
        let keeps_journal = opening == Opening::Resume;
        let mut folder = Self { root: root.to_owned(), claim, keeps_journal, stage: Stage::Fresh };
        // Of a run that was killed before it had begun.
        folder.claim.put_aside(STARTING)?;
        if folder.results().any(|name| fs::symlink_metadata(root.join(name)).is_ok()) {
            folder.stage = Stage::Starting;
        }
        make(&folder.place())?;
        let toml = topology.to_toml().map_err(io::Error::other)?;
        atomic_file::write(&folder.place().join(TOPOLOGY_NAME), |file| {
            file.write_all(RESOLVED.as_bytes())?;
            file.write_all(toml.as_bytes())
        })?;
        make(&folder.logs())?;
        Ok(folder)
    }

    /// Puts aside what an earlier run wrote, into `earlier/N`, and moves `starting` to its place. Log files that are open
    /// stay open.
    ///
    /// # Errors
    /// Something cannot be moved; the error names it.
    pub(in crate::processes::manager) fn begin(&mut self) -> io::Result<()> {
        for entry in fs::read_dir(&self.root).map_err(|error| named(&self.root, &error))? {
            let entry = entry.map_err(|error| named(&self.root, &error))?;
            let name = entry.file_name();
            let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
            if name.to_str().is_some_and(is_unfinished) && is_file {
                self.claim.put_aside(&name.to_string_lossy())?;
            }
        }
        if self.stage == Stage::Starting {
            self.replace_results()?;
        }
        make(&self.recording())?;
        self.stage = Stage::Begun;
        Ok(())
    }

    fn replace_results(&mut self) -> io::Result<()> {
        for name in self.results().filter(|name| *name != TOPOLOGY_NAME) {
            self.claim.put_aside(name)?;
        }
        // What `--resume` reads is there at any moment: the earlier topology until the new one takes its place.
        self.claim.keep_aside(TOPOLOGY_NAME)?;
        let starting = self.starting();
        for name in ["logs", TOPOLOGY_NAME] {
            let path = starting.join(name);
            fs::rename(&path, self.root.join(name)).map_err(|error| named(&path, &error))?;
        }
        fs::remove_dir_all(&starting).map_err(|error| named(&starting, &error))
    }

    /// The run is over, and its report says so, even if it has not begun.
    pub(in crate::processes::manager) fn end(&mut self) {
        self.stage = match self.stage {
            Stage::Fresh | Stage::Begun => Stage::Begun,
            Stage::Starting | Stage::Failed => Stage::Failed,
        };
    }

    /// Where logs and report are of a run that ended before it had begun, with results of an earlier run in the way.
    pub(in crate::processes::manager) fn failed_start(&self) -> Option<PathBuf> {
        (self.stage == Stage::Failed).then(|| self.starting())
    }

    /// Whether something of an earlier run was moved.
    pub(in crate::processes::manager) fn has_put_aside(&self) -> bool {
        self.claim.has_put_aside()
    }

    /// That the folder could not be locked, if so.
    pub(in crate::processes::manager) fn warning(&self) -> Option<String> {
        self.claim.warning()
    }

    fn results(&self) -> impl Iterator<Item = &'static str> + use<> {
        RESULTS.into_iter().chain((!self.keeps_journal).then_some(JOURNAL_NAME))
    }

    fn starting(&self) -> PathBuf {
        self.root.join(STARTING)
    }

    /// Where logs and report are.
    fn place(&self) -> PathBuf {
        match self.stage {
            Stage::Fresh | Stage::Begun => self.root.clone(),
            Stage::Starting | Stage::Failed => self.starting(),
        }
    }

    pub(in crate::processes::manager) fn image(&self) -> PathBuf {
        self.root.join("image.png")
    }

    pub(in crate::processes::manager) fn report(&self) -> PathBuf {
        report(&self.place())
    }

    /// What a process needs to join without keys: the run's token, for its owner alone.
    pub(in crate::processes::manager) fn join_token(&self) -> PathBuf {
        self.root.join(TOKEN_NAME)
    }

    pub(in crate::processes::manager) fn recording(&self) -> PathBuf {
        self.root.join("recording")
    }

    pub(in crate::processes::manager) fn logs(&self) -> PathBuf {
        self.place().join("logs")
    }
}

/// A run that was refused leaves nothing behind.
impl Drop for OutputFolder {
    fn drop(&mut self) {
        // Errors cannot be helped; the next run puts aside what is left.
        match self.stage {
            Stage::Begun | Stage::Failed => {}
            Stage::Starting => drop(fs::remove_dir_all(self.starting())),
            Stage::Fresh => {
                let _ = fs::remove_dir_all(self.logs());
                let _ = fs::remove_file(self.root.join(TOPOLOGY_NAME));
                self.claim.withdraw();
            }
        }
    }
}

fn make(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder).map_err(|error| named(folder, &error))
}

/// Whether a run that was killed may have been about to write this file.
fn is_unfinished(name: &str) -> bool {
    atomic_file::unfinished(name).is_some_and(|name| name == TOKEN_NAME || RESULTS.contains(&name))
}

/// The name of something in the folder, unless a run wrote into it or it is empty.
fn foreign_entry(root: &Path) -> io::Result<Option<String>> {
    let is_resolved = |folder: &Path| {
        let mut begin = vec![0; RESOLVED.len()];
        let read = regular_file::open(&folder.join(TOPOLOGY_NAME)).and_then(|mut file| file.read_exact(&mut begin));
        read.is_ok() && begin == RESOLVED.as_bytes()
    };
    if is_resolved(root)
        || is_resolved(&root.join(STARTING))
        || Journal::planes(&journal(root)).is_some()
        || json::is_report(&report(root))
    {
        return Ok(None);
    }
    for entry in fs::read_dir(root).map_err(|error| named(root, &error))? {
        let name = entry.map_err(|error| named(root, &error))?.file_name().to_string_lossy().into_owned();
        // A run that was killed early leaves no more than the first two; file systems make the third.
        if ![STARTING, EARLIER, "lost+found"].contains(&name.as_str()) && !is_unfinished(&name) {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixture;

    fn topology() -> Topology {
        Topology::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies/teapot.toml"), &[])
            .expect("a topology of this project")
    }

    const ANEW: Opening = Opening::Anew { force: false };

    fn begun(root: &Path, opening: Opening) -> OutputFolder {
        let mut folder = OutputFolder::open(root, &topology(), opening).expect("writable folder");
        folder.begin().expect("writable folder");
        folder
    }

    #[test]
    fn what_an_earlier_run_wrote_stays_until_the_next_one_begins_and_is_put_aside_then() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        drop(begun(folder.path(), ANEW));
        assert!(!path("earlier").exists(), "nothing was there");
        let inner = "recording/cluster-1/epoch-2/bus.arrows";
        fs::create_dir_all(path("recording/cluster-1/epoch-2")).expect("writable folder");
        let stale = ["image.png", "image.prim.npy", "report.json", "tiles", "logs/bus.log", inner];
        let others = ["notes.txt", "image.jpg", "my-image.png"];
        let part = "report.json.aB3dEf.part";
        for name in stale.into_iter().chain(others).chain([part]) {
            fs::write(path(name), name).expect("writable folder");
        }
        let mut next = OutputFolder::open(folder.path(), &topology(), ANEW).expect("writable folder");
        fs::write(next.logs().join("manager.log"), "new").expect("writable folder");
        assert!(stale.iter().chain(&others).all(|name| path(name).exists()), "not begun");
        next.begin().expect("writable folder");
        for name in stale {
            assert!(!path(name).exists(), "{name}");
            assert_eq!(fs::read_to_string(path("earlier/1").join(name)).expect("put aside"), name);
        }
        assert!(others.iter().all(|name| path(name).exists()) && !path(part).exists() && !path(STARTING).exists());
        assert_eq!(fs::read_to_string(path("logs/manager.log")).expect("moved"), "new");
        let written = Topology::read(&path("topology.toml"), &[]).expect("reads back");
        assert_eq!(written.cluster, topology().cluster);
    }

    #[test]
    fn a_run_that_is_resumed_keeps_its_journal() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        drop(begun(folder.path(), ANEW));
        for number in 1..3 {
            for name in ["recording/bus.arrows", "logs/bus.log", "tiles"] {
                fs::write(path(name), number.to_string()).expect("writable folder");
            }
            drop(begun(folder.path(), Opening::Resume));
            for name in ["recording/bus.arrows", "logs/bus.log"] {
                assert!(!path(name).exists());
                let aside = fs::read_to_string(path(&format!("earlier/{number}/{name}"))).expect("put aside");
                assert_eq!(aside, number.to_string());
            }
            assert!(path("tiles").exists());
        }
    }

    #[test]
    fn a_folder_that_no_run_wrote_is_refused_and_not_touched_unless_by_force() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("report.json"), r#"{"name": "of somebody else"}"#).expect("writable folder");
        for opening in [ANEW, Opening::Resume] {
            let refused = OutputFolder::open(folder.path(), &topology(), opening).expect_err("foreign").to_string();
            assert!(
                refused.contains("is not empty (report.json) and holds nothing that says that a run wrote it"),
                "{refused}"
            );
            assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
        }
        drop(begun(folder.path(), Opening::Anew { force: true }));
        assert!(path("earlier/1/report.json").exists());
    }

    #[test]
    fn the_folder_of_a_run_is_known_by_its_report_its_journal_or_its_topology() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("notes.txt"), "").expect("writable folder");
        assert!(OutputFolder::open(folder.path(), &topology(), ANEW).is_err());
        json::write(&fixture::report(), &path("report.json")).expect("writable folder");
        drop(OutputFolder::open(folder.path(), &topology(), ANEW).expect("a report"));
        fs::remove_file(path("report.json")).expect("there");
        fs::write(path("topology.toml"), RESOLVED).expect("writable folder");
        drop(OutputFolder::open(folder.path(), &topology(), ANEW).expect("a topology"));
        fs::write(path("topology.toml"), "[scene]\nprocedural = \"teapot\"").expect("writable folder");
        assert!(OutputFolder::open(folder.path(), &topology(), ANEW).is_err(), "a person wrote it");
    }

    #[test]
    fn a_run_that_is_killed_at_any_step_leaves_a_folder_that_the_next_one_takes() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path(STARTING)).expect("writable folder");
        drop(OutputFolder::open(folder.path(), &topology(), ANEW).expect("an empty start"));
        fs::write(path("report.json"), r#"{"schema_version": 1}"#).expect("writable folder");
        std::mem::forget(OutputFolder::open(folder.path(), &topology(), ANEW).expect("a run's"));
        // The lock is still held by what was forgotten: another name of the same bytes.
        let copy = tempfile::tempdir().expect("temporary folder");
        fs::rename(path(STARTING), copy.path().join(STARTING)).expect("writable folder");
        fs::write(copy.path().join("notes.txt"), "").expect("writable folder");
        let next = begun(copy.path(), ANEW);
        assert!(copy.path().join("earlier/1/starting/topology.toml").exists());
        assert_eq!(next.failed_start(), None);
    }

    /// What `--resume` begins with is never gone, whatever step fails or is the last.
    #[test]
    fn a_beginning_that_stops_halfway_leaves_a_topology_and_the_journal_to_resume() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        let earlier = format!("{RESOLVED}# the earlier one");
        fs::write(path(TOPOLOGY_NAME), &earlier).expect("writable folder");
        for name in ["report.json", "tiles", "image.png"] {
            fs::write(path(name), name).expect("writable folder");
        }
        let mut next = OutputFolder::open(folder.path(), &topology(), Opening::Resume).expect("a run's");
        fs::remove_dir_all(path("starting/logs")).expect("there");
        next.begin().expect_err("the logs cannot be moved");
        assert!(next.has_put_aside());
        assert_eq!(fs::read_to_string(path(TOPOLOGY_NAME)).expect("there"), earlier);
        assert!(path("tiles").exists() && path("earlier/1/image.png").exists());
        drop(next);
        drop(begun(folder.path(), Opening::Resume));
        assert_ne!(fs::read_to_string(path(TOPOLOGY_NAME)).expect("there"), earlier);
        assert_eq!(fs::read_to_string(path("earlier/1/topology.toml")).expect("kept"), earlier);
    }

    #[test]
    fn files_of_others_that_look_unfinished_are_put_aside_and_folders_stay() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("image.png.backup.part"), "a person's").expect("writable folder");
        fs::create_dir(path("report.json.latest.part")).expect("writable folder");
        drop(begun(folder.path(), Opening::Anew { force: true }));
        let aside = fs::read_to_string(path("earlier/1/image.png.backup.part")).expect("not removed");
        assert_eq!(aside, "a person's");
        assert!(path("report.json.latest.part").is_dir());
    }

    #[test]
    fn a_run_that_was_refused_leaves_nothing_and_one_that_failed_its_report() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path().join("a/b");
        fs::write(folder.path().join("topology.toml.aB3dEf.part"), "").expect("writable folder");
        drop(OutputFolder::open(folder.path(), &topology(), ANEW).expect("what a killed run left"));
        drop(OutputFolder::open(&root, &topology(), ANEW).expect("writable folder"));
        assert!(!folder.path().join("a").exists());
        // Nothing is in the way.
        let mut first = OutputFolder::open(&root, &topology(), ANEW).expect("writable folder");
        assert_eq!(first.logs(), root.join("logs"), "messages name it");
        first.end();
        assert_eq!((first.failed_start(), first.report()), (None, root.join("report.json")));
        drop(first);
        let mut second = OutputFolder::open(&root, &topology(), ANEW).expect("writable folder");
        second.end();
        assert_eq!(second.report(), root.join("starting/report.json"));
        assert_eq!(second.failed_start(), Some(root.join(STARTING)));
        drop(second);
        assert!(root.join("starting/topology.toml").exists());
    }
}
