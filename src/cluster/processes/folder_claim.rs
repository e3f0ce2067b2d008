//! A folder that one process at a time writes into.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// What earlier processes wrote, by number.
pub(super) const EARLIER: &str = "earlier";

/// The right to write into a folder. It ends with its holder, whatever that dies of.
#[derive(Debug)]
pub(super) struct FolderClaim {
    root: PathBuf,
    /// The folder itself, locked.
    _lock: File,
    /// Why it is not locked all the same, where the file system does not lock.
    unlocked: Option<io::Error>,
    /// `earlier/N`, once something was put there.
    aside: Option<PathBuf>,
    /// Folders that were made for it, the innermost first.
    made: Vec<PathBuf>,
}

#[derive(Debug, thiserror::Error)]
pub enum ClaimError {
    #[error("{}: another process writes into this folder", .0.display())]
    Busy(PathBuf),
    #[error("{}: is not a folder, expected one or nothing", .0.display())]
    NoFolder(PathBuf),
    /// The error names the file.
    #[error("{0}")]
    Io(#[from] io::Error),
}

impl FolderClaim {
    /// Makes the folder if need be, and locks it.
    ///
    /// # Errors
    /// Another process has it, it is something else than a folder, or it cannot be made or opened.
    pub(super) fn take(root: &Path) -> Result<Self, ClaimError> {
        let made = root.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made = made.map(Path::to_owned).collect();
        match fs::create_dir_all(root) {
            Err(error) if matches!(error.kind(), io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory) => {
                return Err(ClaimError::NoFolder(root.to_owned()));
            }
            made => made.map_err(|error| named(root, &error))?,
        }
        let lock = File::open(root).map_err(|error| named(root, &error))?;
        let unlocked = match lock.try_lock() {
            Ok(()) => None,
            Err(TryLockError::WouldBlock) => return Err(ClaimError::Busy(root.to_owned())),
            // As on some network file systems.
            Err(TryLockError::Error(error)) => Some(error),
        };
        Ok(Self { root: root.to_owned(), _lock: lock, unlocked, aside: None, made })
    }

    /// A warning where the file system cannot lock: other processes may write into the folder too.
    pub(super) fn warning(&self) -> Option<String> {
        let error = self.unlocked.as_ref()?;
        Some(format!("{} cannot be locked ({error}): make sure that nothing else writes into it", self.root.display()))
    }

    /// Moves what has this name, if anything, to `earlier/N/NAME`, where N is the first number that was free.
    ///
    /// # Errors
    /// It cannot be moved; the error names it.
    pub(super) fn put_aside(&mut self, name: &str) -> io::Result<()> {
        let path = self.root.join(name);
        if fs::symlink_metadata(&path).is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
            return Ok(());
        }
        let aside = self.aside()?;
        fs::rename(&path, aside.join(name)).map_err(|error| named(&path, &error))
    }

    /// As [`Self::put_aside`], of a file that stays until another takes its place.
    ///
    /// # Errors
    /// It cannot be linked or copied; the error names it.
    pub(super) fn keep_aside(&mut self, name: &str) -> io::Result<()> {
        let path = self.root.join(name);
        if !fs::symlink_metadata(&path).is_ok_and(|found| found.is_file()) {
            return self.put_aside(name);
        }
        let aside = self.aside()?.join(name);
        // Not all file systems have links.
        fs::hard_link(&path, &aside)
            .or_else(|_| fs::copy(&path, &aside).map(drop))
            .map_err(|error| named(&path, &error))
    }

    /// Whether anything was moved.
    pub(super) fn has_put_aside(&self) -> bool {
        self.aside.is_some()
    }

    fn aside(&mut self) -> io::Result<PathBuf> {
        match &self.aside {
            Some(aside) => Ok(aside.clone()),
            None => self.new_aside(),
        }
    }

    fn new_aside(&mut self) -> io::Result<PathBuf> {
        let earlier = self.root.join(EARLIER);
        fs::create_dir_all(&earlier).map_err(|error| named(&earlier, &error))?;
        let mut number = 1_u32;
        loop {
            let aside = earlier.join(number.to_string());
            match fs::create_dir(&aside) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && number < u32::MAX => number += 1,
                made => {
                    made.map_err(|error| named(&aside, &error))?;
                    self.aside = Some(aside.clone());
                    return Ok(aside);
                }
            }
        }
    }

    /// Takes the folders away again that were made for it, as far as they are empty.
    pub(super) fn withdraw(&mut self) {
        for folder in self.made.drain(..) {
            if fs::remove_dir(folder).is_err() {
                return;
            }
        }
    }
}

pub(super) fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_folder_has_one_claim_at_a_time() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path().join("a/b");
        let claim = FolderClaim::take(&root).expect("writable folder");
        assert_eq!(claim.warning(), None);
        let link = folder.path().join("link");
        symlink(&root, &link).expect("a link");
        for path in [&root, &link] {
            let refused = FolderClaim::take(path).expect_err("taken").to_string();
            assert_eq!(refused, format!("{}: another process writes into this folder", path.display()));
        }
        drop(claim);
        let mut claim = FolderClaim::take(&link).expect("free again");
        claim.withdraw();
        assert!(root.exists(), "it was not made for this claim");
    }

    #[test]
    fn folders_that_were_made_go_if_they_are_empty() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let root = folder.path().join("a/b");
        FolderClaim::take(&root).expect("writable folder").withdraw();
        assert!(!folder.path().join("a").exists());
        let mut claim = FolderClaim::take(&root).expect("writable folder");
        fs::write(folder.path().join("a/x"), "").expect("writable folder");
        claim.withdraw();
        assert!(folder.path().join("a/x").exists() && !root.exists());
    }

    #[test]
    fn what_is_no_folder_is_named() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let file = folder.path().join("file");
        fs::write(&file, "x").expect("writable folder");
        let dangling = folder.path().join("dangling");
        symlink("nowhere", &dangling).expect("a link");
        for path in [file.clone(), file.join("below"), dangling, PathBuf::from("/dev/null")] {
            let refused = FolderClaim::take(&path).expect_err("no folder").to_string();
            assert_eq!(refused, format!("{}: is not a folder, expected one or nothing", path.display()));
        }
    }

    #[test]
    fn what_is_put_aside_goes_where_nothing_was() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        for (number, text) in [(1, "one"), (2, "two")] {
            let mut claim = FolderClaim::take(folder.path()).expect("writable folder");
            fs::write(path("x"), text).expect("writable folder");
            symlink("nowhere", path("link")).expect("a link");
            ["x", "link", "none"].into_iter().for_each(|name| claim.put_aside(name).expect("writable folder"));
            assert_eq!(fs::read_to_string(path(&format!("earlier/{number}/x"))).expect("put aside"), text);
            assert!(path(&format!("earlier/{number}/link")).is_symlink() && !path("x").exists());
        }
    }
}
