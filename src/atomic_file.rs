//! Files that are there whole or not at all: written beside their final name, then renamed.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// What a file is written through.
pub type Writer = BufWriter<File>;

/// Writes `path` by way of `contents`; on an error whatever stood there before is left as it was.
///
/// # Errors
/// What the file system or `contents` says; the error names the path.
pub fn write(path: &Path, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    let beside = part_name(path);
    let whole = File::create(&beside).and_then(|file| {
        let mut file = BufWriter::with_capacity(1 << 18, file);
        contents(&mut file)?;
        file.flush()
    });
    whole.and_then(|()| fs::rename(&beside, path)).map_err(|error| {
        // The part is of no use; that it cannot be removed either would only hide the first error.
        let _ = fs::remove_file(&beside);
        io::Error::new(error.kind(), format!("{}: {error}", path.display()))
    })
}

/// `DIR/NAME.part`, in the same folder so that the rename stays on one file system.
fn part_name(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(".part");
    PathBuf::from(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_part() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("x.txt");
        write(&path, |file| file.write_all(b"old")).expect("first write");
        let error = write(&path, |file| {
            file.write_all(b"half of the n")?;
            Err(io::Error::other("cut"))
        })
        .expect_err("the writer failed");
        assert!(error.to_string().contains("x.txt: cut"), "{error}");
        assert_eq!(fs::read(&path).expect("still there"), b"old");
        assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1);
    }
}
