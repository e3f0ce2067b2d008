//! Material libraries on disk, by the names that an OBJ file has for them.

use std::cell::Cell;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};

use super::libraries::Spelling;
use crate::scene::SourceError;
use crate::scene::source::Source;

/// How many names of files are looked at, in all folders together, where none is as it was written.
const ENTRIES_MAX: usize = 1 << 20;

/// The folder that names are relative to.
pub(super) struct Folder {
    path: PathBuf,
    /// Of the libraries that are still to come.
    bytes_left: Cell<u64>,
    entries_left: Cell<usize>,
}

impl Folder {
    /// The folder of a file. All libraries together have at most `bytes_max`.
    pub(super) fn of(file: &Path, bytes_max: u64) -> Self {
        let path = file.parent().unwrap_or(Path::new("")).to_owned();
        Self { path, bytes_left: Cell::new(bytes_max), entries_left: Cell::new(ENTRIES_MAX) }
    }

    /// Reads a library; `None` when no file has this name.
    pub(super) fn read(&self, name: &[u8], spelling: Spelling) -> Option<Result<Source, SourceError>> {
        let name = Path::new(OsStr::from_bytes(name));
        let path = match spelling {
            Spelling::Exact => self.path.join(name),
            Spelling::AnyCase => self.find(name)?,
        };
        if fs::metadata(&path).is_err_and(|error| is_absent(&error)) {
            return None;
        }
        let library = Source::read_unquoted(&path, self.bytes_left.get());
        if let Ok(library) = &library {
            self.bytes_left.set(self.bytes_left.get() - library.bytes.len() as u64);
        }
        Some(library)
    }

    /// The path whose parts are those of a relative name but for upper and lower case.
    fn find(&self, name: &Path) -> Option<PathBuf> {
        let mut path = self.path.clone();
        for part in name.components() {
            match part {
                Component::Normal(part) if fs::symlink_metadata(path.join(part)).is_ok() => path.push(part),
                Component::Normal(part) => path.push(self.entry(&path, part)?),
                Component::CurDir | Component::ParentDir => path.push(part),
                Component::RootDir | Component::Prefix(_) => return None,
            }
        }
        Some(path)
    }

    /// The first name in a folder, in the order of bytes, that differs in case only.
    fn entry(&self, folder: &Path, name: &OsStr) -> Option<OsString> {
        let lower = |name: &OsStr| name.to_string_lossy().to_lowercase();
        let wanted = lower(name);
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let entries = fs::read_dir(folder).ok()?.take(self.entries_left.get());
        let entries = entries.inspect(|_| self.entries_left.set(self.entries_left.get() - 1));
        entries.filter_map(|entry| Some(entry.ok()?.file_name())).filter(|entry| lower(entry) == wanted).min()
    }
}

/// Whether there is no such file; a file that cannot be read is there.
fn is_absent(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidFilename, InvalidInput, NotADirectory, NotFound};
    matches!(error.kind(), NotFound | NotADirectory | InvalidFilename | InvalidInput)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_in_any_case() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let obj = folder.path().join("x.obj");
        fs::create_dir(folder.path().join("Stuff")).expect("a folder");
        for name in ["Paint.MTL", "paint.MTL", "Stuff/wood.mtl", "Bäume.mtl"] {
            fs::write(folder.path().join(name), name).expect("a file");
        }
        let library = |name: &str, spelling| {
            let library = Folder::of(&obj, 100).read(name.as_bytes(), spelling)?;
            Some(library.map(|source| String::from_utf8(source.bytes).expect("text")).map_err(|error| error.what))
        };
        let found = |name: &str| Some(Ok(name.to_owned()));
        assert_eq!(library("paint.MTL", Spelling::Exact), found("paint.MTL"));
        assert_eq!(library("PAINT.mtl", Spelling::Exact), None);
        assert_eq!(library("PAINT.mtl", Spelling::AnyCase), found("Paint.MTL"));
        assert_eq!(library("./stuff/../STUFF/Wood.mtl", Spelling::AnyCase), found("Stuff/wood.mtl"));
        assert_eq!(library("bÄume.mtl", Spelling::AnyCase), found("Bäume.mtl"));
        assert_eq!(library("paint.mtl/a", Spelling::AnyCase), None);
        assert_eq!(library("nul\0", Spelling::Exact), None);
        assert_eq!(library(&"long".repeat(10_000), Spelling::Exact), None);
        let is_folder = Err("is not a regular file, expected one".to_owned());
        assert_eq!(library("Stuff", Spelling::Exact), Some(is_folder));
        let absolute = folder.path().join("paint.mtl");
        assert_eq!(library(absolute.to_str().expect("text"), Spelling::AnyCase), None, "elsewhere nothing is listed");
    }

    #[test]
    fn all_libraries_together_are_bounded() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        fs::write(folder.path().join("a.mtl"), "12345").expect("a file");
        let libraries = Folder::of(&folder.path().join("x.obj"), 9);
        assert!(libraries.read(b"a.mtl", Spelling::Exact).is_some_and(|library| library.is_ok()));
        let refused = libraries.read(b"A.mtl", Spelling::AnyCase).expect("there").expect_err("too large");
        assert_eq!(refused.what, "5 bytes are too many, expected at most 4");
    }
}
