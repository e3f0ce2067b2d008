//! Recordings of references are damaged in every way, and each is told: what is wrong, where, what was expected, what
//! can be used all the same. Nothing is counted in silence.
//!
//! What each prints stands in tests/golden/damaged-recordings.txt; `MARTI_UPDATE=1` writes it anew.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use machine::recording::frames::{Frame, FrameLimits, Frames};
use serde_json::Value;

use crate::command::{TEAPOT, marti, recorded_report_of, stderr};

const FIRST: &str = "references-n000-e0.arrows";
const SECOND: &str = "references-n001-e0.arrows";
const SIDECAR: &str = "references.json";
const LEVELS: &str = "octree-levels.u8";

/// Two tiles a node, most of them of several parts.
const SETS: [&str; 4] = ["image.width=48", "image.height=64", "image.tile=[48, 16]", "run.assignment=interleaved"];

/// A folder with the recording that is damaged, and one with others.
struct Folders<'a> {
    damaged: &'a Path,
    /// Of another scene, and of the same scene in another run.
    other_scene: &'a Path,
    other_run: &'a Path,
}

impl Folders<'_> {
    fn change(&self, name: &str, change: impl FnOnce(&mut Vec<u8>)) {
        let path = self.damaged.join(name);
        let mut bytes = fs::read(&path).expect("a file");
        change(&mut bytes);
        fs::write(path, bytes).expect("a file");
    }

    fn remove(&self, name: &str) {
        fs::remove_file(self.damaged.join(name)).expect("a file");
    }

    /// Puts a pipe in a file's place, whose reader would wait for ever.
    fn pipe(&self, name: &str) {
        self.remove(name);
        let made = Command::new("mkfifo").arg(self.damaged.join(name)).status();
        assert!(made.is_ok_and(|status| status.success()), "mkfifo is of the core utilities");
    }

    fn take(&self, from: &Path, name: &str) {
        fs::copy(from.join(name), self.damaged.join(name)).expect("a file");
    }

    fn cut(&self, name: &str, at: impl FnOnce(&[Frame]) -> u64) {
        self.change(name, |bytes| {
            let at = at(&frames(bytes));
            bytes.truncate(at as usize);
        });
    }

    fn flip(&self, name: &str, at: impl FnOnce(&[Frame]) -> u64) {
        self.change(name, |bytes| {
            let at = at(&frames(bytes));
            bytes[at as usize] ^= 0x10;
        });
    }

    /// Replaces text in the sidecar, and leaves its checksum as it was.
    fn replace(&self, from: &str, to: &str) {
        self.change(SIDECAR, |bytes| {
            let text = String::from_utf8(std::mem::take(bytes)).expect("JSON");
            assert!(text.contains(from), "{from}: {text}");
            *bytes = text.replacen(from, to, 1).into_bytes();
        });
    }

    /// Replaces text in the sidecar as one who knows how to make it sound.
    fn forge(&self, from: &str, to: &str) {
        self.replace(from, to);
        self.change(SIDECAR, |bytes| {
            let key = b",\"crc32c\":";
            let at = bytes.windows(key.len()).rposition(|window| window == key).expect("a checksum");
            bytes.truncate(at);
            let told = format!(",\"crc32c\":{}}}\n", crc32c::crc32c(bytes));
            bytes.extend_from_slice(told.as_bytes());
        });
    }
}

fn frames(bytes: &[u8]) -> Vec<Frame> {
    let limits = FrameLimits { metadata_bytes: 1 << 20, body_bytes: 1 << 20 };
    let mut frames = Frames::new(bytes, limits).expect("a length");
    std::iter::from_fn(|| frames.next_frame().expect("sound")).collect()
}

fn find(bytes: &[u8], what: &[u8]) -> usize {
    bytes.windows(what.len()).position(|window| window == what).expect("there")
}

