//! Full disks, closed pipes, file-size limits, missing descriptors and threads, a thread that is stuck: each is a clear
//! error of the process it hits, or no error at all; nothing panics, and nothing waits for ever.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, PipeWriter, Read, Write};
use std::os::fd::AsFd;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use crate::command::{TEAPOT, read_report, report_of, run, stderr};
use crate::preload;

/// For a run that fails, on a busy machine: less than the three start-up deadlines that a hang takes.
const PATIENCE: Duration = Duration::from_secs(25);
const MARTI: &str = env!("CARGO_BIN_EXE_marti");

/// Runs a topology into `out` behind a command that limits it.
fn run_behind(limit: &[&str], out: &Path, options: &[&str]) -> Output {
    let mut command = Command::new(limit[0]);
    command.args(&limit[1..]).args([MARTI, "run", TEAPOT, "--quiet", "--out"]).arg(out).args(options);
    command.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("MARTI_LOG").output().expect("util-linux is here")
}

/// Whether a command of this host works for this user; says loudly when not.
fn can(command: &[&str], test: &str) -> bool {
    let works = Command::new(command[0]).args(&command[1..]).output().is_ok_and(|output| output.status.success());
    if !works {
        eprintln!("SKIPPED {test}: `{}` does not work here", command.join(" "));
    }
    works
}

fn assert_nothing_panicked(out: &Path, said: &str) {
    let logs = fs::read_dir(out.join("logs")).into_iter().flatten().flatten();
    let logs = logs.filter_map(|log| fs::read(log.path()).ok());
    for text in logs.map(|log| String::from_utf8_lossy(&log).into_owned()).chain([said.to_owned()]) {
        assert!(!text.contains("panicked"), "{text}");
    }
}

fn incidents(out: &Path) -> Vec<String> {
    let report = read_report(&out.join("report.json"));
    let incidents = report["incidents"].as_array().expect("a list").iter();
    incidents.map(|incident| incident["text"].as_str().expect("a text").to_owned()).collect()
}

#[test]
fn a_file_size_limit_names_the_file() {
    for bytes in ["0", "1000", "10000", "40000"] {
        let folder = tempfile::tempdir().expect("temporary folder");
        let output = run_behind(&["prlimit", &format!("--fsize={bytes}")], folder.path(), &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{bytes}: {:?} {said}", output.status);
        let names = said.contains(&folder.path().display().to_string());
        assert!(names && said.contains("File too large"), "{bytes}: {said}");
        assert_nothing_panicked(folder.path(), &said);
    }
}

#[test]
fn too_few_descriptors_are_an_error() {
    for count in 4..=24 {
        let folder = tempfile::tempdir().expect("temporary folder");
        let start = Instant::now();
        let output = run_behind(&["prlimit", &format!("--nofile={count}:{count}")], folder.path(), &[]);
        let said = stderr(&output);
        // 127: too few for the dynamic linker.
        let code = output.status.code().unwrap_or_else(|| panic!("{count}: {:?} {said}", output.status));
        assert!([0, 1, 3, 127].contains(&code), "{count}: {code} {said}");
        assert!(start.elapsed() < PATIENCE, "{count}: {:?}", start.elapsed());
        assert_nothing_panicked(folder.path(), &said);
    }
}

#[test]
fn too_few_threads_are_an_error() {
    let test = "too_few_threads_are_an_error";
    let folder = tempfile::tempdir().expect("temporary folder");
    // Nobody else's processes count then; and root's have no limit.
    let other = ["setpriv", "--reuid=47110", "--regid=47110", "--clear-groups"];
    if !can(&[&other[..], &[MARTI, "--version"]].concat(), test)
        || !can(&["chown", "47110", folder.path().to_str().expect("UTF-8")], test)
    {
        return;
    }
    for count in (1..=15).step_by(2) {
        let out = folder.path().join(count.to_string());
        let output = run_behind(&[&other[..], &["prlimit", &format!("--nproc={count}")]].concat(), &out, &[]);
        let said = stderr(&output);
        let code = output.status.code().unwrap_or_else(|| panic!("{count}: {:?} {said}", output.status));
        assert!([0, 1, 3].contains(&code), "{count}: {code} {said}");
        assert_nothing_panicked(&out, &said);
    }
    let image = folder.path().join("x.png");
    let image = image.to_str().expect("UTF-8");
    let render = ["render", "teapot:2", "--size", "64x64", "--threads", "8", "-o", image, "--quiet"];
    let limited = Command::new(other[0]).args(&other[1..]).args(["prlimit", "--nproc=3", MARTI]).args(render).output();
    let limited = limited.expect("it worked before");
    assert_eq!(limited.status.code(), Some(1), "{}", stderr(&limited));
    assert!(
        stderr(&limited).contains("cannot start 8 threads: Resource temporarily unavailable"),
        "{}",
        stderr(&limited)
    );
}

/// A display that is left without a descriptor serves the nodes that it has, and cannot accept their successors.
#[test]
fn a_display_that_can_accept_nothing_is_replaced() {
    let folder = tempfile::tempdir().expect("temporary folder");
    // Large enough for its display to be there yet when it is limited.
    let large = ["image.width=320", "image.height=320"];
    let undisturbed = report_of(TEAPOT, &folder.path().join("undisturbed"), &large);
    let out = folder.path().join("out");
    let mut command = Command::new(MARTI);
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["run", TEAPOT, "--quiet", "--out"]).arg(&out);
    command.args(large.map(|set| format!("--set={set}"))).args(["--chaos", "kill master 0@60%"]);
    let start = Instant::now();
    let mut run = command.spawn().expect("marti can be started");
    let journal = out.join("tiles");
    let begun = || fs::metadata(&journal).is_ok_and(|tiles| tiles.len() > 20_000);
    while !begun() && start.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(2));
    }
    let display = Command::new("pgrep").args(["--parent", &run.id().to_string(), "marti-display"]).output();
    let display = String::from_utf8_lossy(&display.expect("procps is here").stdout).trim().to_owned();
    let limited = Command::new("prlimit").args(["--pid", &display, "--nofile=4:4"]).status();
    assert!(limited.expect("util-linux is here").success(), "the display was process '{display}'");
    let status = run.wait().expect("a child");
    assert!(status.success(), "{status}");
    let told = incidents(&out);
    let expected = "no connection was accepted for 10 s: Too many open files";
    assert!(told.iter().any(|text| text.contains(expected)), "{told:?}");
    assert_eq!(read_report(&out.join("report.json"))["image"]["sha256"], undisturbed["image"]["sha256"]);
}

