//! `marti replay RECORDING --origins`, `--heat-map`: where misses come from.

use std::io::BufWriter;
use std::path::Path;

use serde::Serialize;

use crate::cli::grid_options::{SETTINGS, TIMES};
use crate::cli::table::{Format, Table};
use crate::cli::{Failure, print};
use ground::atomic_file;
use machine::hardware::local_memory::{Geometry, MemoryShape};
use machine::recording::references::Recording;
use machine::replay::model::counts::ratio;
use machine::replay::model::node::replay_node;
use machine::replay::model::replayer::Counters;
use machine::replay::origin::heat_map::{self, Scale};
use machine::replay::origin::origins::{Origins, OriginsTally};
use machine::replay::plan::schedule::schedule;
use machine::replay::plan::setting::{Assignment, Setting};
use trace::database::Section;
use trace::tracer::RayKind;

/// What is drawn.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(super) enum HeatMap {
    /// Record misses by pixel
    Misses,
    /// Octree nodes read by pixel
    Octree,
}

#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    setting: Setting,
    #[serde(flatten)]
    memory: MemoryShape,
    /// By what the row is counted: section, octree level, ray kind or tile.
    by: &'static str,
    name: String,
    record_accesses: u64,
    misses: u64,
    /// Of all misses.
    share_of_misses: f64,
    misses_per_record_access: f64,
    line_misses: u64,
}

fn counted(recording: &Recording, setting: &Setting) -> Result<Origins, Failure> {
    if setting.assignment == Assignment::OnDemand {
        return Err(Failure::bad_input("origins need a fixed assignment: expected recorded or interleaved"));
    }
    let geometry = geometry(recording, setting)?;
    let Recording { layout, octree_levels, tiling, .. } = recording;
    let mut tally = OriginsTally::new(recording, layout, octree_levels, *tiling);
    for processes in &schedule(recording, setting).nodes {
        replay_node(recording, processes, setting.replacement, geometry, &mut tally)
            .map_err(|error| Failure::bad_input(error.to_string()))?;
    }
    Ok(tally.origins)
}

fn geometry(recording: &Recording, setting: &Setting) -> Result<Geometry, Failure> {
    Geometry::new(&setting.memory(), &recording.layout)
        .map_err(|error| Failure::bad_input(format!("local memory: {error}")))
}

fn one(settings: &[Setting]) -> Result<&Setting, Failure> {
    match settings {
        [one] => Ok(one),
        _ => Err(Failure::bad_input(format!("{} settings, expected one value of each option", settings.len()))),
    }
}

pub(super) fn print_origins(recording: &Recording, settings: &[Setting], format: Format) -> Result<(), Failure> {
    let setting = one(settings)?;
    let memory = geometry(recording, setting)?.into();
    let origins = counted(recording, setting)?;
    let all: u64 = origins.kinds.iter().map(|kind| kind.record_misses).sum();
    let mut rows = Vec::new();
    let mut add = |by: &'static str, name: String, totals: &Counters| {
        if totals.record_accesses > 0 {
            rows.push(Row {
                setting: *setting,
                memory,
                by,
                name,
                record_accesses: totals.record_accesses,
                misses: totals.record_misses,
                share_of_misses: ratio(totals.record_misses, all),
                misses_per_record_access: ratio(totals.record_misses, totals.record_accesses),
                line_misses: totals.line_misses,
            });
        }
    };
    Section::ALL.iter().zip(&origins.sections).for_each(|(one, totals)| add("section", one.name().to_owned(), totals));
    origins.levels.iter().enumerate().for_each(|(level, totals)| add("octree level", level.to_string(), totals));
    RayKind::ALL.iter().zip(&origins.kinds).for_each(|(kind, totals)| add("ray kind", kind.name().to_owned(), totals));
    let mut tiles: Vec<_> = origins.tiles.iter().enumerate().collect();
    if format == Format::Text {
        // For people, the tiles that miss most.
        tiles.sort_by_key(|(tile, totals)| (std::cmp::Reverse(totals.record_misses), *tile));
        tiles.truncate(10);
    }
    tiles.into_iter().for_each(|(tile, totals)| add("tile", tile.to_string(), totals));
    print(&Table::new(&rows)?.hiding(&[&TIMES]).print(format, &SETTINGS))
}

pub(super) fn draw(recording: &Recording, settings: &[Setting], what: HeatMap, out: &Path) -> Result<(), Failure> {
    let setting = one(settings)?;
    let origins = counted(recording, setting)?;
    let value = |pixel: &machine::replay::origin::origins::PixelCounts| match what {
        HeatMap::Misses => pixel.record_misses,
        HeatMap::Octree => pixel.octree_accesses,
    };
    let counts: Vec<u64> = origins.pixels.iter().map(value).collect();
    let scale = if what == HeatMap::Misses { Scale::Logarithmic } else { Scale::Linear };
    let mut range = None;
    atomic_file::write(out, |file| {
        range = Some(heat_map::write(&mut BufWriter::new(file), &counts, recording.tiling.sides().width, scale)?);
        Ok(())
    })
    .map_err(|error| Failure::failed(error.to_string()))?;
    let (min, max) = range.map_or((0, 0), |range| (range.min, range.max));
    let (unit, scale) = match what {
        HeatMap::Misses => ("misses", "logarithmic"),
        HeatMap::Octree => ("octree nodes read", "linear"),
    };
    // Which octree nodes are read does not depend on a setting.
    let heading = match what {
        HeatMap::Misses => Table::new(std::slice::from_ref(setting))?.hiding(&[&TIMES]).heading(&SETTINGS) + "\n\n",
        HeatMap::Octree => String::new(),
    };
    print(&format!("{heading}{}: {min} to {max} {unit} per pixel, {scale}\n", out.display()))
}
