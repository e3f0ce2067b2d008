//! From the file as written to a [`Topology`]: what its types alone cannot tell is checked here.

use std::path::{Path, PathBuf};
use std::time::Duration;

use glam::DVec3;

use super::document::Document;
use super::file::{self, File};
use super::value::{Channel, Coordinate, Quantum, RecordBytes, Seconds};
use super::{Deadlines, Image, Run, Topology, prove_hosts};
use machine::hardware::specification::{Arbiter, Bus, Cluster, LocalMemory, MemorySize, Processor};
use trace::database::RecordLayout;
use trace::picture::ImageSettings;
use trace::preparation::{CameraChoices, ViewChoices};
use trace::scene::SceneSource;
use trace::scene::procedural::Procedural;
use trace::scene::{Light, SourceError};
use trace::tracer::octree::Octree;

type Result<T> = std::result::Result<T, SourceError>;

/// Tiles are square with this side where the file says nothing, pixels.
const TILE_SIDE: u32 = 16;

/// Nodes that verification needs.
const VERIFY_NODES_MIN: u16 = 3;

/// # Errors
/// The first combination of values that is not possible.
pub(super) fn prove(path: &Path, written: &File, document: &Document<'_>) -> Result<Topology> {
    let camera = written.camera.as_ref().map(|camera| prove_camera(camera, document)).transpose()?.unwrap_or_default();
    let light = |light: &file::Light| Light { position: point(light.position), colour: colour(light.colour) };
    let cluster = cluster(&written.cluster, document)?;
    Ok(Topology {
        hosts: prove_hosts::prove(written, &cluster, document)?,
        name: name(path, written, document)?,
        scene: source(path, &written.scene, document)?,
        view: ViewChoices {
            camera,
            lights: written.light.iter().map(light).collect(),
            background: written.scene.background.map(colour),
            up: written.scene.up,
        },
        image: image(&written.image, document)?,
        octree: Octree {
            leaf_size: written.octree.leaf_size.0,
            max_depth: written.octree.max_depth.0,
            mailbox: written.octree.mailbox,
        },
        records: records(&written.database, document)?,
        cluster,
        run: Run {
            order: written.run.order,
            assignment: written.run.assignment,
            seed: written.run.seed.0,
            verify: verify(written, document)?,
            threads: threads(&written.cluster, document)?,
            deadlines: deadlines(&written.run.deadlines),
        },
    })
}

const NAME_BYTES_MAX: usize = 255;

/// Whether a folder of this name is where it is made.
pub(super) fn is_folders_name(name: &str) -> bool {
    let leads_elsewhere = matches!(name, "" | "." | "..") || name.contains(['/', '\\']);
    !leads_elsewhere && name.len() <= NAME_BYTES_MAX && !name.contains(char::is_control)
}

/// The name becomes that of a folder: it may not lead anywhere else.
fn name(path: &Path, written: &File, document: &Document<'_>) -> Result<String> {
    let stem = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = written.topology.name.clone().unwrap_or_else(stem);
    if !is_folders_name(&name) {
        let what = format!(
            "topology.name is {name:?}, expected the name of a folder: 1 to {NAME_BYTES_MAX} bytes, no slashes, not . or .."
        );
        return Err(document.error(&["topology.name"], what));
    }
    Ok(name)
}

fn source(path: &Path, written: &file::Scene, document: &Document<'_>) -> Result<SceneSource> {
    match (&written.file, written.procedural) {
        (Some(_), Some(_)) => {
            let what = "both scene.file and scene.procedural are given, expected one of them";
            Err(document.error(&["scene.procedural", "scene.file"], what))
        }
        (None, None) => {
            let what = "no scene is given, expected scene.file or scene.procedural";
            Err(document.error(&["scene"], what))
        }
        (Some(_), None) if written.size.is_some() => {
            let what = "scene.size has no meaning for a file, expected it with scene.procedural only";
            Err(document.error(&["scene.size"], what))
        }
        (Some(_), None) if written.board.is_some() => {
            let what = "scene.board has no meaning for a file, expected it with scene.procedural = \"teapot\" only";
            Err(document.error(&["scene.board"], what))
        }
        (Some(file), None) if file.is_empty() => {
            Err(document.error(&["scene.file"], "scene.file is empty, expected the path of an .nff or .obj file"))
        }
        (Some(file), None) => {
            let folder = path.parent().filter(|_| !document.is_overridden("scene.file"));
            Ok(SceneSource::File(folder.map_or_else(|| PathBuf::from(file), |folder| folder.join(file))))
        }
        (None, Some(kind)) => {
            let scene = Procedural::new(kind, written.size.map(|size| size.0))
                .map_err(|what| document.error(&["scene.size", "scene.procedural"], format!("scene.size: {what}")))?;
            let scene = written.board.map_or(Ok(scene), |board| scene.on(board));
            let refused = |what| document.error(&["scene.board"], format!("scene.board: {what}"));
            scene.map(SceneSource::Procedural).map_err(refused)
        }
    }
}

/// What is left out is known when the scene is: the whole is checked again then.
fn prove_camera(written: &file::Camera, document: &Document<'_>) -> Result<CameraChoices> {
    let [from, at, up] = [written.from, written.at, written.up].map(|written| written.map(point));
    let camera = CameraChoices { from, at, up, angle_degrees: written.angle.map(|angle| angle.0) };
    if camera.parts().is_empty() {
        return Err(document.error(&["camera"], "camera is empty, expected at least one of from, at, up, angle"));
    }
    let keys = ["camera", "camera.from", "camera.at", "camera.up", "camera.angle"];
    camera.check().map_err(|what| document.error(&keys, format!("camera: {what}")))?;
    Ok(camera)
}

