//! What must be true of every run, whatever goes wrong in it.
//!
//! - It ends.
//! - If it calls itself complete, every tile is in the frame, once, with the right pixels and its books hold, unless a node
//!   was corrupt and `verify` is 0. With `verify` above 0 wrong pixels are found and replaced, if corrupt nodes are wrong in
//!   different ways and at no time fewer than three nodes can be asked; where no node is left to ask, the report says which
//!   tile is not verified, or the run fails. No tile of a condemned process is in the frame.
//! - It fails or leaves tiles out only after as many faults as it takes to set its nodes, or its display, aside. Hostile nodes
//!   alone make no run fail, unless what they sent was found after the last tile or only in the books.
//! - The books that were closed balance, but for checks of what a hostile process counted. What an honest node counted in its
//!   accepted tiles is in the report.
//! - A hostile node whose forgery an honest display, master or the manager read is condemned. An honest process is condemned
//!   only where the display or the master of its cluster is hostile.
//! - After an interrupt, an honest display's journal has no tile of a condemned process. The run that resumes it has none in
//!   its image.
//! - Every queue has its bound (`bounds`).

use std::collections::HashSet;

use super::files;
use super::roles::Process;
use super::schedule::{Fault, FaultKind, Schedule};
use super::test_scene;
use super::world::World;
use crate::processes::display::composition::Finished;
use crate::processes::manager::simulated::{BOOKS, End};
use crate::protocol::hello::Role;
use ground::ids::{ClusterId, NodeId, Producer, TileId};

/// Failures that set a place aside.
const FAILURES: usize = 3;
/// Of one process, as the manager says.
const INCIDENTS_MAX: usize = 100;

/// The invariants that do not hold.
pub(super) fn broken(schedule: &Schedule, world: &World) -> Vec<String> {
    let mut broken = Vec::new();
    match world.manager.end() {
        None => {
            broken.push(format!("it does not end: {} tiles are missing", world.manager.missing()));
            broken.extend(world.manager.describe_missing());
        }
        Some(End::Complete) => complete(schedule, world, &mut broken),
        Some(End::Interrupted) if schedule.interrupt.is_some() => interrupted(schedule, world, &mut broken),
        // What a hostile server says may end a run, with that as its reason.
        Some(_) if schedule.hostile.iter().any(|role| !matches!(role, Role::Node(_))) => {}
        Some(end) => {
            if let Some(why) = unreasonable(schedule, world, &end) {
                broken.push(format!("{end:?} without a good reason: {why}"));
            }
        }
    }
    unbalanced(schedule, world, &mut broken);
    condemned(schedule, world, &mut broken);
    let kept = world.manager.incidents();
    for process in world.processes.iter().flatten().map(|process| process.child().id) {
        let of = format!("{process}: ");
        let incidents = kept.iter().filter(|incident| incident.text.starts_with(&of)).count();
        if incidents > INCIDENTS_MAX {
            broken.push(format!("{incidents} incidents of {process} are kept, of {INCIDENTS_MAX} at most"));
        }
    }
    let (lost, issued) = world.manager.lost_and_issued();
    if lost > issued {
        broken.push(format!("{lost} attempts are listed as lost, and {issued} were issued"));
    }
    broken.extend(world.excess.clone());
    broken
}

/// The cluster of a node, or of a server.
fn cluster(schedule: &Schedule, role: Role) -> Option<ClusterId> {
    match role {
        Role::Bus(cluster) | Role::Master(cluster) => Some(cluster),
        Role::Node(node) => Some(ClusterId(node.0 / schedule.scenario.nodes)),
        Role::Manager | Role::Display => None,
    }
}

fn unbalanced(schedule: &Schedule, world: &World, broken: &mut Vec<String>) {
    let is_hostile = |role: Role| schedule.hostile.contains(&role);
    let Some(conservation) = world.manager.conservation() else { return };
    for check in conservation.checks.iter().filter(|check| !check.holds) {
        let of = |cluster: &ClusterId| check.name.starts_with(&format!("{cluster} ("));
        let clusters = (0..schedule.scenario.clusters).map(ClusterId);
        let mut of_check: Vec<_> = clusters.clone().filter(of).collect();
        if of_check.is_empty() {
            of_check.extend(clusters);
        }
        let by_bus = ["logged fetches", "fetched bytes", "log rows"].iter().any(|name| check.name.contains(name));
        let by_master = !by_bus && check.name.contains("attempts");
        let mut roles = schedule.hostile.iter().copied();
        let is_excused = if let Some(node) = check.name.strip_prefix("node ").and_then(|rest| rest.split(':').next()) {
            let node = Role::Node(NodeId(node.parse().unwrap_or_default()));
            is_hostile(node) || cluster(schedule, node).is_some_and(|cluster| is_hostile(Role::Master(cluster)))
        } else if by_master {
            of_check.iter().any(|cluster| is_hostile(Role::Master(*cluster)))
        } else {
            roles.any(|role| cluster(schedule, role).is_none_or(|of| of_check.contains(&of)))
        };
        if !is_excused {
            broken.push(format!("{}: {} and {}", check.name, check.left, check.right));
        }
    }
    for (node, (account, counted)) in (0..).zip(world.manager.accounts().iter().zip(&world.counted)) {
        let role = Role::Node(NodeId(node));
        let is_honest = |role: Role| !is_hostile(role);
        let is_condemned = world.manager.condemned().any(|process| process.node.0 == node);
        let master = cluster(schedule, role).is_some_and(|cluster| is_honest(Role::Master(cluster)));
        if is_honest(role) && master && !is_condemned && account != counted {
            broken.push(format!("{role} counted otherwise in its accepted tiles than is reported"));
        }
    }
}

