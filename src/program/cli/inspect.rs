//! `marti inspect SCENE`

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::options::{OctreeOptions, RecordOptions, TextOrJson};
use super::{Failure, json, output_path, print};
use crate::study::page::table::grouped;
use cluster::processes::scene_warnings;
use cluster::report::incident;
use cluster::report::{Bounds, Camera};
use ground::atomic_file;
use trace::database::Section;
use trace::database::verify::Verified;
use trace::picture::ImageSettings;
use trace::preparation::{self, BuildChoices, ChosenView, ImageDefaults, ViewChoices};
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;
use trace::tracer::octree::census::{Census, Level};

/// Print the database of a scene by section, and its octree by level
#[derive(Clone, Debug, Args)]
pub struct InspectArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, slivers, plane, decades, giant, corner, also with a size as in gears:2
    pub scene: SceneSource,
    #[command(flatten)]
    octree: OctreeOptions,
    #[command(flatten)]
    records: RecordOptions,
    /// Write the database's bytes to a file, as they are in cluster memory (docs/model.md)
    #[arg(long, value_name = "FILE")]
    database: Option<PathBuf>,
    /// How the result is printed
    #[arg(long, value_enum, default_value_t = TextOrJson::Text)]
    format: TextOrJson,
    /// As --format json
    #[arg(long, hide = true, conflicts_with = "format")]
    json: bool,
}

pub(super) fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    if let Some(file) = &arguments.database {
        output_path::check(file)?;
    }
    let choices =
        BuildChoices { octree: arguments.octree.octree(Octree::DEFAULT), records: arguments.records.layout()? };
    let scene = arguments.scene.load()?;
    if let Some(file) = &arguments.database {
        let mut read: Vec<&Path> = scene.libraries.iter().map(PathBuf::as_path).collect();
        if let SceneSource::File(scene) = &arguments.scene {
            read.push(scene);
        }
        output_path::check_apart(&[("--database", file)], &read)?;
    }
    let image = |defaults: &ImageDefaults| {
        let (width, height) = defaults.resolution;
        ImageSettings::new(width, height, 0, 0.0).map_err(|error| error.to_string())
    };
    let chosen = preparation::choose(&scene, &ViewChoices::default(), image).map_err(Failure::bad_input)?;
    let (database, warnings) = preparation::build(&arguments.scene, scene, choices)?;
    scene_warnings::show(warnings.iter().chain(&chosen.warnings));
    if let Some(file) = &arguments.database {
        atomic_file::write(file, |out| out.write_all(database.database().bytes()))
            .map_err(|error| Failure::failed(error.to_string()))?;
    }
    let inspection = Inspection::of(arguments.scene.to_string(), &chosen, &database);
    print(&match arguments.format {
        TextOrJson::Text if !arguments.json => inspection.text(),
        _ => json(&inspection)?,
    })
}

/// What a database consists of.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Inspection {
    scene: String,
    /// Polygons, spheres and cones as in the scene.
    scene_primitives: u64,
    /// Triangles, spheres and cones as in the database.
    primitives: u64,
    database_bytes: u64,
    bytes_per_primitive: f64,
    /// Left out where there are no primitives.
    #[serde(skip_serializing_if = "Option::is_none")]
    bounds: Option<Bounds>,
    camera: Camera,
    sections: Vec<SectionRow>,
    octree: OctreeTotals,
    /// By level, from the root's on.
    levels: Vec<LevelRow>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
struct SectionRow {
    section: &'static str,
    base: u64,
    records: u64,
    record_bytes: u64,
    bytes: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct OctreeTotals {
    nodes: u64,
    branches: u64,
    leaves: u64,
    empty_leaves: u64,
    references: u64,
    references_per_primitive: f64,
    depth: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct LevelRow {
    nodes: u64,
    branches: u64,
    leaves: u64,
    empty_leaves: u64,
    references: u64,
}

impl Inspection {
    fn of(scene: String, chosen: &ChosenView, database: &Verified) -> Self {
        let header = &database.database().header;
        let layout = &header.layout;
        let section = |section: Section| SectionRow {
            section: section.name(),
            base: layout.span(section).base.0,
            records: layout.span(section).records,
            record_bytes: layout.record_bytes(section),
            bytes: layout.section_bytes(section),
        };
        let primitives = layout.span(Section::Surfaces).records;
        let each = |count: u64| if primitives == 0 { 0.0 } else { count as f64 / primitives as f64 };
        let census = Census::of(database);
        let LevelRow { nodes, branches, leaves, empty_leaves, references } = LevelRow::of(&census.total());
        Self {
            scene,
            scene_primitives: header.scene_primitives,
            primitives,
            database_bytes: layout.database_bytes(),
            bytes_per_primitive: each(layout.database_bytes()),
            bounds: chosen.bounds.map(Bounds::new),
            camera: chosen.into(),
            sections: Section::ALL.map(section).to_vec(),
            octree: OctreeTotals {
                nodes,
                branches,
                leaves,
                empty_leaves,
                references,
                references_per_primitive: each(references),
                depth: census.depth(),
            },
            levels: census.levels.iter().map(LevelRow::of).collect(),
        }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "scene     {}, {} primitives", incident::line(&self.scene), grouped(self.scene_primitives))?;
        if let Some(bounds) = &self.bounds {
            writeln!(out, "bounds    {bounds}")?;
        }
        writeln!(out, "camera    {}", self.camera)?;
        writeln!(
            out,
            "database  {} bytes for {} primitives after triangulation, {:.1} bytes each\n",
            grouped(self.database_bytes),
            grouped(self.primitives),
            self.bytes_per_primitive
        )?;
        writeln!(out, "{:<14}{:>14}{:>14}{:>14}{:>16}", "section", "base, bytes", "records", "bytes each", "bytes")?;
        for SectionRow { section, base, records, record_bytes, bytes } in &self.sections {
            let [base, records, bytes] = [base, records, bytes].map(|&count| grouped(count));
            writeln!(out, "{section:<14}{base:>14}{records:>14}{record_bytes:>14}{bytes:>16}")?;
        }
        let octree = &self.octree;
        writeln!(
            out,
            "\noctree    {} nodes: {} branches, {} leaves, {} empty leaves; depth {}\n          {} references, {:.2} per primitive\n",
            grouped(octree.nodes),
            grouped(octree.branches),
            grouped(octree.leaves),
            grouped(octree.empty_leaves),
            octree.depth,
            grouped(octree.references),
            octree.references_per_primitive
        )?;
        writeln!(
            out,
            "{:<7}{:>14}{:>14}{:>14}{:>14}{:>16}",
            "level", "nodes", "branches", "leaves", "empty", "references"
        )?;
        for (level, LevelRow { nodes, branches, leaves, empty_leaves, references }) in self.levels.iter().enumerate() {
            let [nodes, branches, leaves, empty, references] =
                [nodes, branches, leaves, empty_leaves, references].map(|&count| grouped(count));
            writeln!(out, "{level:<7}{nodes:>14}{branches:>14}{leaves:>14}{empty:>14}{references:>16}")?;
        }
        Ok(())
    }
}

impl LevelRow {
    fn of(level: &Level) -> Self {
        Self {
            nodes: level.nodes(),
            branches: level.branches,
            leaves: level.leaves,
            empty_leaves: level.empty_leaves,
            references: level.references,
        }
    }
}
