//! Where a scene comes from. As text: a path, or a procedural scene such as `teapot:12` or `teapot:12:no-board`.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::procedural::{Board, Kind, Procedural, SizeError};
use super::{Scene, SourceError, load};

/// A scene file, or a scene that is made by its definition. As text: a path ending in `.nff` or `.obj`, or a name and a size
/// such as `teapot:12`; `:no-board` after a teapot's leaves its board out.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneSource {
    /// Resolved against the topology file's folder (or the working directory, for an override).
    File(PathBuf),
    /// Made, not read.
    Procedural(Procedural),
}

impl SceneSource {
    /// A procedural scene; without a size, its kind's default.
    ///
    /// # Errors
    /// The kind is not made in this size.
    pub fn procedural(kind: Kind, size: Option<u32>) -> Result<Self, SizeError> {
        Procedural::new(kind, size).map(Self::Procedural)
    }

    /// Reads or makes the scene.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn load(&self) -> Result<Scene, SourceError> {
        match self {
            Self::File(path) => load(path),
            Self::Procedural(procedural) => Ok(procedural.scene()),
        }
    }

    /// The scene's name without folder, extension and size: what its image is called.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            Self::Procedural(procedural) => procedural.kind.to_string(),
        }
    }
}

/// After a teapot's name or size: it is without its board.
const NO_BOARD: &str = ":no-board";

/// A procedural scene's name, or its name and size, or else a path with an extension.
impl FromStr for SceneSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (scene, board) = match text.strip_suffix(NO_BOARD) {
            Some(scene) => (scene, Some(Board::None)),
            None => (text, None),
        };
        let (before, size) = scene.split_once(':').map_or((scene, None), |(before, size)| (before, Some(size)));
        if let Ok(kind) = before.parse() {
            let size = size.map(|size| parse_size(kind, size)).transpose()?;
            let scene = Procedural::new(kind, size).map_err(|error| error.to_string())?;
            let scene = board.map_or(Ok(scene), |board| scene.on(board));
            scene.map(Self::Procedural).map_err(|error| error.to_string())
        } else if Path::new(text).extension().is_some() {
            Ok(Self::File(PathBuf::from(text)))
        } else {
            Err(format!("expected a file ending in .nff or .obj, or {}, also with a size as in gears:2", Kind::LIST))
        }
    }
}

/// A number; whether the kind is made in that size, [`Procedural::new`] decides.
fn parse_size(kind: Kind, size: &str) -> Result<u32, String> {
    let sizes = kind.sizes();
    size.parse()
        .map_err(|_| format!("size of {kind}: {size:?}, expected an integer from {} to {}", sizes.start(), sizes.end()))
}

impl fmt::Display for SceneSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Procedural(Procedural { kind, size, board }) => {
                write!(f, "{kind}:{size}{}", if *board == Board::None { NO_BOARD } else { "" })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_read_as_they_are_written() {
        for (text, kind, size) in [
            ("gears:2", Kind::Gears, 2),
            ("teapot", Kind::Teapot, 12),
            ("balls", Kind::Balls, 4),
            ("tetra:7", Kind::Tetra, 7),
        ] {
            let source: SceneSource = text.parse().expect(text);
            assert_eq!(source, SceneSource::Procedural(Procedural { kind, size, board: Board::Squares }), "{text}");
            assert_eq!(source.to_string().parse(), Ok(source));
        }
        for (text, size) in [("teapot:no-board", 12), ("teapot:3:no-board", 3)] {
            let source: SceneSource = text.parse().expect(text);
            let expected = Procedural { kind: Kind::Teapot, size, board: Board::None };
            assert_eq!(source, SceneSource::Procedural(expected), "{text}");
            assert_eq!((source.name().as_str(), source.to_string().parse()), ("teapot", Ok(source)));
        }
        let file: SceneSource = "scenes/gears.2.nff".parse().expect("a path");
        assert_eq!((file.name().as_str(), file.to_string().as_str()), ("gears.2", "scenes/gears.2.nff"));
    }

    #[test]
    fn what_is_neither_is_refused() {
        const NEITHER: &str = "expected a file ending in .nff or .obj, or gears, teapot, balls, tetra, slivers, plane, \
                               decades, giant or corner, also with a size as in gears:2";
        for (text, reason) in [
            ("", NEITHER),
            ("torus:3", NEITHER),
            ("gears:", "size of gears: \"\", expected an integer from 1 to 41"),
            ("teapot:x", "size of teapot: \"x\", expected an integer from 2 to 778"),
            ("balls:4:4", "size of balls: \"4:4\", expected an integer from 1 to 7"),
            ("gears:2:no-board", "gears has no board, expected teapot"),
            ("teapot:3:board", "size of teapot: \"3:board\", expected an integer from 2 to 778"),
            ("teapot:-1", "size of teapot: \"-1\", expected an integer from 2 to 778"),
            (
                "teapot:0",
                "teapot of size 0: not made, it would be 0 triangles or spheres, expected a size from 2 to 778",
            ),
            (
                "teapot:1",
                "teapot of size 1: not made, it would be 58 triangles or spheres, expected a size from 2 to 778",
            ),
            (
                "teapot:1001",
                "teapot of size 1001: not made, it would be 66124058 triangles or spheres, expected a size from 2 to 778",
            ),
            (
                "balls:8",
                "balls of size 8: not made, it would be 48427563 triangles or spheres, expected a size from 1 to 7",
            ),
        ] {
            assert_eq!(text.parse::<SceneSource>(), Err(reason.to_owned()));
        }
    }
}