type Case = (&'static str, fn(&Folders));

const CASES: &[Case] = &[
    ("nothing is damaged", |_| {}),
    ("no such folder", |f| fs::remove_dir_all(f.damaged).expect("a folder")),
    ("an empty folder", |f| {
        fs::remove_dir_all(f.damaged).expect("a folder");
        fs::create_dir(f.damaged).expect("a folder");
    }),
    ("sidecar: missing", |f| f.remove(SIDECAR)),
    ("sidecar: empty", |f| f.change(SIDECAR, Vec::clear)),
    ("sidecar: not JSON", |f| f.change(SIDECAR, |bytes| *bytes = b"\x7fELF\x02\x01".to_vec())),
    ("sidecar: that of the bus log", |f| {
        f.change(SIDECAR, |bytes| *bytes = b"{\"format_version\":1,\"rows\":7}".to_vec())
    }),
    ("sidecar: cut in the middle", |f| f.change(SIDECAR, |bytes| bytes.truncate(bytes.len() / 2))),
    ("sidecar: a later version", |f| f.forge("\"format_version\":1", "\"format_version\":3")),
    ("sidecar: another seed", |f| f.replace("seed = 1", "seed = 7")),
    ("sidecar: another local memory", |f| f.replace("size = \\\"1/8", "size = \\\"1/9")),
    ("sidecar: without its checksum", |f| {
        f.change(SIDECAR, |bytes| {
            let at = bytes.iter().rposition(|&byte| byte == b',').expect("a last key");
            bytes.truncate(at);
            bytes.push(b'}');
        });
    }),
    ("sidecar: from another scene", |f| f.take(f.other_scene, SIDECAR)),
    ("sidecar: from another run", |f| f.take(f.other_run, SIDECAR)),
    ("sidecar: tiles without pixels", |f| f.forge("\"tile_width\":48", "\"tile_width\":0")),
    ("sidecar: an image without end", |f| f.forge("{\"width\":48", "{\"width\":4294967295")),
    ("sidecar: too many tiles", |f| {
        f.forge(
            "{\"width\":48,\"height\":64,\"tile_width\":48,\"tile_height\":16}",
            "{\"width\":65536,\"height\":65536,\"tile_width\":1,\"tile_height\":1}",
        );
    }),
    ("sidecar: other tiles", |f| f.forge("\"tile_height\":16", "\"tile_height\":8")),
    ("sidecar: a negative number of records", |f| f.forge("\"spheres\":0", "\"spheres\":-1")),
    ("sidecar: more records than can be addressed", |f| f.forge("\"spheres\":0", "\"spheres\":18446744073709551615")),
    ("sidecar: a section is missing", |f| f.forge("\"spheres\":0,", "")),
    ("sidecar: a million spheres", |f| f.forge("\"spheres\":0", "\"spheres\":1000000")),
    ("sidecar: a topology that is none", |f| f.forge("[scene]", "[scnee]")),
    ("sidecar: a line of 48 bytes", |f| f.forge("line = 64", "line = 48")),
    ("sidecar: fewer nodes", |f| f.forge("nodes = 2", "nodes = 1")),
    ("sidecar: all tiles missing", |f| f.forge("\"tiles_missing\":0", "\"tiles_missing\":4294967295")),
    ("sidecar: a name that leads elsewhere", |f| f.forge(FIRST, "../references-n000-e0.arrows")),
    ("sidecar: a name from the root", |f| f.forge(FIRST, "/etc/passwd")),
    ("sidecar: the same file twice", |f| f.forge(SECOND, FIRST)),
    ("sidecar: no files", |f| {
        f.change(SIDECAR, |bytes| {
            let text = String::from_utf8(std::mem::take(bytes)).expect("JSON");
            let (from, to) = (text.find("\"files\":[").expect("files") + 9, text.find("],\"octree").expect("levels"));
            *bytes = [&text[..from], &text[to..]].concat().into_bytes();
        });
        f.forge("\"tiles_missing\":0", "\"tiles_missing\":0");
    }),
    ("sidecar: a lost tile that was accepted", |f| {
        f.forge("\"lost\":[", "\"lost\":[{\"node\":1,\"epoch\":0,\"tile\":3,\"attempt\":0}");
    }),
    ("sidecar: a pipe", |f| {
        f.pipe(SIDECAR);
    }),
    ("levels: missing", |f| f.remove(LEVELS)),
    ("levels: cut", |f| f.change(LEVELS, |bytes| bytes.truncate(100))),
    ("levels: a flipped byte", |f| f.change(LEVELS, |bytes| bytes[77] ^= 1)),
    ("levels: of another scene", |f| f.take(f.other_scene, LEVELS)),
    ("levels: longer than any memory", |f| {
        fs::File::options()
            .write(true)
            .open(f.damaged.join(LEVELS))
            .and_then(|file| file.set_len(1 << 40))
            .expect("sparse");
    }),
    ("references: a file is missing", |f| f.remove(SECOND)),
    ("references: a file is a pipe", |f| {
        f.pipe(SECOND);
    }),
    ("references: a file is a folder", |f| {
        f.remove(SECOND);
        fs::create_dir(f.damaged.join(SECOND)).expect("a folder");
    }),
    ("references: empty", |f| f.change(FIRST, Vec::clear)),
    ("references: no Arrow at all", |f| f.change(FIRST, |bytes| *bytes = b"tile,attempt,part\n".to_vec())),
    ("references: the bus log", |f| {
        f.change(FIRST, |bytes| *bytes = fs::read(f.damaged.join("bus.arrows")).expect("a log"))
    }),
    ("references: cut in the schema's prefix", |f| f.cut(FIRST, |_| 5)),
    ("references: cut in the schema", |f| f.cut(FIRST, |frames| frames[0].end() - 100)),
    ("references: cut after the schema", |f| f.cut(FIRST, |frames| frames[0].end())),
    ("references: cut in a prefix", |f| f.cut(FIRST, |frames| frames[1].end() + 3)),
    ("references: cut in the metadata", |f| f.cut(FIRST, |frames| frames[1].end() + 60)),
    ("references: cut in a body", |f| f.cut(FIRST, |frames| frames[3].end() - 7)),
    ("references: cut between parts of a tile", |f| f.cut(FIRST, |frames| frames[3].end())),
    ("references: cut between tiles", |f| f.cut(FIRST, |frames| frames[1].end())),
    ("references: cut by its last byte", |f| f.cut(SECOND, |frames| frames[frames.len() - 1].end() - 1)),
    ("references: a zeroed tail", |f| {
        f.change(FIRST, |bytes| {
            let at = frames(bytes)[2].offset as usize + 1000;
            bytes[at..].fill(0);
        });
    }),
    ("references: a zeroed tail from a frame on", |f| {
        f.change(FIRST, |bytes| {
            let at = frames(bytes)[2].offset as usize;
            bytes[at..].fill(0);
        });
    }),
    ("references: bytes after the end", |f| f.change(FIRST, |bytes| bytes.extend([0; 4096]))),
    ("references: an end, and more", |f| {
        f.change(FIRST, |bytes| bytes.extend([0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0, 1, 2, 3]));
    }),
    ("references: a flipped byte in the schema", |f| {
        f.change(FIRST, |bytes| {
            let at = find(bytes, b"octree_nodes");
            bytes[at] ^= 1;
        });
    }),
    ("references: a flipped byte in a column's name", |f| {
        f.change(FIRST, |bytes| {
            let at = find(bytes, b"attempt");
            bytes[at] ^= 1;
        });
    }),
    ("references: a flipped byte in a prefix", |f| f.flip(FIRST, |frames| frames[2].offset + 1)),
    ("references: a frame of two gigabytes", |f| {
        f.change(FIRST, |bytes| {
            let at = frames(bytes)[2].offset as usize + 4;
            bytes[at..at + 4].copy_from_slice(&i32::MAX.to_le_bytes());
        });
    }),
    ("references: a flipped byte in the metadata", |f| f.flip(FIRST, |frames| frames[2].offset + 12)),
    ("references: a flipped byte in a tile's number", |f| f.flip(FIRST, |frames| frames[2].body_offset + 8)),
    ("references: a flipped byte in the words", |f| f.flip(FIRST, |frames| frames[2].body_offset + 70_000)),
    ("references: a flipped byte in the last words", |f| f.flip(SECOND, |frames| frames[4].body_offset + 5000)),
    ("references: a later version", |f| {
        f.change(FIRST, |bytes| {
            // Key and value are strings with their lengths before them: keys, in alphabetical order, after values.
            let key = find(bytes, b"marti.format_version");
            let value = bytes[..key].windows(6).rposition(|window| window == [1, 0, 0, 0, b'1', 0]);
            let value = value.or_else(|| bytes.windows(6).position(|window| window == [1, 0, 0, 0, b'1', 0]));
            bytes[value.expect("a version") + 4] = b'9';
        });
    }),
    ("references: of another scene", |f| f.take(f.other_scene, FIRST)),
    ("references: of another run", |f| f.take(f.other_run, FIRST)),
    ("references: of another process", |f| {
        fs::copy(f.damaged.join(SECOND), f.damaged.join(FIRST)).expect("a file");
    }),
    ("references: parts in another order", |f| {
        f.change(FIRST, |bytes| {
            let frames = frames(bytes);
            let of = |i: usize| bytes[frames[i].offset as usize..frames[i].end() as usize].to_vec();
            let swapped = [of(0), of(1), of(3), of(2), of(4), of(5)].concat();
            *bytes = swapped;
        });
    }),
    ("references: tiles in another order", |f| {
        f.change(FIRST, |bytes| {
            let frames = frames(bytes);
            let of = |i: usize| bytes[frames[i].offset as usize..frames[i].end() as usize].to_vec();
            let swapped = [of(0), of(2), of(3), of(4), of(5), of(1)].concat();
            *bytes = swapped;
        });
    }),
    ("references: a part is left out", |f| {
        f.change(FIRST, |bytes| {
            let frame = frames(bytes)[3].clone();
            bytes.drain(frame.offset as usize..frame.end() as usize);
        });
    }),
    ("references: a tile is there twice", |f| {
        f.change(FIRST, |bytes| {
            let frame = frames(bytes)[1].clone();
            let again = bytes[frame.offset as usize..frame.end() as usize].to_vec();
            bytes.extend(again);
        });
    }),
    ("references: a file too many", |f| {
        fs::copy(f.damaged.join(SECOND), f.damaged.join("references-n001-e1.arrows")).expect("a file");
    }),
];

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for file in fs::read_dir(from).expect("a folder").flatten() {
        fs::copy(file.path(), to.join(file.file_name())).expect("a file");
    }
}