fn has_room(pipe: &PipeWriter) -> bool {
    poll(&mut [PollFd::new(pipe.as_fd(), PollFlags::POLLOUT)], PollTimeout::ZERO).is_ok_and(|ready| ready > 0)
}

#[test]
fn standard_error_decides_about_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let full = || Stdio::from(fs::File::options().write(true).open("/dev/full").expect("Linux has it"));
    let closed = || Stdio::from(io::pipe().expect("descriptors").1);
    // Its reader does not read, and it has no room.
    let (_reader, stopped) = io::pipe().expect("descriptors");
    let mut filled = stopped.try_clone().expect("descriptors");
    while has_room(&filled) {
        filled.write_all(&[b'x'; 4096]).expect("there is room");
    }
    for (name, stream) in [("full", full()), ("closed", closed()), ("stopped", stopped.into())] {
        let out = folder.path().join(name);
        let mut command = Command::new(MARTI);
        command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["run", TEAPOT, "--out"]).arg(&out);
        let status = command.stdout(Stdio::null()).stderr(stream).status().expect("marti can be started");
        assert!(status.success(), "{name}: {status}");
        let told = incidents(&out);
        let lost = told.iter().any(|text| text.contains("lines to standard error could not be written: "));
        assert!(lost, "{name}: {told:?}");
    }
    for (name, stream) in [("full", full()), ("closed", closed())] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_marti-node"));
        command.args(["--join", "127.0.0.1:9", "--patience", "0.3", "--token", "absent"]);
        let status = command.stdin(Stdio::null()).stderr(stream).status().expect("marti-node can be started");
        assert_eq!(status.code(), Some(1), "{name}: a node that asks in vain and cannot say so: {status}");
    }
}

/// Runs a script as root in a mount namespace of its own, with a small disk at `disk`; `None` where that is not possible.
fn on_a_small_disk(size: &str, disk: &Path, script: &str, test: &str) -> Option<Output> {
    if !can(&["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"], test) {
        return None;
    }
    fs::create_dir_all(disk).expect("writable folder");
    let script = format!("mount -t tmpfs -o size={size} none \"$DISK\" && {script}");
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", &script]).env("DISK", disk).env("MARTI", MARTI).env("TOPOLOGY", TEAPOT);
    Some(command.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("unshare works"))
}

#[test]
fn a_full_disk_is_an_error_in_time() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for size in ["8k", "16k", "64k", "160k"] {
        let start = Instant::now();
        // Logs and standard error on the same disk; what is said in the end is seen by way of a pipe, too.
        let script = "$MARTI run $TOPOLOGY --out $DISK/out 2>$DISK/err; echo first $?; rm $DISK/err; \
                      $MARTI run $TOPOLOGY --quiet --out $DISK/out; echo second $?; \
                      if grep -rqa panicked $DISK/out/logs; then echo panicked; fi";
        let test = "a_full_disk_is_an_error_in_time";
        let Some(output) = on_a_small_disk(size, folder.path(), script, test) else { return };
        let (out, said) = (String::from_utf8_lossy(&output.stdout), stderr(&output));
        assert!(
            out.contains("first 1") && out.contains("second 1") && !out.contains("panicked"),
            "{size}: {out} {said}"
        );
        assert!(said.contains("No space left on device"), "{size}: {said}");
        assert!(start.elapsed() < 2 * PATIENCE, "{size}: {:?}", start.elapsed());
    }
}

