//! Two nodes on one bus, whose every cycle is known by hand.

use std::convert::Infallible;

use serde_json::{Value, json};

use super::chrome::ChromeTrace;
use super::vcd::BusWaves;
use crate::hardware::specification::Bus;
use crate::hardware::transaction::Kind;
use crate::replay::contention::work::Step;
use crate::replay::contention::{Burst, ContentionSettings, Cycle, Observer, Transaction, simulate};
use ground::ids::{ClusterId, NodeId, TileId};

/// An address word, 2 cycles of latency, a word of data: 4 cycles each.
///
/// Both nodes begin a tile at once. Node 0 asks for its job (cycles 0 to 4), computes 6 cycles, and fetches (10 to 14).
/// Node 1 waits for its job (4 to 8), computes 3 cycles, and waits for its fetch from 11 on (14 to 18).
fn simulated(observer: &mut impl Observer, step: impl Fn(Step)) {
    let settings = ContentionSettings { nodes: 2, bus: Bus { latency: 2, ..Bus::DEFAULT } };
    let mut done = [0; 2];
    let mut workload = |node: NodeId, now: Cycle| {
        let tile = TileId(7 + u32::from(node.0));
        let count = &mut done[usize::from(node.0)];
        *count += 1;
        let (compute_cycles, kind) = match *count {
            1 => {
                step(Step::TileBegins { node, tile, now });
                (0, Kind::Job)
            }
            2 => {
                step(Step::Lacks { node, address: 64 + u64::from(node.0) });
                ([6, 3][usize::from(node.0)], Kind::Fetch)
            }
            _ => {
                step(Step::TileEnds { node, tile, now });
                return Ok::<_, Infallible>(None);
            }
        };
        Ok(Some(Burst { compute_cycles, transaction: Some(Transaction { kind, bytes: 4 }) }))
    };
    let Ok(outcome) = simulate(&settings, &mut workload, observer);
    assert_eq!((outcome.cycles, outcome.bus_busy_cycles), (18, 16));
}

/// Those of a phase and process, in the order of their times, as their names, times and durations.
fn events(trace: &Value, phase: &str, process: u64) -> Vec<(String, u64, u64)> {
    let all = trace["traceEvents"].as_array().expect("events");
    let chosen = all.iter().filter(|event| event["ph"] == phase && event["pid"] == process);
    chosen
        .map(|event| {
            let name = event["name"].as_str().expect("a name").to_owned();
            (name, event["ts"].as_u64().expect("a time"), event["dur"].as_u64().unwrap_or(0))
        })
        .collect()
}

fn named(events: &[(&str, u64, u64)]) -> Vec<(String, u64, u64)> {
    events.iter().map(|&(name, ts, duration)| (name.to_owned(), ts, duration)).collect()
}

/// The counter of a bus, with its times.
fn utilisation(trace: &Value, bus: u64) -> Vec<(u64, f64)> {
    let all = trace["traceEvents"].as_array().expect("events");
    let counter = all.iter().filter(|event| event["ph"] == "C" && event["pid"] == bus);
    let value = |event: &Value| (event["ts"].as_u64(), event["args"]["share"].as_f64());
    counter.map(|event| (value(event).0.expect("a time"), value(event).1.expect("a share"))).collect()
}

