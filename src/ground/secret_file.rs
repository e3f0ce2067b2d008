//! Files that only their owner can read: the token of a bus, the keys of a cluster.

use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::atomic_file;
use crate::regular_file;

/// Read and written by its owner alone.
const OWNER_ONLY: u32 = 0o600;
const OTHERS: u32 = 0o077;

/// Writes a file that only its owner can read, in the place of an earlier one, whole or not at all.
///
/// # Errors
/// It cannot be written, or something else than a regular file has this name; the error names it.
pub fn write(path: &Path, text: &str) -> io::Result<()> {
    let written = || {
        // A secret goes neither through a link, nor to a device.
        if fs::symlink_metadata(path).is_ok_and(|found| !found.is_file()) {
            return Err(io::Error::other("is not a regular file, expected one or none"));
        }
        // Nobody else can have opened a file that is new.
        atomic_file::replace(path, OWNER_ONLY, |file| file.write_all(text.as_bytes()))
    };
    written().map_err(|error| named(path, &error.to_string()))
}

/// The text of a file of at most so many bytes.
///
/// # Errors
/// The file is not there or no regular file, others can read it, it is longer, or it is no text; the error names it.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<String> {
    let read = || {
        let file = regular_file::open(path)?;
        let mode = file.metadata()?.mode();
        if mode & OTHERS != 0 {
            let what = format!("its mode is {:03o}: others can read the secret, expected 600", mode & 0o777);
            return Err(io::Error::other(what));
        }
        let mut text = String::new();
        file.take(bytes_max + 1).read_to_string(&mut text)?;
        if text.len() as u64 > bytes_max {
            return Err(io::Error::other(format!("it is longer than {bytes_max} bytes")));
        }
        Ok(text)
    };
    read().map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

/// An error about a file.
pub fn named(path: &Path, what: &str) -> io::Error {
    io::Error::other(format!("{}: {what}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_hidden_from_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("secret");
        for text in ["one", "two"] {
            write(&path, text).expect("a folder to write to");
            assert_eq!(fs::metadata(&path).expect("there").permissions().mode() & 0o777, OWNER_ONLY);
            assert_eq!(read(&path, 3).expect("ours"), text);
        }
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    }

    #[test]
    fn a_secret_is_not_written_through_a_link() {
        let folder = tempfile::tempdir().expect("a folder");
        let (link, target) = (folder.path().join("link"), folder.path().join("target"));
        fs::write(&target, "theirs").expect("writable");
        std::os::unix::fs::symlink(&target, &link).expect("a link");
        let refused = write(&link, "ours").expect_err("a link").to_string();
        assert!(refused.ends_with("link: is not a regular file, expected one or none"), "{refused}");
        assert_eq!(fs::read(&target).expect("there"), b"theirs");
    }

    #[test]
    fn what_is_no_secret_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("secret");
        assert!(read(&path, 9).expect_err("not there").to_string().contains("secret: No such file"));
        write(&path, "0123456789").expect("writable");
        assert!(read(&path, 9).expect_err("long").to_string().ends_with("it is longer than 9 bytes"));
        for mode in [0o640, 0o604, 0o660] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("ours");
            let refused = read(&path, 10).expect_err("others").to_string();
            assert!(refused.ends_with(&format!("its mode is {mode:o}: others can read the secret, expected 600")));
        }
    }
}
