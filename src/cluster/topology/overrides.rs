//! `--set cluster.nodes=9`: a key of the topology file and the value that it gets instead.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

/// One override. It prints as it was typed: `--set KEY=VALUE`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    /// The parts of the dotted key, 1 to [`Self::KEY_PARTS_MAX`]; numbers count the elements of an array from 0.
    key: Vec<String>,
    /// TOML if it parses as such, else a string.
    value: String,
}

impl Override {
    /// No key of the format has more.
    const KEY_PARTS_MAX: usize = 4;

    pub(super) fn value(&self) -> &str {
        &self.value
    }

    /// The other keys of the topology that have no meaning any more: those of the scene that is replaced.
    pub(super) fn displaces(&self) -> &'static [&'static str] {
        match self.key.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["scene"] => &["camera", "light"],
            ["scene", "file"] => &["camera", "light", "scene.procedural", "scene.size", "scene.board", "scene.up"],
            ["scene", "procedural"] => &["camera", "light", "scene.file", "scene.size", "scene.board", "scene.up"],
            _ => &[],
        }
    }

    /// Sets the key in `root`, making the tables on the way. Everything set gets the place `span`.
    ///
    /// # Errors
    /// What is in the way, and what was expected there.
    pub(super) fn apply<'a>(&'a self, root: &mut Spanned<DeValue<'a>>, span: Range<usize>) -> Result<(), String> {
        let mut slot = root;
        for (depth, part) in self.key.iter().enumerate() {
            let key = || self.key[..depth].join(".");
            let kind = slot.get_ref().type_str();
            let is_element = self.key.get(depth + 1).is_some_and(|next| next.parse::<usize>().is_ok());
            slot = match slot.get_mut() {
                DeValue::Table(table) => {
                    table.entry(Spanned::new(span.clone(), part.as_str().into())).or_insert_with(|| {
                        let missing =
                            if is_element { DeValue::Array(DeArray::new()) } else { DeValue::Table(DeTable::new()) };
                        Spanned::new(span.clone(), missing)
                    })
                }
                DeValue::Array(array) => {
                    let length = array.len();
                    // One more than there are is added.
                    if part.parse() == Ok(length) {
                        array.push(Spanned::new(span.clone(), DeValue::Table(DeTable::new())));
                    }
                    let element = part.parse().ok().and_then(|index: usize| array.get_mut(index));
                    element
                        .ok_or_else(|| format!("{} has no element {part}, expected one from 0 to {length}", key()))?
                }
                _ => return Err(format!("{} is of type {kind}, expected a table", key())),
            };
        }
        *slot = match DeValue::parse(&self.value) {
            Ok(value) => moved(value, &span),
            Err(_) => Spanned::new(span, DeValue::String(self.value.as_str().into())),
        };
        Ok(())
    }
}

/// The value with all its parts at one place.
fn moved<'a>(value: Spanned<DeValue<'a>>, span: &Range<usize>) -> Spanned<DeValue<'a>> {
    let value = match value.into_inner() {
        DeValue::Array(array) => DeValue::Array(array.into_iter().map(|element| moved(element, span)).collect()),
        DeValue::Table(table) => {
            let entries = table.into_iter();
            let moved = entries.map(|(key, value)| (Spanned::new(span.clone(), key.into_inner()), moved(value, span)));
            DeValue::Table(moved.collect())
        }
        scalar => scalar,
    };
    Spanned::new(span.clone(), value)
}

impl FromStr for Override {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (key, value) = text.split_once('=').ok_or("no `=`, expected KEY=VALUE such as cluster.nodes=9")?;
        let key: Vec<String> = key.split('.').map(|part| part.trim().to_owned()).collect();
        let bare = |part: &String| {
            !part.is_empty() && part.bytes().all(|c| c.is_ascii_alphanumeric() || c == b'_' || c == b'-')
        };
        if key.len() > Self::KEY_PARTS_MAX || !key.iter().all(bare) {
            return Err("not a key, expected names joined by dots such as cluster.local_memory.size".to_owned());
        }
        Ok(Self { key, value: value.trim().to_owned() })
    }
}

