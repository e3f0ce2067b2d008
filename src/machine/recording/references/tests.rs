//! A recording that is written is read, and one that was damaged never counts in silence.

use std::fs;
use std::path::Path;

use super::*;
use crate::hardware::references::{PART_WORDS, RecordNumbers, ReferenceWord};
use crate::hardware::specification::{Bus, Cluster, LocalMemory, MemorySize, Processor, Replacement};
use crate::hardware::trace::Trace;
use crate::tile_order::TileOrder;
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use trace::database::Section;
use trace::database::strides::Strides;
use trace::picture::{Sides, Tiling};
use trace::tracer::RayKind;

const TOPOLOGY: &str =
    "[scene]\nprocedural = \"teapot\"\n[image]\nwidth = 12\nheight = 8\ntile = 4\n[cluster]\nnodes = 2\n";
/// Columns × rows of tiles, each of one word more than the one before.
const TILING: Tiling = Tiling::new(Sides { width: 12, height: 8, tile_width: 4, tile_height: 4 }).expect("possible");

fn layout() -> Layout {
    Layout::new([80, 100, 50, 7, 3, 60, 20, 4, 0]).expect("small")
}

/// Those of recordings of version 1.
fn sections() -> impl Iterator<Item = Section> {
    Section::ALL.into_iter().filter(|&section| section != Section::Polygons)
}

/// Words of a tile: a ray, then reads all over the image.
fn words(tile: u32, count: u32) -> Vec<u32> {
    let records = RecordNumbers::new(&layout()).count();
    let read = |i| ReferenceWord::read((tile * 37 + i * 11) % records).0;
    std::iter::once(ReferenceWord::ray(RayKind::Primary).0).chain((0..count).map(read)).collect()
}

fn primitives(words: &[u32]) -> u64 {
    let numbers = RecordNumbers::new(&layout());
    let tested = [Section::Triangles, Section::Spheres, Section::Cones].map(|section| numbers.section(section));
    words.iter().filter(|word| tested.iter().any(|records| records.contains(*word))).count() as u64
}

/// Parts of a tile and attempt.
type Parts = (u32, u32, Vec<Vec<u32>>);

fn write_process(folder: &Path, node: u16, epoch: u32, tiles: &[Parts]) {
    let mut writer = Writer::create(folder, NodeId(node), Epoch(epoch), &layout()).expect("a folder");
    for (tile, attempt, parts) in tiles {
        writer.begin(TileId(*tile), Attempt(*attempt));
        let (last, others) = parts.split_last().expect("at least one part");
        others.iter().for_each(|part| writer.part(part));
        writer.end(last, primitives(&parts.concat())).expect("written");
    }
}

fn write_sidecar(folder: &Path, lost: Vec<LostTile>) {
    let levels: Vec<u8> = (0..10).collect();
    fs::write(folder.join(LEVELS_NAME), &levels).expect("a file");
    cut_torn_tails(folder).expect("readable");
    let scanned = scan(folder, &layout()).expect("readable");
    let sidecar = Sidecar {
        // As recordings were before records could be padded: they say nothing of it, and nothing of polygons.
        format_version: 1,
        marti_version: "0".to_owned(),
        scene_sha256: "00".to_owned(),
        topology: TOPOLOGY.to_owned(),
        tiling: TILING.sides(),
        records: sections().map(|section| (section.name().to_owned(), layout().span(section).records)).collect(),
        record_bytes: None,
        local_bytes: 1024,
        tiles_missing: 0,
        lost,
        files: scanned.files,
        octree_levels: FileFacts {
            name: LEVELS_NAME.to_owned(),
            bytes: levels.len() as u64,
            crc32c: crc32c::crc32c(&levels),
        },
    };
    sidecar.write(folder).expect("written");
}

