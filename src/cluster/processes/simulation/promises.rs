//! What every run keeps, whatever goes wrong in it.
//!
//! - It ends.
//! - If it calls itself complete, every tile is in the frame, once, with the right pixels, unless a node was corrupt and
//!   `verify` is 0. With `verify` above 0 wrong pixels are found and replaced, if corrupt nodes are wrong in different
//!   ways and at no time fewer than three nodes can be asked; where nobody is left to ask, the report says which tile is
//!   not verified, or the run fails.
//! - It fails or leaves tiles out only after as many faults as it takes to set its nodes, or its display, aside.
//! - The books that were closed balance.
//! - A master has eight tiles for each of its nodes at most, and the manager has no more attempts out than that.

use super::files;
use super::roles::Body;
use super::scenery;
use super::schedule::{Fault, Schedule, What};
use super::world::World;
use crate::processes::display::composition::Finished;
use crate::processes::manager::process::ProcessId;
use crate::processes::manager::rehearsal::End;
use crate::protocol::hello::Role;
use ground::ids::TileId;

/// Failures that set a place aside.
const FAILURES: usize = 3;
/// As a master asks for.
const TILES_A_NODE: usize = 8;

/// The promises that were not kept.
pub(super) fn broken(schedule: &Schedule, world: &World) -> Vec<String> {
    let mut broken = Vec::new();
    match world.manager.end() {
        None => {
            broken.push(format!("it does not end: {} tiles are missing", world.manager.missing()));
            broken.extend(world.manager.describe_missing());
        }
        Some(End::Complete) => complete(schedule, world, &mut broken),
        // Whatever a hostile process says may end a run, with that as its reason.
        Some(_) if !schedule.hostile.is_empty() => {}
        Some(end) => {
            if let Some(why) = unreasonable(schedule, world, &end) {
                broken.push(format!("{end:?} without a good reason: {why}"));
            }
        }
    }
    // Books that do not balance are the report's to show, where a hostile process keeps one of them.
    if let Some(conservation) = world.manager.conservation().filter(|_| schedule.hostile.is_empty()) {
        for check in conservation.checks.iter().filter(|check| !check.holds) {
            broken.push(format!("{}: {} and {}", check.name, check.left, check.right));
        }
    }
    // A hostile master gets as many as it asks for.
    if schedule.hostile.iter().any(|role| matches!(role, Role::Master(_))) {
        return broken;
    }
    if world.tiles_a_node > TILES_A_NODE {
        broken.push(format!("a master had {} tiles a node", world.tiles_a_node));
    }
    let out_max = TILES_A_NODE * usize::from(schedule.all_nodes());
    if world.most.out > out_max || world.most.wanted as usize > out_max {
        broken.push(format!("{} tiles were out, {} wanted, of {out_max}", world.most.out, world.most.wanted));
    }
    broken
}

/// What the display wrote, once it has.
fn image<'a>(world: &'a World<'_>) -> Option<&'a Finished> {
    let mut displays = world.bodies.iter().rev().flatten().filter_map(|body| match body {
        Body::Display(display) => display.worker.finished.as_ref(),
        _ => None,
    });
    displays.next()
}

/// Tiles of the image that are not what they should be.
pub(super) fn wrong_tiles(schedule: &Schedule, world: &World) -> Vec<TileId> {
    let Some(image) = image(world) else { return Vec::new() };
    let tiles = (0..schedule.tiles()).map(TileId).filter(|tile| world.manager.accepted(*tile).is_some());
    let right = scenery::colours(schedule.tiles());
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
    let is_verified = schedule.play.run.verify > 0.0
        && !world.manager.incidents().iter().any(|incident| incident.text.contains("is not verified"));
    for tile in wrong_tiles(schedule, world) {
        let is_corrupt = |(node, epoch)| world.corrupted.contains(&ProcessId { role: Role::Node(node), epoch });
        if is_verified || !files::source(&world.journal, tile).is_some_and(is_corrupt) {
            broken.push(format!("{tile} is wrong"));
        }
    }
}

/// Why such an end does not fit the faults.
fn unreasonable(schedule: &Schedule, world: &World, end: &End) -> Option<String> {
    let faults = |chosen: fn(&Fault) -> bool| schedule.faults.iter().filter(|fault| chosen(fault)).count();
    let is_display = |fault: &Fault| fault.role == Role::Display;
    let (display, others) = (faults(is_display), faults(|fault| fault.role != Role::Display));
    let corrupt = schedule.corrupt_nodes();
    match end {
        // A straggler's second attempt, compared when all tiles were there already: one of the two is wrong.
        End::Failed(why) if why.contains("after the last tile") => (corrupt == 0).then(|| why.clone()),
        End::Failed(why) if why.contains("disagree") => (corrupt == 0
            || usize::from(schedule.all_nodes()) > 2 * corrupt && others < corrupt + FAILURES)
            .then(|| format!("{why}; {corrupt} of {} nodes were corrupt", schedule.all_nodes())),
        End::Failed(why) => (display < FAILURES).then(|| format!("{why}; {display} faults of the display")),
        End::TilesMissing => {
            let aside = world.manager.incidents().iter().filter(|i| i.text.contains("is set aside")).count();
            let kills = others - faults(|fault| fault.what == What::Corrupt);
            (kills < FAILURES && corrupt < usize::from(schedule.all_nodes()) || aside == 0)
                .then(|| format!("{others} faults of others than the display, {aside} set aside"))
        }
        End::Complete => None,
    }
}