#[test]
fn chrome_by_hand() {
    let trace = ChromeTrace::new(Vec::new(), 5);
    for cluster in 0..2 {
        trace.cluster(ClusterId(cluster), 2);
        simulated(&mut &trace, |step| trace.step(step));
    }
    let trace: Value = serde_json::from_slice(&trace.finish().expect("into memory")).expect("JSON");
    // The bus, then its nodes; the second cluster's after those.
    for bus in [1, 4] {
        let holds =
            [("job of node 0", 0, 4), ("job of node 1", 4, 4), ("fetch of node 0", 10, 4), ("fetch of node 1", 14, 4)];
        assert_eq!(events(&trace, "X", bus), named(&holds));
        assert_eq!(events(&trace, "X", bus + 1), named(&[("job", 0, 4), ("fetch", 10, 4)]));
        assert_eq!(events(&trace, "X", bus + 2), named(&[("job", 0, 8), ("fetch", 11, 7)]));
        for (phase, times) in [("B", [0, 0]), ("E", [14, 18])] {
            assert_eq!(events(&trace, phase, bus + 1), named(&[("tile 7", times[0], 0)]));
            assert_eq!(events(&trace, phase, bus + 2), named(&[("tile 8", times[1], 0)]));
        }
        // Held from 0 to 8 and from 10 to 18.
        assert_eq!(utilisation(&trace, bus), [(0, 1.0), (5, 0.6), (10, 1.0), (15, 1.0), (18, 0.0)]);
    }
    let names: Vec<&Value> = trace["traceEvents"].as_array().expect("events").iter().collect();
    let names: Vec<&Value> =
        names.into_iter().filter(|event| event["name"] == "process_name").map(|event| &event["args"]["name"]).collect();
    let expected = ["cluster 0 bus", "cluster 0 node 0", "cluster 0 node 1", "cluster 1 bus"];
    assert_eq!(names[..4], expected.map(|name| json!(name)).iter().collect::<Vec<_>>());
    assert_eq!(trace["otherData"]["time"], "a microsecond stands for a cycle, of processors and bus alike");
}

#[test]
fn long_silence_is_one_window_of_zero() {
    let trace = ChromeTrace::new(Vec::new(), 10);
    trace.cluster(ClusterId(0), 1);
    let settings = ContentionSettings { nodes: 1, bus: Bus { latency: 2, ..Bus::DEFAULT } };
    let mut bursts = [1_000_000_008, 3].into_iter();
    let mut workload = |_, _| {
        let transaction = Some(Transaction { kind: Kind::Fetch, bytes: 4 });
        Ok::<_, Infallible>(bursts.next().map(|compute_cycles| Burst { compute_cycles, transaction }))
    };
    let Ok(_) = simulate(&settings, &mut workload, &mut &trace);
    let trace: Value = serde_json::from_slice(&trace.finish().expect("into memory")).expect("JSON");
    // Held from 8 to 12 and from 15 to 19 after the silence; the last window is cut.
    let t = 1_000_000_000u64;
    assert_eq!(utilisation(&trace, 1), [(0, 0.0), (10, 0.0), (t, 0.2), (t + 10, 6.0 / 9.0), (t + 19, 0.0)]);
}

#[test]
fn vcd_by_hand() {
    let waves = BusWaves::new(Vec::new(), ClusterId(3), 2);
    simulated(&mut &waves, |step| waves.step(step));
    let text = String::from_utf8(waves.finish().expect("into memory")).expect("text");
    let (header, values) = text.split_once("$enddefinitions $end\n").expect("an end of the definitions");
    for line in [
        "$timescale 1 ns $end",
        "$scope module cluster3 $end",
        "$var wire 1 b busy $end",
        "$var wire 2 w waiting [1:0] $end",
        "$var wire 64 a address [63:0] $end",
    ] {
        assert!(header.lines().any(|other| other == line), "{header}");
    }
    let expected = "\
#0
$dumpvars
0b
bx n
bx a
bx c
b00 w
$end
1b
b0 n
b100 c
b10 w
#4
b1 n
b00 w
#8
0b
bx n
bx c
#10
1b
b0 n
b1000000 a
b100 c
#11
b10 w
#14
b1 n
b1000001 a
b00 w
#18
0b
bx n
bx a
bx c
";
    assert_eq!(values, expected);
}

/// Fails after so many bytes.
struct Full(usize);

impl std::io::Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or_else(|| std::io::Error::other("the disk is full"))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_told_at_the_end() {
    for room in [0, 100, 500] {
        let trace = ChromeTrace::new(Full(room), 5);
        trace.cluster(ClusterId(0), 2);
        simulated(&mut &trace, |step| trace.step(step));
        assert_eq!(trace.finish().err().expect("no room").to_string(), "the disk is full");
        let waves = BusWaves::new(Full(room.min(300)), ClusterId(0), 2);
        simulated(&mut &waves, |step| waves.step(step));
        assert_eq!(waves.finish().err().expect("no room").to_string(), "the disk is full");
    }
}