fn condemned(schedule: &Schedule, world: &World, broken: &mut Vec<String>) {
    let is_hostile = |role: Role| schedule.hostile.contains(&role);
    let condemned: HashSet<_> = world.manager.condemned().collect();
    for process in &condemned {
        let role = Role::Node(process.node);
        let server = cluster(schedule, role).is_some_and(|cluster| is_hostile(Role::Master(cluster)));
        let is_excused = is_hostile(role) || server || is_hostile(Role::Display) || world.corrupted.contains(process);
        if !is_excused && !world.made_up_before.iter().any(|(by, ..)| by == process) {
            broken.push(format!("{process} is condemned, and is honest"));
        }
    }
    for (server, by) in &world.forgeries {
        let part = cluster(schedule, server.role);
        let is_troubled = schedule.troubles(server.role) || part.is_some_and(|part| schedule.troubles(Role::Bus(part)));
        if !condemned.contains(by) && !is_troubled {
            broken.push(format!("{by} sent a forgery, which {server} read, and is not condemned"));
        }
    }
}

fn interrupted(schedule: &Schedule, world: &World, broken: &mut Vec<String>) {
    if schedule.troubles(Role::Display) {
        return;
    }
    for process in world.manager.condemned().filter(|process| !files::is_rid_of(&world.journal, *process)) {
        broken.push(format!("{process} is condemned, and its tiles are in the journal of an interrupted run"));
    }
}

/// What the display wrote, once it has.
fn image<'a>(world: &'a World<'_>) -> Option<&'a Finished> {
    let mut displays = world.processes.iter().rev().flatten().filter_map(|process| match process {
        Process::Display(display) => display.worker.finished.as_ref(),
        _ => None,
    });
    displays.next()
}

/// Tiles of the image that are not what they should be.
pub(super) fn wrong_tiles(schedule: &Schedule, world: &World) -> Vec<TileId> {
    let Some(image) = image(world) else { return Vec::new() };
    let tiles = (0..schedule.tiles()).map(TileId).filter(|tile| world.manager.accepted(*tile).is_some());
    let right = test_scene::colours(schedule.tiles());
    let is_wrong = |tile: &TileId| image.frame.pixels().colour[tile.0 as usize] != right[tile.0 as usize];
    tiles.filter(is_wrong).collect()
}

fn complete(schedule: &Schedule, world: &World, broken: &mut Vec<String>) {
    let Some(image) = image(world) else {
        return broken.push("complete without an image".to_owned());
    };
    if image.tiles_done != schedule.tiles() {
        broken.push(format!("complete with {} of {} tiles", image.tiles_done, schedule.tiles()));
    }
    for tile in (0..schedule.tiles()).map(TileId).filter(|tile| world.manager.accepted(*tile).is_none()) {
        broken.push(format!("{tile} is not done"));
    }
    if world.manager.conservation().is_some_and(|conservation| !conservation.holds) {
        broken.push("complete with books that do not hold".to_owned());
    }
    let condemned: HashSet<_> = world.manager.condemned().chain(world.condemned_before.iter().copied()).collect();
    let is_rid_of = |process: &Producer| !condemned.contains(process) || files::is_rid_of(&world.journal, *process);
    for tile in (0..schedule.tiles()).map(TileId) {
        if let Some((by, _)) = files::source(&world.journal, tile).filter(|(by, _)| !is_rid_of(by)) {
            broken.push(format!("{tile} is of {by}, which is condemned"));
        }
    }
    let is_verified = schedule.scenario.run.verify > 0.0
        && !world.manager.incidents().iter().any(|incident| incident.text.contains("is not verified"));
    for tile in wrong_tiles(schedule, world) {
        let source = files::source(&world.journal, tile);
        let is_corrupt = source.is_some_and(|(by, _)| world.corrupted.contains(&by));
        // It lies now and then: `verify` may miss it.
        let is_made_up = source.is_some_and(|(by, attempt)| world.is_made_up(by, tile, attempt));
        if !is_made_up && (is_verified || !is_corrupt) {
            broken.push(format!("{tile} is wrong"));
        }
    }
}

/// Why such an end does not fit the faults.
fn unreasonable(schedule: &Schedule, world: &World, end: &End) -> Option<String> {
    let faults = |chosen: fn(&Fault) -> bool| schedule.faults.iter().filter(|fault| chosen(fault)).count();
    let is_display = |fault: &Fault| fault.role == Role::Display;
    let (display, others) = (faults(is_display), faults(|fault| fault.role != Role::Display));
    let hostile = schedule.hostile.len();
    let corrupt = schedule.corrupt_nodes().max(world.corrupted_nodes()) + hostile;
    match end {
        // A straggler's second attempt, compared when all tiles were there already: one of the two is wrong.
        End::Failed(why) if why.contains("after the last tile") => (corrupt == 0).then(|| why.clone()),
        End::Failed(why) if why.contains("disagree") => (corrupt == 0
            || usize::from(schedule.all_nodes()) > 2 * corrupt && others < corrupt + FAILURES)
            .then(|| format!("{why}; {corrupt} of {} nodes were corrupt", schedule.all_nodes())),
        End::Failed(why) if why.contains(BOOKS) && hostile > 0 => None,
        End::Failed(why) => (display < FAILURES).then(|| format!("{why}; {display} faults of the display")),
        End::TilesMissing => {
            let aside = world.manager.incidents().iter().filter(|i| i.text.contains("is set aside")).count();
            let kills = others - faults(|fault| fault.kind == FaultKind::Corrupt);
            (kills < FAILURES && corrupt < usize::from(schedule.all_nodes()) || aside == 0)
                .then(|| format!("{others} faults of others than the display, {aside} set aside"))
        }
        End::Complete | End::Interrupted => None,
    }
}
