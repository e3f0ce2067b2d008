//! Closed meshes are closed.

use std::process::Command;

use serde_json::Value;

/// Case 3: of ten million rays from inside of closed meshes, aimed exactly at shared edges and vertices and dealt
/// out to all kernels, none escapes. A thousand million:
///
///     marti verify --watertight --rays 1000000000
#[test]
fn no_ray_escapes_a_closed_mesh() {
    const RAYS: u64 = 10_000_000;
    let mut marti = Command::new(env!("CARGO_BIN_EXE_marti"));
    let output = marti.args(["verify", "--watertight", "--json", "--rays", &RAYS.to_string()]).output();
    let output = output.expect("marti can be started");
    let report: Value = serde_json::from_slice(&output.stdout).expect("a report is JSON");
    assert!(output.status.success(), "{report:#}");
    let kernels = report["kernels"].as_array().expect("a list");
    let sum = |what: &str| kernels.iter().map(|kernel| kernel[what].as_u64().expect("a count")).sum::<u64>();
    assert_eq!((sum("rays"), sum("escapes")), (RAYS, 0), "{report:#}");
    let kernels: Vec<_> = kernels.iter().map(|kernel| kernel["kernel"].as_str().expect("a name").to_owned()).collect();
    assert_eq!(kernels, trace::oracle::Kernel::available().iter().map(ToString::to_string).collect::<Vec<_>>());
}