impl fmt::Display for Override {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "--set {}={}", self.key.join("."), self.value)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::PathBuf;

    use glam::DVec3;

    use super::*;
    use crate::topology::Topology;
    use machine::hardware::specification::MemorySize;
    use trace::preparation::ViewChoices;
    use trace::scene::SceneSource;
    use trace::scene::SourceError;
    use trace::scene::procedural::{Board, Kind, Procedural};

    const FILE: &str = "\
        scene = { procedural = 'teapot', size = 3 }\n\
        camera = { from = [0, 0, 9], at = [0, 0, 0] }\n\
        light = [{ position = [1, 2, 3] }, { position = [4, 5, 6] }]\n\
        image = { width = 64, height = 64 }\n";

    fn read(overrides: &[&str]) -> Result<Topology, SourceError> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.toml");
        fs::write(&path, FILE).expect("a file");
        let overrides: Vec<Override> = overrides.iter().map(|text| text.parse().expect("an override")).collect();
        Topology::read(&path, &overrides)
    }

    fn read_well(overrides: &[&str]) -> Topology {
        read(overrides).unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn values_are_toml_or_else_strings() {
        let topology = read_well(&["cluster.nodes=9", "cluster.local_memory.size=1/16", "image.tile=[5, 7]"]);
        assert_eq!(topology.cluster.nodes, 9);
        assert_eq!(topology.cluster.local_memory.size, MemorySize::Share { numerator: 1, denominator: 16 });
        assert_eq!(topology.image.tile, (5, 7));
        let quoted = read_well(&["cluster.local_memory.size = \"64 KiB\""]);
        assert_eq!(quoted.cluster.local_memory.size, MemorySize::Bytes(65_536));
        assert_eq!(read_well(&["topology.name=a=b"]).name, "a=b");
    }

    #[test]
    fn tables_and_elements_can_be_set() {
        let topology = read_well(&["cluster={ nodes = 2 }", "light.1.position=[7, 8, 9]", "light.0.position.2=-1"]);
        assert_eq!(topology.cluster.nodes, 2);
        let positions: Vec<[f64; 3]> = topology.view.lights.iter().map(|light| light.position.to_array()).collect();
        assert_eq!(positions, [[1.0, 2.0, -1.0], [7.0, 8.0, 9.0]]);
    }

    #[test]
    fn an_element_that_is_the_next_one_is_added() {
        let topology =
            read_well(&["light.2.position=[7, 8, 9]", "light.3.position=[1, 1, 1]", "light.3.colour=[1, 0, 0]"]);
        assert_eq!(topology.view.lights.len(), 4);
        assert_eq!((topology.view.lights[2].position.x, topology.view.lights[3].colour), (7.0, DVec3::X));
        let topology = read_well(&["scene.procedural=gears", "light.0.position=[1, 2, 3]"]);
        assert_eq!(topology.view.lights.len(), 1);
    }

    #[test]
    fn the_last_of_two_overrides_holds() {
        assert_eq!(read_well(&["cluster.nodes=2", "cluster.nodes=3"]).cluster.nodes, 3);
    }

    #[test]
    fn another_scene_displaces_camera_and_lights() {
        for overrides in [["scene.file=x/a.obj", "image.width=32"], ["image.width=32", "scene.file=x/a.obj"]] {
            let topology = read_well(&overrides);
            assert_eq!(topology.scene, SceneSource::File(PathBuf::from("x/a.obj")), "from the working directory");
            assert_eq!(topology.view, ViewChoices::default());
        }
        let gears = read_well(&["scene.procedural=gears"]);
        assert_eq!(
            gears.scene,
            SceneSource::Procedural(Procedural { kind: Kind::Gears, size: 4, board: Board::Squares })
        );
        assert_eq!(gears.view, ViewChoices::default());
        let smaller = read_well(&["scene.size=2"]);
        assert_eq!(
            (smaller.view.camera.from.is_some(), smaller.view.lights.len()),
            (true, 2),
            "the same scene keeps both"
        );
    }

    #[test]
    fn what_belongs_to_the_new_scene_can_be_set_with_it() {
        let view =
            ["camera.at=[0, 0, 0]", "camera.from=[0, 0, 1]", "scene.file=a.obj", "light=[{ position = [1, 1, 1] }]"];
        let topology = read_well(&view);
        assert_eq!(topology.view.camera.from, Some(DVec3::Z));
        assert_eq!(topology.view.lights.len(), 1);
    }

    #[test]
    fn errors_name_the_override() {
        let table = [
            ("cluster.nodes=0", "cluster.nodes is 0, expected an integer from 1 to 256"),
            ("cluster.nodes=", "cluster.nodes is empty, expected an integer from 1 to 256"),
            (
                "cluster.nodse=2",
                "unknown key cluster.nodse, expected one of count, nodes, threads, processor, local_memory, bus; did you mean nodes?",
            ),
            (
                "clutser.nodes=2",
                "unknown key clutser, expected one of topology, scene, camera, light, image, octree, database, cluster, host, run; did you mean cluster?",
            ),
            ("image.width.x=2", "image.width is of type integer, expected a table"),
            ("light.3.position=[0, 0, 0]", "light has no element 3, expected one from 0 to 2"),
            ("light.x.position=[0, 0, 0]", "light has no element x, expected one from 0 to 2"),
            ("scene.file=7", "scene.file is 7, expected a string"),
            ("image.tile=65", "image.tile is 65x65 pixels, expected at most the image's 64x64"),
            (
                "image.tile={ w = [1",
                "image.tile is { w = [1, expected an integer or [width, height], each from 1 to 65536",
            ),
            ("camera.at=[0, 0, 9]", "camera: from and at are the same point, expected two"),
            ("camera.from=[0, 0, 0]", "camera: from and at are the same point, expected two"),
        ];
        for (text, reason) in table {
            let error = read(&[text]).expect_err(text);
            assert_eq!(error.to_string(), format!("--set {text}: {reason}"));
        }
        let both = read(&["scene.file=a.nff", "scene.procedural=gears"]).expect_err("two scenes");
        let reason = "both scene.file and scene.procedural are given, expected one of them";
        assert_eq!(both.to_string(), format!("--set scene.procedural=gears: {reason}"));
    }

    #[test]
    fn what_is_no_override_is_refused() {
        for text in ["", "cluster.nodes", "=3", ".=3", "cluster..nodes=3", "a b=3", "a.b.c.d.e=1", "\"a\"=1"] {
            assert!(text.parse::<Override>().is_err(), "{text}");
        }
        assert!("a.".repeat(100_000).parse::<Override>().is_err());
    }
}
