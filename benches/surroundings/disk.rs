//! The file system that has the output folder: its size, and the times when it is full.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Seek, Write};
use std::path::PathBuf;
use std::time::Duration;

use nix::sys::statvfs::statvfs;

use crate::namespaces::tool;
use crate::surroundings::{Deed, Surroundings};

pub(crate) struct Disk {
    pub(crate) folder: PathBuf,
    counts_files: bool,
    filler: Option<File>,
    /// Until when it is kept full; the inner `None`: to the end.
    full: Option<Option<Duration>>,
    /// How it was seen to be full.
    pub(crate) confirmed: Option<String>,
}

impl Disk {
    /// Gives what is mounted at `folder` the size that it is to have.
    ///
    /// # Errors
    /// It cannot have that size, or no file to fill it.
    pub(crate) fn new(folder: PathBuf, surroundings: &Surroundings) -> Result<Self, String> {
        let at = folder.display();
        let found = statvfs(&folder).map_err(|error| format!("{at}: {error}"))?;
        // What an earlier attempt has written stays.
        let used = (found.blocks() - found.blocks_free()) * found.fragment_size();
        let used_files = found.files() - found.files_free();
        let files = surroundings.disk_files.map(|files| files.max(used_files));
        let bytes = surroundings.disk_bytes.max(used);
        tool("mount", &format!("-o remount,size={bytes},nr_inodes={} {at}", files.unwrap_or(0)))?;
        let mut filler = None;
        if surroundings.deeds.iter().any(|(_, deed)| matches!(deed, Deed::Fill(_))) {
            filler = Some(File::create(folder.join("filler")).map_err(|error| format!("{at}/filler: {error}"))?);
        }
        Ok(Self { folder, counts_files: files.is_some(), filler, full: None, confirmed: None })
    }

    pub(crate) fn fill_until(&mut self, until: Option<Duration>) {
        self.full = Some(until);
        self.fill();
        self.look();
    }

    /// Keeps it full, or empties it when it is time.
    pub(crate) fn step(&mut self, elapsed: Duration) {
        match self.full {
            Some(Some(until)) if elapsed >= until => self.empty(),
            Some(_) => self.fill(),
            None => {}
        }
        self.look();
    }

    /// Takes away what is ours.
    pub(crate) fn release(&mut self) {
        self.look();
        self.empty();
        // A disk that was not to be filled has none.
        let _ = fs::remove_file(self.folder.join("filler"));
    }

    /// Until nothing goes in any more.
    fn fill(&mut self) {
        let Some(filler) = &mut self.filler else { return };
        loop {
            match filler.write(&[b'#'; 64 << 10]) {
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::StorageFull => break,
                Err(error) => panic!("a disk cannot be filled: {error}"),
            }
        }
    }

    fn empty(&mut self) {
        self.full = None;
        if let Some(filler) = &mut self.filler {
            filler.set_len(0).and_then(|()| filler.rewind()).expect("our own file can be emptied");
        }
    }

    fn look(&mut self) {
        let found = statvfs(&self.folder).expect("a file system of ours");
        let (blocks, files) = (found.blocks_free(), found.files_free());
        if self.confirmed.is_some() || (blocks > 0 && (!self.counts_files || files > 0)) {
            return;
        }
        let probe = self.folder.join("probe");
        let written = OpenOptions::new().create(true).append(true).open(&probe).and_then(|mut file| file.write(b"?"));
        // Where there was no room it is not there.
        let _ = fs::remove_file(&probe);
        if written.is_err_and(|error| error.kind() == ErrorKind::StorageFull) {
            let files = if self.counts_files { format!(" and {files} files") } else { String::new() };
            self.confirmed = Some(format!("disk: {blocks} blocks{files} free, a byte was refused"));
        }
    }
}