/// Node 0 traced tiles 0, 2 and 4, node 1 tile 1 before it died with tile 3 on its way, then 3 and 5.
fn processes() -> [(u16, u32, Vec<Parts>); 3] {
    let short = |tile, attempt| (tile, attempt, vec![words(tile, 20 + tile)]);
    [
        (0, 0, vec![short(0, 0), (2, 0, vec![words(2, 9), words(3, 5), words(4, 0)]), short(4, 0)]),
        (1, 0, vec![short(1, 0), short(3, 0)]),
        (1, 1, vec![short(3, 1), short(5, 0)]),
    ]
}

const LOST: LostTile = LostTile { node: NodeId(1), epoch: Epoch(0), tile: TileId(3), attempt: Attempt(0) };

fn record(folder: &Path) {
    for (node, epoch, tiles) in processes() {
        write_process(folder, node, epoch, &tiles);
    }
    write_sidecar(folder, vec![LOST]);
}

/// As the cluster layer opens a recording: what a replay needs of the topology, if that is as it was written.
fn open_references(folder: &Path) -> Result<Opened, OpenError> {
    Recording::open(folder, |text| {
        let local_memory = LocalMemory { size: MemorySize::All, line: 64, ways: None, replacement: Replacement::Lru };
        let (processor, bus) = (Processor::DEFAULT, Bus::DEFAULT);
        let cluster = Cluster { count: 1, nodes: 2, processor, local_memory, bus };
        let conditions = Conditions { cluster, tile_order: TileOrder::Scanline, seed: 0 };
        if text == TOPOLOGY { Ok(conditions) } else { Err("another topology".to_owned()) }
    })
}

/// A tile as it was read: node, epoch, tile, attempt, whether it was accepted, and its words.
type Read = (u16, u32, u32, u32, bool, Vec<u32>);

fn rows(recording: &Recording) -> Vec<Read> {
    let mut part_words = Vec::new();
    let row = |tile: &crate::hardware::trace::TracedTile| {
        let mut all = Vec::new();
        for part in tile.parts.clone() {
            recording.read(part, &mut part_words).expect("checked when it was opened");
            all.extend_from_slice(&part_words);
        }
        (tile.node.0, tile.epoch.0, tile.tile.0, tile.attempt.0, tile.accepted, all)
    };
    recording.tiles().iter().map(row).collect()
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    record(folder.path());
    let Opened { recording, faults } = open_references(folder.path()).expect("whole");
    assert_eq!(faults, [""; 0]);
    let mut expected = Vec::new();
    for (node, epoch, tiles) in processes() {
        for (tile, attempt, parts) in tiles {
            expected.push((node, epoch, tile, attempt, (tile, attempt) != (3, 0), parts.concat()));
        }
    }
    assert_eq!(rows(&recording), expected);
    let reads = |row: &Read| row.5.iter().filter(|&&word| ReferenceWord(word).is_read()).count() as u64;
    assert_eq!(recording.references, expected.iter().map(reads).sum::<u64>());
    assert_eq!((recording.layout, recording.tiling, recording.lost), (layout(), TILING, vec![LOST]));
    assert_eq!(recording.octree_levels, (0..10).collect::<Vec<u8>>());
    assert_eq!(recording.conditions.cluster.nodes, 2);
}