fn replay(folder: &Path, options: &[&str]) -> Output {
    let started = Instant::now();
    let mut command = marti();
    let command = command.current_dir(folder).args(["replay", "RECORDING", "--format", "json"]).args(options);
    let output = command.output().expect("marti can be started");
    assert!(started.elapsed() < Duration::from_secs(10), "{options:?} took {:?}", started.elapsed());
    output
}

/// Standard error without checksums, which the program's version is in.
fn said(output: &Output) -> String {
    let text = stderr(output);
    assert!(!text.contains("panicked"), "{text}");
    let mut parts = text.split("0x");
    let first = parts.next().unwrap_or_default().to_owned();
    let said = parts.fold(first, |said, part| {
        let digits = part.chars().take_while(char::is_ascii_hexdigit).count();
        said + if digits == 8 { "CHECKSUM" } else { &part[..digits] } + &part[digits..]
    });
    said.trim_end().replace('\n', "\n    ")
}

/// What came of a replay: exit code, counts.
fn counted(output: &Output) -> String {
    let code = output.status.code().expect("no signal");
    let Ok(rows) = serde_json::from_slice::<Vec<Value>>(&output.stdout) else { return format!("exit {code}") };
    let row = &rows[0];
    let exact = if row["exact"] == true { "exact" } else { "approximate" };
    assert_eq!(row["exact"] == true, row["reason"].is_null(), "{row}");
    format!("exit {code}: {} record accesses, {} misses, {exact}", row["record_accesses"], row["misses"])
}

