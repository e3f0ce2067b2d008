//! Hosts: launchers on other loopback addresses, processes that join late, leave and come again, and who is refused.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use serde_json::Value;

use crate::command::{TEAPOT, marti, number, read_report, report_of, run, stderr};
use crate::processes::{children, lives, signal};

/// For a run and all who join it.
const PATIENCE: Duration = Duration::from_secs(120);
/// Slow enough for nodes to come and go meanwhile.
const SLOW: [&str; 3] = ["image.width=160", "image.height=160", "cluster.local_memory.size=4 KiB"];

/// The teapot, with these hosts besides what is set.
fn topology(folder: &Path, hosts: &str) -> PathBuf {
    let path = folder.join("hosts.toml");
    let teapot = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(TEAPOT)).expect("readable");
    fs::write(&path, format!("{teapot}\n{hosts}")).expect("writable folder");
    path
}

/// A port that was free a moment ago.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("loopback").port()
}

fn program(name: &str) -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_marti")).with_file_name(name)
}

fn sha256(report: &Value) -> &str {
    report["image"]["sha256"].as_str().expect("an image")
}

fn incidents(report: &Value) -> String {
    report["incidents"].to_string()
}

/// Whoever is not needed any more ends with the test.
struct Process(Child);

impl Process {
    /// Joins the manager at this port, with the token in that folder.
    fn join(name: &str, port: u16, out: &Path, options: &[&str]) -> Self {
        let mut command = Command::new(program(name));
        command.args(["--join", &format!("localhost:{port}"), "--patience", "60", "--token"]);
        command.arg(out.join("join.token")).args(options).stdin(Stdio::null()).stdout(Stdio::null());
        let log = fs::File::options().create(true).append(true).open(out.with_extension("joined.log"));
        command.stderr(log.expect("writable folder"));
        Self(command.spawn().expect("the program can be started"))
    }

    fn code(&mut self) -> Option<i32> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(status) = self.0.try_wait().expect("our own child") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("still running after {PATIENCE:?}");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // An error means that it has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A run that others join.
fn manager(topology: &Path, out: &Path, port: u16, sets: &[&str]) -> Process {
    let mut command = marti();
    command.arg("run").arg(topology).args(["--quiet", "--listen", &format!("127.0.0.1:{port}"), "--out"]).arg(out);
    for set in sets {
        command.args(["--set", set]);
    }
    let errors = fs::File::create(out.with_extension("stderr")).expect("writable folder");
    Process(command.stdout(Stdio::null()).stderr(errors).spawn().expect("marti can be started"))
}

fn wait_until(what: &str, done: impl Fn() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "{what} does not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn recorded_bytes(out: &Path) -> u64 {
    let files = fs::read_dir(out.join("recording")).into_iter().flatten().flatten();
    files.filter_map(|file| Some(file.metadata().ok()?.len())).sum()
}

#[test]
fn launchers_start_processes_on_other_addresses_and_the_image_is_the_same() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let alone = report_of(TEAPOT, &folder.path().join("alone"), &[]);
    let hosts = r#"
        [[host]]
        name = "here"
        nodes = 1
        [[host]]
        name = "second"
        bind = "127.0.0.2"
        launch = ["sh", "-c", "exec {program} # on {host}"]
        nodes = 2
        display = true
        [[host]]
        name = "third"
        bind = "127.0.0.3"
        launch = ["env", "{program}"]
        clusters = [0]
    "#;
    let path = topology(folder.path(), hosts);
    let out = folder.path().join("hosts");
    let report = report_of(path.to_str().expect("text"), &out, &["cluster.nodes=4"]);
    assert_eq!(sha256(&report), sha256(&alone));
    assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
    let bus = fs::read_to_string(out.join("logs/bus.log")).expect("what it printed");
    assert!(bus.contains("marti-bus"), "a launcher's log is what is printed: {bus}");
    let manager = fs::read_to_string(out.join("logs/manager.log")).expect("a log");
    assert!(manager.contains("127.0.0.3:") || !manager.is_empty());
}

#[test]
fn a_launcher_that_starts_nothing_is_named() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let hosts =
        "[[host]]\nname = 'here'\n[[host]]\nname = 'there'\nbind = '127.0.0.2'\nlaunch = ['false', '{program}']\n";
    let path = topology(folder.path(), hosts);
    let out = folder.path().join("out");
    let output = run(&["run".as_ref(), path.as_os_str(), "--quiet".as_ref(), "--out".as_ref(), out.as_os_str()]);
    assert!(output.status.success(), "the first host's nodes do all: {}", stderr(&output));
    let report = read_report(&out.join("report.json"));
    assert!(incidents(&report).contains("ended with exit code 1"), "{}", incidents(&report));
    assert!(incidents(&report).contains("is set aside"), "{}", incidents(&report));
}

