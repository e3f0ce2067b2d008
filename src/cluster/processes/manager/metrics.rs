//! What the manager reports of the run while it goes on.

use super::process::{Process, Stage};
use super::state::State;
use crate::processes::health::{Health, Metric};
use crate::protocol::hello::Role;

/// Ready: a display and at least one cluster serve.
pub(super) fn health(state: &State) -> Health {
    let serving = state.clusters.iter().filter(|cluster| cluster.servers().is_some()).count();
    let ready = state.display.address.is_some() && (serving > 0 || !state.ending.is_running());
    let (total, missing) = (state.tiles.queue.total(), state.tiles.queue.missing());
    let mut metrics = vec![
        Metric::gauge("tiles", "Tiles of the image.", f64::from(total)),
        Metric::gauge("tiles_done", "Tiles that the display has.", f64::from(total - missing)),
        Metric::counter("tiles_reissued_total", "Attempts after a tile's first.", state.tiles.queue.reissued()),
        Metric::counter("tiles_verified_total", "Tiles rendered twice alike.", state.tiles.verification.verified()),
        Metric::counter(
            "disagreements_total",
            "Tiles rendered twice differently.",
            state.tiles.verification.disagreements(),
        ),
        Metric::counter("rays_total", "Rays of all kinds in accepted tiles.", state.tiles.ledger.rays()),
        Metric::counter("incidents_total", "What went wrong and was dealt with.", state.supervision.incidents.count()),
        Metric::gauge("clusters_serving", "Clusters whose bus has the database.", serving as f64),
        Metric::gauge("seconds", "Since the run began.", state.supervision.now.as_secs_f64()),
    ];
    for role in ["bus", "master", "node", "display"] {
        let is_at_work = |process: &&Process| {
            name(process.id.role) == role && (Stage::Serving..Stage::Finished).contains(&process.stage)
        };
        let count = state.supervision.table.iter().filter(is_at_work).count();
        metrics.push(Metric::gauge("processes", "Processes at work.", count as f64).of("role", role));
    }
    Health { ready, metrics }
}

fn name(role: Role) -> &'static str {
    match role {
        Role::Manager => "manager",
        Role::Bus(_) => "bus",
        Role::Master(_) => "master",
        Role::Node(_) => "node",
        Role::Display => "display",
    }
}