/// A run's end writes the newest version only where the database has what earlier ones do not know.
#[test]
fn polygons_and_padding_are_recorded_and_read_in_a_version_of_their_own() {
    let counts = [80, 100, 50, 7, 3, 60, 20, 4, 9];
    let strides = Strides::new([4, 4, 76, 16, 32, 8, 72, 48, 300]).expect("possible");
    let padded = |counts| Layout::padded(counts, strides).expect("small");
    let plain = layout();
    let layouts = [(plain.clone(), 1), (Layout::new(counts).expect("small"), 2), (padded(counts), 2)];
    for (layout, version) in layouts {
        let folder = tempfile::tempdir().expect("a folder");
        let numbers = RecordNumbers::new(&layout);
        let objects = if layout.has_polygons() { Section::Polygons } else { Section::Triangles };
        // Only one of them is a test: triangles are read as parts of polygons where there are any.
        let read = |section: Section| ReferenceWord::read(numbers.section(section).start).0;
        let words = [ReferenceWord::ray(RayKind::Primary).0, read(Section::Triangles), read(Section::Polygons)];
        let words = if objects == Section::Polygons { words.to_vec() } else { words[..2].to_vec() };
        let mut writer = Writer::create(folder.path(), NodeId(0), Epoch(0), &layout).expect("a folder");
        for tile in 0..6 {
            writer.begin(TileId(tile), Attempt(0));
            writer.end(&words, 1).expect("written");
        }
        let seal = Seal {
            topology: TOPOLOGY.to_owned(),
            layout: layout.clone(),
            tiling: TILING,
            octree_levels: vec![0; 10],
            scene_sha256: "00".to_owned(),
            local_bytes: 1024,
        };
        seal.put(folder.path(), 0, |_| true).expect("written");
        let (sidecar, fault) = Sidecar::read(folder.path()).expect("a sidecar");
        assert_eq!((sidecar.format_version, fault), (version, None));
        assert_eq!(
            (sidecar.record_bytes.is_some(), sidecar.records.contains_key("polygons")),
            (version > 1, version > 1)
        );
        let Opened { recording, faults } = open_references(folder.path()).expect("whole");
        assert_eq!(faults, [""; 0]);
        assert!(recording.layout == layout && recording.tiles().len() == 6);
        // Files of another layout are those of another database.
        let other = if layout == plain { padded(counts) } else { plain.clone() };
        let scan = Scan::of(&folder.path().join("references-n000-e0.arrows"), NodeId(0), Epoch(0), &other);
        assert!(scan.expect("readable").fault.is_some_and(|fault| fault.contains("another database")));
    }
}

#[test]
fn full_parts_are_read_at_under_five_bytes_a_reference() {
    let folder = tempfile::tempdir().expect("a folder");
    let full = |tile| words(tile, PART_WORDS as u32 - 1);
    let tiles: Vec<Parts> = (0..6).map(|tile| (tile, 0, vec![full(tile), full(tile + 1), words(tile, 3)])).collect();
    write_process(folder.path(), 0, 0, &tiles);
    write_sidecar(folder.path(), Vec::new());
    let Opened { recording, faults } = open_references(folder.path()).expect("whole");
    assert_eq!(faults, [""; 0]);
    for (row, (.., parts)) in rows(&recording).iter().zip(&tiles) {
        assert_eq!(row.5, parts.concat());
    }
    let bytes = fs::metadata(folder.path().join(file_name(NodeId(0), Epoch(0)))).expect("a file").len();
    assert!(bytes < recording.references * 41 / 10, "{bytes} bytes for {} references", recording.references);
}

#[test]
fn a_file_that_changes_after_it_was_opened_is_noticed() {
    let folder = tempfile::tempdir().expect("a folder");
    record(folder.path());
    let recording = open_references(folder.path()).expect("whole").recording;
    let path = folder.path().join(file_name(NodeId(0), Epoch(0)));
    let mut bytes = fs::read(&path).expect("a file");
    let at = find(&bytes, bytemuck::cast_slice(&words(0, 20)));
    bytes[at + 9] ^= 4;
    fs::write(&path, bytes).expect("a file");
    let error = recording.read(0, &mut Vec::new()).expect_err("other words");
    assert!(error.0.ends_with("has changed since it was opened"), "{error}");
}

fn find(bytes: &[u8], what: &[u8]) -> usize {
    bytes.windows(what.len()).position(|window| window == what).expect("there")
}