#[test]
fn everything_can_join_and_nodes_come_late_leave_and_come_again() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let undisturbed = report_of(TEAPOT, &folder.path().join("alone"), &SLOW);
    let hosts = "[[host]]\nname = 'here'\nnodes = 0\n\
                 [[host]]\nname = 'cloud'\nlaunch = 'external'\nnodes = 3\nclusters = [0]\ndisplay = true\nshared_files = true\n";
    let path = topology(folder.path(), hosts);
    let (out, port) = (folder.path().join("out"), free_port());
    // Before there is a manager.
    let mut early = Process::join("marti-node", port, &out, &[]);
    let mut run = manager(&path, &out, port, &[&SLOW[..], &["cluster.nodes=3"]].concat());
    let mut servers = ["marti-bus", "marti-master", "marti-display"].map(|name| Process::join(name, port, &out, &[]));
    wait_until("work", || recorded_bytes(&out) > 64 << 10);
    // In the middle.
    let mut late = Process::join("marti-node", port, &out, &["--host", "cloud"]);
    std::thread::sleep(Duration::from_millis(300));
    signal(early.0.id(), Signal::SIGTERM);
    assert_eq!(early.code(), Some(0), "it leaves when its tiles are done");
    let mut again = Process::join("marti-node", port, &out, &[]);
    assert_eq!(run.code(), Some(0), "{}", fs::read_to_string(out.with_extension("stderr")).unwrap_or_default());
    let report = read_report(&out.join("report.json"));
    assert_eq!(sha256(&report), sha256(&undisturbed));
    assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
    assert!(incidents(&report).contains("left, as it was asked to"), "{}", incidents(&report));
    assert_eq!((number(&report, "tiles.reissued"), number(&report, "tiles.stale")), (0, 0), "what it held was done");
    assert!(report["nodes"].as_array().expect("nodes").iter().filter(|node| number(node, "tiles") > 0).count() >= 2);
    for process in servers.iter_mut().chain([&mut late, &mut again]) {
        assert_eq!(process.code(), Some(0), "the run ended well");
    }
    assert!(!out.join("join.token").exists(), "nobody can use it any more");
}

#[test]
fn a_node_that_joined_and_is_killed_is_replaced_by_another() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let undisturbed = report_of(TEAPOT, &folder.path().join("alone"), &SLOW);
    let hosts = "[[host]]\nname = 'here'\nnodes = 0\n[[host]]\nname = 'cloud'\nlaunch = 'external'\n";
    let path = topology(folder.path(), hosts);
    let (out, port) = (folder.path().join("out"), free_port());
    let mut run = manager(&path, &out, port, &[&SLOW[..], &["cluster.nodes=2"]].concat());
    let mut nodes: Vec<_> = (0..3).map(|_| Process::join("marti-node", port, &out, &[])).collect();
    wait_until("work", || recorded_bytes(&out) > 64 << 10);
    let first = children(run.0.id(), 3, PATIENCE);
    assert_eq!(first.len(), 3, "bus, master and display alone: {first:?}");
    // One of the three waits, and takes the place of this one or goes on waiting.
    signal(nodes[0].0.id(), Signal::SIGKILL);
    assert_eq!(run.code(), Some(0), "{}", fs::read_to_string(out.with_extension("stderr")).unwrap_or_default());
    let report = read_report(&out.join("report.json"));
    assert_eq!(sha256(&report), sha256(&undisturbed));
    assert_eq!(report["conservation"]["holds"], true, "{}", report["conservation"]);
    for node in &mut nodes[1..] {
        assert_eq!(node.code(), Some(0), "all are told the end");
    }
}

/// The answer to those who look after a machine; nothing while nobody listens.
fn health(port: u16) -> String {
    let mut answer = String::new();
    if let Ok(mut stream) = TcpStream::connect(("127.0.0.1", port)) {
        stream.write_all(b"GET /healthz HTTP/1.0\r\n\r\n").expect("it reads");
        stream.read_to_string(&mut answer).expect("it answers");
    }
    answer
}