#[test]
fn every_damage_is_told_and_what_is_whole_can_be_used() {
    let temporary = tempfile::tempdir().expect("temporary folder");
    let record = |name: &str, sets: &[&str]| {
        let out = temporary.path().join(name);
        recorded_report_of(TEAPOT, &out, &[&SETS[..], sets].concat());
        out.join("recording")
    };
    let sound = record("sound", &[]);
    let other_scene = record("other-scene", &["scene.size=5"]);
    let other_run = record("other-run", &["image.depth=1"]);
    let mut printed = String::new();
    for (name, damage) in CASES {
        let folder = tempfile::tempdir().expect("temporary folder");
        let damaged = folder.path().join("RECORDING");
        copy(&sound, &damaged);
        damage(&Folders { damaged: &damaged, other_scene: &other_scene, other_run: &other_run });
        let (strict, partial) = (replay(folder.path(), &[]), replay(folder.path(), &["--partial"]));
        let is_sound = *name == CASES[0].0;
        assert_eq!(strict.status.code(), Some(if is_sound { 0 } else { 2 }), "{name}: {}", stderr(&strict));
        if partial.status.success() && !is_sound {
            assert!(counted(&partial).ends_with("approximate"), "{name}");
            assert!(!stderr(&partial).is_empty(), "{name}: nothing is told");
        }
        let told = if is_sound { counted(&strict) } else { said(&strict) };
        writeln!(printed, "{name}\n    {told}").expect("a string can be written to");
        writeln!(printed, "    --partial: {}\n", counted(&partial)).expect("a string can be written to");
    }
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/damaged-recordings.txt");
    if std::env::var_os("MARTI_UPDATE").is_some() {
        fs::write(&golden, &printed).expect("the golden file can be written");
    }
    let expected = fs::read_to_string(&golden).unwrap_or_default();
    assert!(
        printed == expected,
        "what is printed is not what {} has; MARTI_UPDATE=1 writes it anew:\n{printed}",
        golden.display()
    );
}
