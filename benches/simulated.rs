//! Schedules of what can go wrong, and what scheduling costs: `cargo bench --bench simulated`,
//! `-- --schedules 10000 --first 0` for so many seeds from that one on, `--hostile` with hostile processes beside the faults,
//! `--resumed` with an interrupt, and another run that resumes the first.
//!
//! Virtual time, but for what deciding costs: that is time on this host of all `handle` calls.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use cluster::processes::simulation::{End, Schedule, simulate};

const NODES: u16 = 200;
const TILES: u32 = 20_000;
/// Of deciding, a tile.
const DECIDING_MAX: Duration = Duration::from_micros(50);
/// As a master asks for, of each node.
const TILES_A_NODE_MAX: usize = 8;

fn main() {
    let schedules = argument("--schedules").unwrap_or(10_000);
    let named = |name: &str| std::env::args().any(|argument| argument == name);
    let kind = match (named("--hostile"), named("--resumed")) {
        (true, _) => Schedule::hostile_of,
        (_, true) => Schedule::resumed_of,
        _ => Schedule::random,
    };
    let kept = campaign(argument("--first").unwrap_or(0), schedules, kind);
    let fast = [false, true].into_iter().all(scheduling);
    if !kept || !fast {
        std::process::exit(1);
    }
}

/// The number after `--name`.
fn argument(name: &str) -> Option<u64> {
    let arguments: Vec<String> = std::env::args().collect();
    arguments.windows(2).find(|pair| pair[0] == name)?[1].parse().ok()
}

#[derive(Default)]
struct Row {
    count: u64,
    sum: Duration,
    longest: Duration,
    seed: u64,
}

fn campaign(first: u64, schedules: u64, kind: fn(u64) -> Schedule) -> bool {
    let start = Instant::now();
    let mut rows: BTreeMap<(&str, String), Row> = BTreeMap::new();
    let [mut complete, mut missing, mut interrupted, mut failed, mut broken] = [0u64; 5];
    let (mut took, mut faults, mut reissued, mut verified, mut disagreements) = (Duration::ZERO, 0, 0, 0, 0);
    let (mut under_way, mut tiles_a_node) = (0, 0);
    for seed in first..first + schedules {
        let schedule = kind(seed);
        let outcome = simulate(&schedule, None);
        match outcome.end {
            Some(End::Complete) => complete += 1,
            Some(End::TilesMissing) => missing += 1,
            Some(End::Interrupted) => interrupted += 1,
            Some(End::Failed(_)) | None => failed += 1,
        }
        if !outcome.broken.is_empty() {
            broken += 1;
            println!("{schedule}\n{:#?}\n{:#?}", outcome.broken, outcome.incidents);
        }
        took += outcome.took;
        faults += outcome.recoveries.len();
        reissued += outcome.reissued;
        verified += outcome.compared.0;
        disagreements += outcome.compared.1;
        under_way = under_way.max(outcome.under_way_most);
        tiles_a_node = tiles_a_node.max(outcome.tiles_a_node_most);
        for recovery in outcome.recoveries.iter().filter(|recovery| recovery.alone) {
            let role = recovery.role.to_string();
            let role = role.split(' ').next().unwrap_or_default().to_owned();
            let row = rows.entry((recovery.kind.name(), role)).or_default();
            row.count += 1;
            row.sum += recovery.took;
            if recovery.took > row.longest {
                (row.longest, row.seed) = (recovery.took, seed);
            }
        }
    }
    println!("{schedules} schedules from seed {first}: {broken} broke an invariant");
    println!(
        "  {complete} complete, {missing} without nodes, {failed} failed, {interrupted} interrupted, each for a good reason"
    );
    println!(
        "  {faults} faults recovered from, {reissued} attempts again, {verified} tiles verified, {disagreements} disagreements"
    );
    println!("  at most {under_way} messages under way on a connection, {tiles_a_node} tiles a node with a master");
    println!("  {:.0} s of virtual time in {:.1} s\n", took.as_secs_f64(), start.elapsed().as_secs_f64());
    println!("from a fault to the next tile done, nothing else being wrong (heartbeat deadlines 1, 2 and 5 s):");
    println!("  {:8} {:8} {:>7} {:>11} {:>11} {:>8}", "fault", "of", "count", "mean, ms", "longest, ms", "seed");
    for ((what, role), row) in &rows {
        let mean = row.sum.as_secs_f64() * 1e3 / row.count as f64;
        let longest = row.longest.as_secs_f64() * 1e3;
        println!("  {what:8} {role:8} {:7} {mean:11.1} {longest:11.1} {:8}", row.count, row.seed);
    }
    broken == 0
}

/// Time on this host.
fn clock() -> Duration {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed()
}

fn scheduling(counted: bool) -> bool {
    let schedule = Schedule::large(NODES, TILES, counted);
    let outcome = simulate(&schedule, Some(clock));
    let a_tile = outcome.deciding / TILES;
    let memory = if counted { "less than all, every access counted" } else { "all" };
    println!("\n{NODES} nodes on one master, {TILES} tiles, local memory {memory}:");
    println!("  {:.2} us a tile in {} decisions", a_tile.as_secs_f64() * 1e6, outcome.decisions);
    println!(
        "  at most {} tiles out, {} a node; {} messages under way on a connection",
        outcome.out_most, outcome.tiles_a_node_most, outcome.under_way_most
    );
    outcome.broken.iter().for_each(|broken| println!("  {broken}"));
    outcome.broken.is_empty() && a_tile < DECIDING_MAX && outcome.tiles_a_node_most <= TILES_A_NODE_MAX
}
