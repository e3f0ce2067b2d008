//! Opens regular files only. Opening a pipe, a device or a socket instead of a file may wait for ever, or do harm.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use nix::libc::{O_NOCTTY, O_NOFOLLOW, O_NONBLOCK};

/// A file is there, and is a folder, a pipe, a device or a socket.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("is not a regular file, expected one")]
struct NotRegular;

/// Opens a file to read it. A read never waits: where a file of the kernel has nothing to give yet (`/proc/kmsg`), it
/// fails with [`io::ErrorKind::WouldBlock`].
///
/// # Errors
/// It cannot be opened, or is no regular file ([`is_refused`]).
pub fn open(path: &Path) -> io::Result<File> {
    open_as(path, File::options().read(true), 0)
}

/// Opens a file to read and change it, or makes it if it is not there. Symbolic links are not followed.
///
/// # Errors
/// It cannot be opened, or is no regular file ([`is_refused`]).
pub fn edit(path: &Path) -> io::Result<File> {
    open_as(path, File::options().read(true).write(true).create(true).truncate(false), O_NOFOLLOW)
}

/// Makes an empty file, in the place of whatever has this name. Symbolic links are replaced, not followed.
///
/// # Errors
/// What has this name cannot be removed, or the file cannot be made.
pub fn create(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    File::options().write(true).create_new(true).open(path)
}

/// Whether an error says that a file is there and is no regular one.
pub fn is_refused(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<NotRegular>())
}

fn open_as(path: &Path, options: &mut OpenOptions, flags: i32) -> io::Result<File> {
    let refused = || io::Error::new(io::ErrorKind::InvalidInput, NotRegular);
    // Merely to open a device can have effects.
    let found = if flags & O_NOFOLLOW == 0 { fs::metadata(path) } else { fs::symlink_metadata(path) };
    if found.is_ok_and(|found| !found.is_file()) {
        return Err(refused());
    }
    // Something else may have come in its place since: it is not waited for either.
    let file = options.custom_flags(flags | O_NONBLOCK | O_NOCTTY).open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(refused()) }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    use nix::sys::stat::Mode;

    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        nix::unistd::mkfifo(&path("pipe"), Mode::S_IRWXU).expect("a pipe");
        let _socket = UnixListener::bind(path("socket")).expect("a socket");
        fs::create_dir(path("folder")).expect("a folder");
        symlink("pipe", path("link")).expect("a link");
        for name in ["pipe", "socket", "folder", "link"] {
            for opened in [open(&path(name)), edit(&path(name))] {
                let error = opened.expect_err(name);
                assert!(is_refused(&error), "{name}: {error}");
                assert_eq!(error.to_string(), "is not a regular file, expected one");
            }
        }
        assert!(is_refused(&open(Path::new("/dev/zero")).expect_err("a device")));
        assert!(!is_refused(&open(&path("none")).expect_err("not there")));
    }

    #[test]
    fn links_are_followed_by_readers_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("target"), "text").expect("a file");
        symlink("target", path("link")).expect("a link");
        let mut text = String::new();
        open(&path("link")).expect("a file").read_to_string(&mut text).expect("text");
        assert_eq!(text, "text");
        assert!(is_refused(&edit(&path("link")).expect_err("a link")));
        create(&path("link")).expect("a file").write_all(b"new").expect("written");
        assert_eq!(fs::read_to_string(path("target")).expect("a file"), "text");
        assert_eq!(fs::read_to_string(path("link")).expect("a file"), "new");
        assert!(!path("link").is_symlink());
    }
}