/// As a batch system does that asks a whole job to go.
#[test]
fn a_node_that_is_asked_to_go_joins_no_other_run_when_its_own_fails() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let hosts = "[[host]]\nname = 'here'\nnodes = 0\n[[host]]\nname = 'cloud'\nlaunch = 'external'\n";
    let path = topology(folder.path(), hosts);
    let (out, port, health_port) = (folder.path().join("out"), free_port(), free_port());
    let mut node = Process::join("marti-node", port, &out, &["--health", &format!("127.0.0.1:{health_port}")]);
    wait_until("an answer", || health(health_port).contains(" 503 "));
    let run = manager(&path, &out, port, &[&SLOW[..], &["cluster.nodes=1"]].concat());
    wait_until("work", || recorded_bytes(&out) > 64 << 10);
    assert!(health(health_port).contains(" 200 "), "{}", health(health_port));
    let servers = children(run.0.id(), 3, PATIENCE);
    let (_, bus) = servers.iter().find(|(name, _)| name.contains("bus")).expect("a bus");
    // So that it cannot bring its tiles to their end.
    signal(*bus, Signal::SIGSTOP);
    signal(node.0.id(), Signal::SIGTERM);
    std::thread::sleep(Duration::from_millis(300));
    signal(run.0.id(), Signal::SIGKILL);
    assert_eq!(node.code(), Some(0), "it goes");
    signal(*bus, Signal::SIGKILL);
}

#[test]
fn who_has_not_the_token_gets_no_place() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let hosts = "[[host]]\nname = 'here'\nnodes = 0\n[[host]]\nname = 'cloud'\nlaunch = 'external'\n";
    let path = topology(folder.path(), hosts);
    let (out, port) = (folder.path().join("out"), free_port());
    let run = manager(&path, &out, port, &["cluster.nodes=1"]);
    wait_until("the token", || out.join("join.token").exists());
    let wrong = folder.path().join("wrong.token");
    fs::write(&wrong, format!("{}\n", "ab".repeat(32))).expect("writable folder");
    let refused = |options: &[&str]| {
        let mut command = Command::new(program("marti-node"));
        let output = command.args(["--join", &format!("127.0.0.1:{port}"), "--patience", "0.5"]).args(options).output();
        let output = output.expect("the program can be started");
        assert_eq!(output.status.code(), Some(1));
        stderr(&output)
    };
    let token = wrong.to_str().expect("text");
    assert!(refused(&["--token", token]).contains("others can read the secret"), "its mode is not 600");
    let mut command = Command::new("chmod");
    assert!(command.args(["600", token]).status().expect("every system has it").success());
    assert!(refused(&["--token", token]).contains("has not the token of this run"));
    assert!(refused(&[]).contains("has not the token of this run"));
    assert!(refused(&["--token", "/nowhere"]).contains("/nowhere"));
    let right = out.join("join.token");
    let told = refused(&["--token", right.to_str().expect("text"), "--host", "nowhere"]);
    assert!(told.contains("no place at 127.0.0.1"), "{told}");
    signal(run.0.id(), Signal::SIGINT);
}

#[test]
fn other_addresses_than_loopback_need_keys() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = topology(folder.path(), "[[host]]\nname = 'here'\nbind = '0.0.0.0'\n");
    let output = run(&["run".as_ref(), path.as_os_str(), "--out".as_ref(), folder.path().join("out").as_os_str()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("0.0.0.0 is an address that other machines can reach"), "{}", stderr(&output));
    assert!(!folder.path().join("out").exists());
    let output = run(&["run", TEAPOT, "--listen", "0.0.0.0:0", "--out", "/nowhere"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn references_need_the_output_folder() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let hosts = "[[host]]\nname = 'here'\n[[host]]\nname = 'cloud'\nlaunch = 'external'\n";
    let path = topology(folder.path(), hosts);
    let out = folder.path().join("out");
    let mut command = marti();
    let output = command.arg("run").arg(path).args(["--record", "references", "--out"]).arg(out).output();
    let output = output.expect("marti can be started");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("nodes on cloud, which does not see the output folder"), "{}", stderr(&output));
}

/// A manager that is gone leaves nobody behind, also not on other machines.
#[test]
fn a_manager_that_is_killed_leaves_no_launched_process() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let hosts = "[[host]]\nname = 'here'\nnodes = 0\n[[host]]\nname = 'there'\nbind = '127.0.0.2'\nlaunch = ['env', '{program}']\n";
    let path = topology(folder.path(), hosts);
    let out = folder.path().join("out");
    let run = manager(&path, &out, free_port(), &[&SLOW[..], &["cluster.nodes=2"]].concat());
    wait_until("work", || recorded_bytes(&out) > 64 << 10);
    let pids: Vec<u32> = children(run.0.id(), 5, PATIENCE).into_iter().map(|(_, pid)| pid).collect();
    assert_eq!(pids.len(), 5);
    signal(run.0.id(), Signal::SIGKILL);
    wait_until("the end of all", || !pids.iter().any(|&pid| lives(pid)));
    std::io::stdout().flush().expect("open");
}
