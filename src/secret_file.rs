//! Files that only their owner can read: the token of a bus, the keys of a cluster.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Read and written by its owner alone.
const OWNER_ONLY: u32 = 0o600;
const OTHERS: u32 = 0o077;

/// Writes a file that only its owner can read, in the place of an earlier one, whole or not at all.
///
/// # Errors
/// It cannot be written; the error names it.
pub fn write(path: &Path, text: &str) -> io::Result<()> {
    let written = || {
        let mut beside = path.as_os_str().to_owned();
        beside.push(".part");
        let beside = PathBuf::from(beside);
        match fs::remove_file(&beside) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        // Nobody else can have opened a file that is new.
        let mut file = OpenOptions::new().write(true).create_new(true).mode(OWNER_ONLY).open(&beside)?;
        file.write_all(text.as_bytes())?;
        fs::rename(&beside, path)
    };
    written().map_err(|error| named(path, &error.to_string()))
}

/// The text of a file of at most so many bytes.
///
/// # Errors
/// The file is not there, others can read it, it is longer, or it is no text; the error names it.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<String> {
    let read = || {
        let file = File::open(path)?;
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
    read().map_err(|error| named(path, &error.to_string()))
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