fn image(written: &file::Image, document: &Document<'_>) -> Result<Image> {
    let (width, height) = (written.width.map(|side| side.0), written.height.map(|side| side.0));
    let default_side = |side: Option<u32>| TILE_SIDE.min(side.unwrap_or(ImageSettings::SIDE_MAX));
    let tile = written.tile.map_or_else(|| (default_side(width), default_side(height)), |tile| (tile.0, tile.1));
    let file::Image { depth, cutoff, terminator, .. } = *written;
    let image = Image { width, height, tile, depth: depth.0, cutoff: cutoff.0, terminator };
    let keys = ["image.tile", "image.width", "image.height"];
    image.check_tile(width, height).map_err(|what| document.error(&keys, what))?;
    Ok(image)
}

fn records(written: &file::Database, document: &Document<'_>) -> Result<RecordLayout> {
    let bytes = written.record_bytes.map(|RecordBytes(bytes)| bytes);
    RecordLayout::new(written.records, written.numbers, bytes)
        .map_err(|what| document.error(&["database.record_bytes"], format!("database.record_bytes: {what}")))
}

fn cluster(written: &file::Cluster, document: &Document<'_>) -> Result<Cluster> {
    Ok(Cluster {
        count: written.count.0,
        nodes: written.nodes.0,
        processor: processor(&written.processor),
        local_memory: local_memory(&written.local_memory, document)?,
        bus: bus(&written.bus, document)?,
    })
}

/// A local memory is that of one tracer.
fn threads(written: &file::Cluster, document: &Document<'_>) -> Result<u16> {
    let threads = written.threads.0;
    if threads > 1 && written.local_memory.size.0 != MemorySize::All {
        let what = format!(
            "cluster.threads is {threads}, expected 1, or cluster.local_memory.size = \"all\": a local memory is that of one thread"
        );
        return Err(document.error(&["cluster.threads"], what));
    }
    Ok(threads)
}

fn processor(written: &file::Processor) -> Processor {
    Processor {
        octree_node: written.octree_node.0,
        primitive_test: written.primitive_test.0,
        shading: written.shading.0,
        local_access: written.local_access.0,
    }
}

fn local_memory(written: &file::LocalMemory, document: &Document<'_>) -> Result<LocalMemory> {
    let line = written.line.0;
    let bytes_min = u64::from(line) * LocalMemory::LINES_MIN;
    if let MemorySize::Bytes(bytes) = written.size.0
        && bytes < bytes_min
    {
        let what = format!(
            "cluster.local_memory.size is {bytes} bytes, expected at least {bytes_min}: {} lines of {line} bytes",
            LocalMemory::LINES_MIN
        );
        return Err(document.error(&["cluster.local_memory.size", "cluster.local_memory.line"], what));
    }
    Ok(LocalMemory {
        size: written.size.0,
        line,
        ways: written.ways.map(|ways| ways.0),
        replacement: written.replacement,
    })
}

fn bus(written: &file::Bus, document: &Document<'_>) -> Result<Bus> {
    Ok(Bus {
        arbiter: arbiter(written, document)?,
        width: written.width.0,
        cycles_per_word: written.cycles_per_word.0,
        latency: written.latency.0,
        transactions: written.transactions,
    })
}

fn arbiter(written: &file::Bus, document: &Document<'_>) -> Result<Arbiter> {
    match (written.arbiter, written.quantum) {
        (file::Arbiter::RoundRobin, quantum) => {
            Ok(Arbiter::RoundRobin { quantum: quantum.map_or(1, |Quantum(quantum)| quantum) })
        }
        (file::Arbiter::Fifo, None) => Ok(Arbiter::Fifo),
        (file::Arbiter::FixedPriority, None) => Ok(Arbiter::FixedPriority),
        (_, Some(_)) => {
            let what = "cluster.bus.quantum has no meaning here, expected it with arbiter = \"round_robin\" only";
            Err(document.error(&["cluster.bus.quantum"], what))
        }
    }
}

/// Two nodes disagree, a third one settles it.
fn verify(written: &File, document: &Document<'_>) -> Result<f64> {
    let verify = written.run.verify.0;
    let nodes = written.cluster.count.0 * written.cluster.nodes.0;
    if verify > 0.0 && nodes < VERIFY_NODES_MIN {
        let what = format!(
            "run.verify is {verify} with {nodes} nodes, expected at least {VERIFY_NODES_MIN}: where two disagree, a third one settles it"
        );
        return Err(document.error(&["run.verify", "cluster.nodes"], what));
    }
    Ok(verify)
}

fn deadlines(written: &file::Deadlines) -> Deadlines {
    let duration = |Seconds(seconds)| Duration::from_secs_f64(seconds);
    Deadlines {
        startup: duration(written.startup_seconds),
        heartbeat: duration(written.heartbeat_seconds),
        tile: duration(written.tile_seconds),
        join: duration(written.join_seconds),
    }
}

fn point(written: [Coordinate; 3]) -> DVec3 {
    written.map(|Coordinate(x)| x).into()
}

fn colour(written: [Channel; 3]) -> DVec3 {
    written.map(|Channel(x)| x).into()
}
