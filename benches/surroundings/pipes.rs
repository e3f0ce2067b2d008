//! The standard streams of a run.

use std::fs::{File, OpenOptions};
use std::io::{self, PipeReader, Read, Write};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use nix::fcntl::{FcntlArg, OFlag, fcntl};

use crate::surroundings::Stream;

/// The least that a pipe can have.
const PIPE_BYTES: i32 = 4096;
/// What a slow reader takes at a time.
const SIP_BYTES: usize = 256;

pub(crate) struct Pipes {
    streams: [Stream; 3],
    files: Vec<PathBuf>,
    readers: Vec<Reader>,
    pub(crate) confirmed: Vec<String>,
}

struct Reader {
    pipe: PipeReader,
    stream: Stream,
    said: Vec<u8>,
}

impl Pipes {
    /// Gives a command its streams; those to be closed are closed by the shell ([`Self::closings`]).
    pub(crate) fn attach(command: &mut Command, streams: [Stream; 3], room: &Path, disk: &Path, name: &str) -> Self {
        let mut pipes = Self { streams, files: Vec::new(), readers: Vec::new(), confirmed: Vec::new() };
        command.stdin(Stdio::null());
        for (number, stream) in streams.into_iter().enumerate().skip(1) {
            let stdio =
                pipes.open(stream, if stream == Stream::OnDisk { disk } else { room }, &format!("{name}-{number}"));
            if number == 1 {
                command.stdout(stdio)
            } else {
                command.stderr(stdio)
            };
        }
        pipes
    }

    fn open(&mut self, stream: Stream, folder: &Path, name: &str) -> Stdio {
        match stream {
            Stream::Closed => Stdio::null(),
            Stream::Full => OpenOptions::new().write(true).open("/dev/full").expect("/dev/full").into(),
            Stream::File | Stream::OnDisk => {
                self.files.push(folder.join(name));
                // A disk without room for one more file has no file of errors.
                File::create(folder.join(name)).map_or_else(|_| Stdio::null(), Stdio::from)
            }
            Stream::Broken(_) | Stream::Slow(_) => {
                let (reader, writer) = io::pipe().expect("a pipe");
                fcntl(&writer, FcntlArg::F_SETPIPE_SZ(PIPE_BYTES)).expect("a small pipe");
                if let Stream::Slow(_) = stream {
                    let mut filler = reopened(&writer, OpenOptions::new().write(true));
                    while filler.write(&[b'.'; SIP_BYTES]).is_ok() {}
                    self.confirmed.push(format!("a pipe of {PIPE_BYTES} bytes refused another before the start"));
                }
                if stream != Stream::Broken(Duration::ZERO) {
                    self.readers.push(Reader { pipe: reader, stream, said: Vec::new() });
                }
                writer.into()
            }
        }
    }

    /// For the shell.
    pub(crate) fn closings(&self) -> String {
        let is_closed = |(number, stream)| (stream == Stream::Closed).then(|| format!(" {number}>&-"));
        self.streams.into_iter().enumerate().filter_map(is_closed).collect()
    }

    /// Reads what there is, and leaves when it is time.
    pub(crate) fn step(&mut self, elapsed: Duration) {
        self.readers.retain_mut(|reader| {
            let mut bytes = [0; SIP_BYTES];
            let (is_over, reads) = match reader.stream {
                Stream::Broken(until) => (elapsed >= until, true),
                Stream::Slow(since) => (false, elapsed >= since),
                _ => (false, true),
            };
            if reads {
                let count = reopened(&reader.pipe, OpenOptions::new().read(true)).read(&mut bytes).unwrap_or(0);
                reader.said.extend(&bytes[..count]);
            }
            !is_over
        });
    }

    /// Reads what is left when all writers have ended.
    pub(crate) fn drain(&mut self) {
        for reader in &mut self.readers {
            // An error leaves what was read.
            let _ = reader.pipe.read_to_end(&mut reader.said);
        }
    }

    /// What a process has for its streams, when they are what was wanted; to be asked while it runs.
    pub(crate) fn confirm(&self, pid: u32) -> Option<String> {
        let link = |number: usize| std::fs::read_link(format!("/proc/{pid}/fd/{number}"));
        let mut found = Vec::new();
        for (number, stream) in self.streams.into_iter().enumerate() {
            let link = link(number).map_or_else(|_| "none".to_owned(), |link| link.display().to_string());
            let (is_so, what) = match stream {
                Stream::File | Stream::OnDisk => continue,
                // The language's runtime puts it where nothing is.
                Stream::Closed => (["none", "/dev/null"].contains(&link.as_str()), "closed"),
                Stream::Full => (link == "/dev/full", "full"),
                Stream::Broken(_) => (link.starts_with("pipe:"), "broken"),
                Stream::Slow(_) => (link.starts_with("pipe:"), "slow"),
            };
            if !is_so {
                return None;
            }
            found.push(format!("stream {number} {what}: {link}"));
        }
        (!found.is_empty()).then(|| found.join(" and "))
    }

    /// Whether what goes to standard error can be read afterwards.
    pub(crate) fn keeps_errors(&self) -> bool {
        self.streams[2] == Stream::File
    }

    /// All that was said.
    pub(crate) fn text(&self) -> String {
        let files = self.files.iter().map(|file| std::fs::read(file).unwrap_or_default());
        let bytes: Vec<u8> = files.chain(self.readers.iter().map(|reader| reader.said.clone())).flatten().collect();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// The same pipe, without waiting at this end; the other processes' ends go on waiting.
fn reopened(pipe: &impl AsFd, options: &mut OpenOptions) -> File {
    let path = format!("/proc/self/fd/{}", pipe.as_fd().as_raw_fd());
    options.custom_flags(OFlag::O_NONBLOCK.bits()).open(path).expect("a pipe can be opened again")
}
