//! One run of a campaign.

use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

use crate::Options;
use crate::campaign::Outcome;
use crate::network::{Disturbed, LinkCut, Network, Spread};
use crate::undisturbed::quiet;

/// A run that takes longer hangs: undisturbed ones take some seconds at most.
const PATIENCE: Duration = Duration::from_secs(120);
const TOPOLOGY: &str = "tests/data/teapot-64.toml";

/// What its number decides.
pub(crate) struct Trial {
    pub(crate) number: u64,
    scene: (&'static str, u32),
    side: u32,
    sets: Vec<String>,
    /// Empty: no fault but those of the network.
    pub(crate) chaos: String,
    hosts: Option<(Spread, Vec<LinkCut>)>,
}

impl Trial {
    pub(crate) fn new(number: u64, options: &Options, network: Option<&Network>) -> Self {
        let mut random = Pcg64::seed_from_u64(number);
        let mut below = |limit: u32| ((u64::from(random.next_u32()) * u64::from(limit)) >> 32) as u32;
        let scene = [("teapot", 6), ("gears", 2), ("balls", 3), ("tetra", 5)][below(4) as usize];
        // Fetches over a network take their time.
        let side = if network.is_some() { [48, 64, 96] } else { [64, 96, 128] }[below(3) as usize];
        let memory = ["all", "1/4", "1/8", "4 KiB"][below(4) as usize];
        let clusters = if options.has("clusters") { 1 + below(3) } else { 1 };
        // Of three results two agree; one cluster's nodes have to be three for that. Three hosts have one each.
        let is_alone = clusters == 1 && (options.has("verify") || network.is_some());
        let nodes = (2 + below(3)).max(if is_alone { 3 } else { 2 });
        // Shorter than some of the stops and cuts, longer than the others.
        let heartbeat = f64::from(4 + below(12)) / 10.0;
        let mut sets = vec![
            format!("scene.procedural={}", scene.0),
            format!("scene.size={}", scene.1),
            format!("image.width={side}"),
            format!("image.height={side}"),
            format!("cluster.nodes={nodes}"),
            format!("cluster.local_memory.size={memory}"),
            format!("run.deadlines.heartbeat_seconds={heartbeat}"),
        ];
        if options.has("clusters") {
            sets.push(format!("cluster.count={clusters}"));
        }
        if options.has("verify") {
            sets.push(format!("run.verify={}", [0.02, 0.1][below(2) as usize]));
        }
        // One fault alone in half of the runs, so that its cost can be told.
        let faults = [1, 1, 1, 2, 3, 4][below(6) as usize];
        let kind = if options.has("servers") { "" } else { " node" };
        let mut chaos = format!("random({faults}{kind})");
        let corrupt = options.has("corrupt") && options.has("verify") && below(4) == 0;
        if corrupt {
            let fault = format!("corrupt node@{}%", 1 + below(90));
            chaos = if faults == 1 { fault } else { format!("{chaos}; {fault}") };
        }
        let hosts = network.map(|network| {
            let all = clusters * nodes;
            let joining = 1 + below(2).min(all - 3);
            let launched = 1 + below(all - joining - 1);
            let spread = Spread {
                nodes: [all - joining - launched, launched, joining],
                cluster: clusters - 1,
                display_on_second: below(4) == 0,
            };
            sets.push(network.hosts(&spread));
            let cuts = (0..[1, 1, 2][below(3) as usize]).map(|_| LinkCut {
                host: 2 + below(2),
                percent: 1 + below(90),
                time: Duration::from_millis(u64::from(100 + below(3000))),
            });
            (spread, cuts.collect())
        });
        // In half of the runs on three hosts the network alone is at fault.
        let chaos = if hosts.is_some() && below(2) == 0 { String::new() } else { format!("{chaos}; seed={number}") };
        Self { number, scene, side, sets, chaos, hosts }
    }

    /// What decides the image.
    pub(crate) fn image(&self) -> ((&'static str, u32), u32) {
        (self.scene, self.side)
    }

    /// The links' cuts are not in it.
    pub(crate) fn command_line(&self) -> String {
        let sets: String = self.sets.iter().map(|set| format!(" --set '{set}'")).collect();
        let chaos = if self.chaos.is_empty() { String::new() } else { format!(" --chaos '{}'", self.chaos) };
        format!("marti run {TOPOLOGY}{sets}{chaos}")
    }

    /// Of the links.
    pub(crate) fn cuts(&self) -> &[LinkCut] {
        self.hosts.as_ref().map_or(&[], |(_, cuts)| cuts)
    }

    pub(crate) fn run(&self, folder: &Path, network: Option<&Network>, expected: &str) -> Outcome {
        let out = folder.join("run");
        let _ = fs::remove_dir_all(&out);
        let marti = env!("CARGO_BIN_EXE_marti");
        let mut command = quiet(network.map_or_else(|| Command::new(marti), |network| network.on(1, marti)));
        command.args(["run", TOPOLOGY, "--quiet", "--out"]).arg(&out);
        command.args(self.sets.iter().flat_map(|set| ["--set", set]));
        if !self.chaos.is_empty() {
            command.args(["--chaos", &self.chaos]);
        }
        if let Some(network) = network {
            command.arg("--keys").arg(&network.keys);
        }
        let start = Instant::now();
        let process = command.spawn().expect("marti can be started");
        let (exit, disturbed) = match (network, &self.hosts) {
            (Some(network), Some((spread, cuts))) => self.watch(process, network, spread, cuts, &out.join("tiles")),
            _ => (end_of(process, PATIENCE), Disturbed::default()),
        };
        let seconds = start.elapsed().as_secs_f64();
        let report = fs::read_to_string(out.join("report.json")).ok();
        let report = report.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or(Value::Null);
        let tiles = &report["tiles"];
        let verdict = match exit {
            None => "hangs",
            Some(Some(3)) => "tiles missing",
            Some(Some(2)) => "refused",
            Some(code) if code != Some(0) => "failed",
            _ if report["image"]["sha256"] != expected => "wrong image",
            _ if tiles["done"] != tiles["total"] || tiles["total"].is_null() => "lost tiles",
            _ if report["conservation"]["holds"] == false => "books do not balance",
            _ => "good",
        };
        Outcome { verdict, exit: exit.flatten(), seconds, report, disturbed }
    }

    /// Cuts links until the run is over.
    fn watch(
        &self,
        process: Child,
        network: &Network,
        spread: &Spread,
        cuts: &[LinkCut],
        journal: &Path,
    ) -> (Option<Option<i32>>, Disturbed) {
        let _joiners = network.joiners(spread);
        // Pixels alone: what tells how far the run is need not be exact.
        let journal_bytes = 12 * u64::from(self.side) * u64::from(self.side);
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let over = || is_over.load(Ordering::Relaxed);
            let disturbed = scope.spawn(move || network.disturb(cuts, journal, journal_bytes, over));
            let exit = end_of(process, PATIENCE);
            is_over.store(true, Ordering::Relaxed);
            (exit, disturbed.join().expect("links can be cut"))
        })
    }
}

/// How a process ended; `None`: it did not, and was killed.
fn end_of(mut process: Child, patience: Duration) -> Option<Option<i32>> {
    let start = Instant::now();
    while start.elapsed() < patience {
        if let Some(status) = process.try_wait().expect("our own child") {
            return Some(status.code());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    process.kill().expect("our own child");
    process.wait().expect("our own child");
    None
}