#[test]
fn a_torn_tail_is_cut_off_before_the_sidecar_is_written() {
    let whole = tempfile::tempdir().expect("a folder");
    record(whole.path());
    let last = file_name(NodeId(1), Epoch(0));
    let bytes = fs::read(whole.path().join(&last)).expect("a file");
    for cut in (0..bytes.len()).step_by(3) {
        let folder = tempfile::tempdir().expect("a folder");
        write_process(folder.path(), 0, 0, &processes()[0].2);
        write_process(folder.path(), 1, 1, &processes()[2].2);
        fs::write(folder.path().join(&last), &bytes[..cut]).expect("a file");
        write_sidecar(folder.path(), vec![LOST]);
        let Opened { recording, faults } = open_references(folder.path()).expect("some of it");
        // All that can be wrong is that tile 1 is not there; the process that died may have left no file at all.
        let expected = if rows(&recording).iter().any(|row| row.2 == 1) { 0 } else { 1 };
        assert_eq!(faults.len(), expected, "{cut}: {faults:?}");
        assert!(rows(&recording).iter().filter(|row| row.4).count() >= 5);
    }
}

#[test]
fn names_in_a_sidecar_lead_nowhere_else() {
    let outer = tempfile::tempdir().expect("a folder");
    let folder = outer.path().join("in");
    fs::create_dir(&folder).expect("a folder");
    record(&folder);
    let name = file_name(NodeId(0), Epoch(0));
    fs::rename(folder.join(&name), outer.path().join(&name)).expect("same file system");
    let (sidecar, fault) = Sidecar::read(&folder).expect("sound");
    assert_eq!(fault, None);
    let outside = outer.path().join(&name).display().to_string();
    for odd in [format!("../{name}"), outside, "references-n0-e0.arrows".into(), "references-n+00-e0.arrows".into()] {
        let mut sidecar = sidecar.clone();
        sidecar.files[0].name.clone_from(&odd);
        sidecar.write(&folder).expect("written");
        let Opened { recording, faults } = open_references(&folder).expect("node 1 is there");
        assert!(faults[0].contains(&format!("{odd:?}, expected the files of processes of 2 nodes")), "{faults:?}");
        assert!(rows(&recording).iter().all(|row| row.0 == 1));
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }

    fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut damaged = bytes.to_vec();
        let at = self.below(bytes.len());
        let to = (at + 1 + self.below(64)).min(bytes.len());
        match self.below(7) {
            0 | 1 => damaged[at] ^= 1 << self.below(8),
            2 => damaged[at..to].iter_mut().for_each(|byte| *byte = self.below(256) as u8),
            3 => damaged.truncate(at),
            4 => damaged[at..].fill(0),
            5 => damaged.splice(at..at, bytes[at..to].iter().copied()).for_each(drop),
            _ => damaged.drain(at..to).for_each(drop),
        }
        damaged
    }
}

#[test]
fn random_damage_is_told_or_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    record(folder.path());
    let sound = rows(&open_references(folder.path()).expect("whole").recording);
    let mut files: Vec<_> =
        processes().iter().map(|(node, epoch, _)| file_name(NodeId(*node), Epoch(*epoch))).collect();
    files.extend([SIDECAR_NAME.to_owned(), LEVELS_NAME.to_owned()]);
    let mut dice = Dice(11);
    let (mut refused, mut told) = (0, 0);
    for round in 0..4000 {
        let path = folder.path().join(&files[dice.below(files.len())]);
        let bytes = fs::read(&path).expect("a file");
        fs::write(&path, dice.damage(&bytes)).expect("a file");
        match open_references(folder.path()) {
            Err(_) => refused += 1,
            Ok(Opened { recording, faults }) if faults.is_empty() => {
                assert_eq!(rows(&recording), sound, "{round}: {}", path.display());
                assert_eq!((recording.layout, recording.tiling), (layout(), TILING), "{round}");
                assert_eq!(recording.octree_levels.len(), 10, "{round}");
            }
            Ok(Opened { recording, .. }) => {
                told += 1;
                // What is left is tiles as they were.
                for row in rows(&recording) {
                    assert!(sound.iter().any(|tile| (tile.2, tile.3, &tile.5) == (row.2, row.3, &row.5)), "{round}");
                }
            }
        }
        fs::write(&path, bytes).expect("a file");
    }
    assert!(refused > 300 && told > 1500, "{refused} refused, {told} told");
}
