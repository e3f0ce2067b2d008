//! Files that are there whole or not at all: written beside their final name, then renamed.
//!
//! What is found at an output path decides what is done. Nothing, or a regular file: it is replaced. A symbolic link to a
//! regular file: that file is replaced, and the link stays. Standard output or standard error, a pipe, a character
//! device: the bytes are written to it. Anything else is refused.

use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};

/// What a file is written through.
pub type Writer = BufWriter<File>;

/// Of a new file, less what the process's mask takes away.
const MODE: u32 = 0o666;
/// The name of a file that is on its way: `NAME.XXXXXX.part`.
const PART: &str = ".part";
const RANDOM_CHARACTERS: usize = 6;
/// For another process to open the other end of a pipe.
const PIPE_DEADLINE: Duration = Duration::from_secs(10);
const PIPE_PAUSE: Duration = Duration::from_millis(10);

/// Writes `path` by way of `contents`; on an error a regular file that was there before is left as it was.
///
/// # Errors
/// What the file system or `contents` says, or a folder, a block device, a socket, a link to nothing, or a pipe that no
/// process reads within 10 s has this name; the error names the path.
pub fn write(path: &Path, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    let written = match Output::at(path) {
        Ok(Output::Replaced(file)) => {
            // The new file is for the same readers as the one that it replaces.
            let mode = fs::metadata(&file).map_or(MODE, |found| found.mode() & MODE);
            replace(&file, mode, contents)
        }
        Ok(Output::Through(file)) => fill(&mut BufWriter::with_capacity(1 << 18, file), contents),
        Err(error) => Err(error),
    };
    written.map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

/// Puts a file with these permissions in the place of `path`, whatever has this name. Errors do not name it.
pub(crate) fn replace(path: &Path, mode: u32, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut prefix = OsString::from(path.file_name().ok_or_else(|| io::Error::other("is not the name of a file"))?);
    prefix.push(".");
    // New, and under a name that no other process can know before. It is removed again unless all goes well.
    let (file, beside) = tempfile::Builder::new()
        .prefix(&prefix)
        .rand_bytes(RANDOM_CHARACTERS)
        .suffix(PART)
        .make_in(folder, |beside| File::options().write(true).create_new(true).mode(mode).open(beside))?
        .into_parts();
    fill(&mut BufWriter::with_capacity(1 << 18, file), contents)?;
    beside.persist(path).map_err(|failed| failed.error)
}

/// The name that a file was to get which a killed process left behind.
pub fn unfinished(name: &str) -> Option<&str> {
    let (name, random) = name.strip_suffix(PART)?.rsplit_once('.')?;
    let is_random = random.len() == RANDOM_CHARACTERS && random.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_random.then_some(name)
}

/// Where bytes go.
enum Output {
    /// Into a new file, in the place of this one.
    Replaced(PathBuf),
    Through(File),
}

impl Output {
    fn at(path: &Path) -> io::Result<Self> {
        let found = match fs::metadata(path) {
            Ok(found) => found,
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            Err(_) if path.is_symlink() => return Err(io::Error::other("is a symbolic link to nothing")),
            Err(_) => return Ok(Self::Replaced(path.to_owned())),
        };
        let kind = found.file_type();
        if let Some(own) = own_output(&found) {
            Ok(Self::Through(own))
        } else if kind.is_file() {
            Ok(Self::Replaced(if path.is_symlink() { fs::canonicalize(path)? } else { path.to_owned() }))
        } else if kind.is_fifo() || kind.is_char_device() {
            open_through(path).map(Self::Through)
        } else {
            let what = if kind.is_dir() {
                "a folder"
            } else if kind.is_socket() {
                "a socket"
            } else {
                "a block device"
            };
            Err(io::Error::other(format!("is {what}, expected a file to write")))
        }
    }
}

/// Standard output or standard error, if this is it: written on from where it is, as what it was appended to stays.
fn own_output(found: &Metadata) -> Option<File> {
    let (output, error) = (io::stdout(), io::stderr());
    [output.as_fd(), error.as_fd()].into_iter().find_map(|own| {
        let own = File::from(own.try_clone_to_owned().ok()?);
        let metadata = own.metadata().ok()?;
        (metadata.dev() == found.dev() && metadata.ino() == found.ino()).then_some(own)
    })
}

/// A pipe or a character device. Opening it does not wait, but for a process at the pipe's other end; writing does.
fn open_through(path: &Path) -> io::Result<File> {
    let flags = (OFlag::O_NONBLOCK | OFlag::O_NOCTTY).bits();
    let deadline = Instant::now() + PIPE_DEADLINE;
    let file = loop {
        match File::options().write(true).custom_flags(flags).open(path) {
            Err(error) if error.raw_os_error() == Some(Errno::ENXIO as i32) => {
                if Instant::now() >= deadline {
                    let seconds = PIPE_DEADLINE.as_secs();
                    return Err(io::Error::other(format!("no process has opened it for reading within {seconds} s")));
                }
                thread::sleep(PIPE_PAUSE);
            }
            opened => break opened?,
        }
    };
    let flags = OFlag::from_bits_retain(fcntl(&file, FcntlArg::F_GETFL)?);
    fcntl(&file, FcntlArg::F_SETFL(flags - OFlag::O_NONBLOCK))?;
    Ok(file)
}

fn fill(file: &mut Writer, contents: impl FnOnce(&mut Writer) -> io::Result<()>) -> io::Result<()> {
    contents(file)?;
    file.flush()
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;

    use nix::sys::stat::Mode;

    use super::*;

    fn put(path: &Path, text: &str) -> io::Result<()> {
        write(path, |file| file.write_all(text.as_bytes()))
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_part() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("x.txt");
        put(&path, "old").expect("first write");
        let error = write(&path, |file| {
            file.write_all(b"half of the n")?;
            Err(io::Error::other("cut"))
        })
        .expect_err("the writer failed");
        assert!(error.to_string().contains("x.txt: cut"), "{error}");
        assert_eq!(fs::read(&path).expect("still there"), b"old");
        assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 1);
        let error = put(&folder.path().join("none/x.txt"), "").expect_err("no folder").to_string();
        assert!(error.ends_with("none/x.txt: No such file or directory (os error 2)"), "{error}");
    }

    #[test]
    fn what_is_on_its_way_has_a_name_of_its_own_that_is_recognised() {
        let folder = tempfile::tempdir().expect("temporary folder");
        // What was written through once.
        let victim = folder.path().join("victim");
        fs::write(&victim, "safe").expect("writable folder");
        symlink("victim", folder.path().join("x.txt.part")).expect("a link");
        write(&folder.path().join("x.txt"), |_| {
            let names = fs::read_dir(folder.path())?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
            let names: Vec<_> = names.collect::<io::Result<_>>()?;
            assert_eq!(names.iter().filter(|name| unfinished(name) == Some("x.txt")).count(), 1, "{names:?}");
            Ok(())
        })
        .expect("writable folder");
        assert_eq!(fs::read(&victim).expect("there"), b"safe");
        assert!(folder.path().join("x.txt.part").is_symlink());
        assert_eq!(["x.txt.part", "x.abc.part", "x.abcde/.part", "a.part"].map(unfinished), [None; 4]);
    }

    #[test]
    fn a_links_target_is_replaced_and_the_link_stays() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let (target, link) = (folder.path().join("sub/target"), folder.path().join("link"));
        fs::create_dir(folder.path().join("sub")).expect("writable folder");
        symlink("sub/target", &link).expect("a link");
        let error = put(&link, "new").expect_err("to nothing").to_string();
        assert!(error.ends_with("link: is a symbolic link to nothing"), "{error}");
        fs::write(&target, "old").expect("writable folder");
        put(&link, "new").expect("writable folder");
        assert_eq!(fs::read(&target).expect("there"), b"new");
        assert!(link.is_symlink());
    }

    #[test]
    fn what_is_no_file_is_written_through_or_refused_and_never_replaced() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = |name: &str| folder.path().join(name);
        nix::unistd::mkfifo(&path("pipe"), Mode::S_IRWXU).expect("a pipe");
        symlink("/dev/null", path("null")).expect("a link");
        let reader = std::thread::spawn({
            let pipe = path("pipe");
            move || {
                let mut text = String::new();
                File::open(pipe).and_then(|mut pipe| pipe.read_to_string(&mut text)).map(|_| text)
            }
        });
        // More than a pipe holds: what is written waits for the reader.
        let long = "x".repeat(1 << 20);
        put(&path("pipe"), &long).expect("somebody reads");
        assert_eq!(reader.join().expect("no panic").expect("a pipe"), long);
        put(&path("null"), "gone").expect("a device");
        let _socket = UnixListener::bind(path("socket")).expect("a socket");
        fs::create_dir(path("folder")).expect("a folder");
        for (name, what) in [("socket", "is a socket"), ("folder", "is a folder")] {
            let error = put(&path(name), "").expect_err(name).to_string();
            assert!(error.ends_with(&format!("{name}: {what}, expected a file to write")), "{error}");
        }
        let kind = |name: &str| fs::symlink_metadata(path(name)).expect("there").file_type();
        assert!(kind("pipe").is_fifo() && kind("null").is_symlink() && kind("socket").is_socket());
        assert_eq!(fs::read_dir(folder.path()).expect("folder").count(), 4, "no part is left");
    }
}