#[test]
fn room_made_again_lets_a_run_go_on() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let sets = ["image.width=160", "image.height=160", "cluster.nodes=3", "cluster.local_memory.size=4 KiB"];
    let undisturbed = report_of(TEAPOT, &folder.path().join("undisturbed"), &sets);
    let sets: String = sets.map(|set| format!(" --set '{set}'")).concat();
    // Full from the moment that the log of the bus has some rows, for half a second; `full` says that writes failed.
    let script = format!(
        "$MARTI run $TOPOLOGY --quiet --out $DISK/out{sets} & \
         until [ -s $DISK/out/tiles ] && [ $(stat -c %s $DISK/out/recording/bus.arrows.partial) -gt 65536 ]; do sleep 0.01; done; \
         head -c 200m /dev/zero >$DISK/fill 2>/dev/null || echo full; before=$(stat -c %s $DISK/out/tiles); sleep 0.5; \
         echo grown $(( $(stat -c %s $DISK/out/tiles) - before )); rm $DISK/fill; \
         wait $!; echo ended $?; cp $DISK/out/report.json $KEPT"
    );
    let kept = folder.path().join("report.json");
    let script = script.replace("$KEPT", &kept.display().to_string());
    let disk = folder.path().join("disk");
    let Some(output) = on_a_small_disk("100m", &disk, &script, "room_made_again_lets_a_run_go_on") else { return };
    let (out, said) = (String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert!(out.contains("full") && out.contains("ended 0"), "{out} {said}");
    let report = read_report(&kept);
    assert_eq!(report["image"]["sha256"], undisturbed["image"]["sha256"]);
    assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
}

#[test]
fn a_stuck_thread_is_found_and_its_process_replaced() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let undisturbed = report_of(TEAPOT, &folder.path().join("undisturbed"), &[]);
    // The display's main thread, when it appends a tile to its journal: once, for the first that removes the file.
    let source = r#"
        #define _GNU_SOURCE
        #include <dlfcn.h>
        #include <errno.h>
        #include <stdlib.h>
        #include <string.h>
        #include <sys/stat.h>
        #include <sys/uio.h>
        #include <unistd.h>
        ssize_t writev(int fd, const struct iovec *parts, int count) {
            static ssize_t (*real)(int, const struct iovec *, int);
            struct stat file;
            if (!real) real = dlsym(RTLD_NEXT, "writev");
            if (!strcmp(program_invocation_short_name, "marti-display") && !fstat(fd, &file) && S_ISREG(file.st_mode)
                && count == 2 && parts[1].iov_len > 0 && !unlink(getenv("STUCK")))
                for (;;) pause();
            return real(fd, parts, count);
        }"#;
    let Some(library) = preload::object(folder.path(), source, "a stuck thread") else { return };
    let (stuck, out) = (folder.path().join("stuck"), folder.path().join("out"));
    fs::write(&stuck, "").expect("writable folder");
    let mut command = Command::new(MARTI);
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["run", TEAPOT, "--quiet", "--out"]).arg(&out);
    command.env("LD_PRELOAD", library).env("STUCK", &stuck);
    let start = Instant::now();
    let output = command.output().expect("marti can be started");
    assert!(output.status.success(), "{:?} {}", output.status, stderr(&output));
    assert!(!stuck.exists() && start.elapsed() > Duration::from_secs(15), "nothing was stuck: {:?}", start.elapsed());
    let told = incidents(&out);
    assert!(told.iter().any(|text| text.starts_with("the display: its thread main is stuck")), "{told:?}");
    assert_eq!(read_report(&out.join("report.json"))["image"]["sha256"], undisturbed["image"]["sha256"]);
}

#[test]
fn a_reader_that_has_gone_is_no_failure_of_a_replay() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let trace = folder.path().join("t.din");
    fs::write(&trace, "1 40\n0 80\n").expect("writable folder");
    let arguments: [&OsStr; 4] = ["replay".as_ref(), trace.as_ref(), "--local-memory".as_ref(), "4096".as_ref()];
    assert_eq!(run(&arguments).status.code(), Some(0), "{}", stderr(&run(&arguments)));
    let (mut reader, closed) = io::pipe().expect("descriptors");
    let status = Command::new(MARTI).args(arguments).stdout(Stdio::null()).stderr(closed).status();
    assert!(status.expect("marti can be started").success());
    let mut said = String::new();
    reader.read_to_string(&mut said).expect("a pipe");
    assert!(said.contains("1 of 2 references are writes"), "{said}");
    let gone = Stdio::from(io::pipe().expect("descriptors").1);
    let status = Command::new(MARTI).args(arguments).stdout(Stdio::null()).stderr(gone).status();
    assert_eq!(status.expect("marti can be started").code(), Some(0), "its note could not be written");
}
