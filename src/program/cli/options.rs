//! Options that several commands take, and the values of options.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::Failure;
use cluster::topology::value::{LeafSize, MaxDepth, RecordBytes, Side};
use trace::database::{Numbers, Objects, RecordLayout};
use trace::picture::AovSet;
use trace::tracer::octree::Octree;

/// How a result is printed that is no table.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub(super) enum TextOrJson {
    Text,
    Json,
}

/// What is written besides the image.
#[derive(Clone, Debug, Args)]
pub struct OutputOptions {
    /// Also write these planes of the first hits, as .npy files beside the image
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    aov: Vec<Aov>,
    /// Also write the linear image as OpenEXR
    #[cfg(feature = "exr")]
    #[arg(long)]
    exr: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Aov {
    Depth,
    Normal,
    Primitive,
}

impl OutputOptions {
    pub fn aov(&self) -> AovSet {
        let wanted = |aov| self.aov.contains(&aov);
        AovSet { depth: wanted(Aov::Depth), normal: wanted(Aov::Normal), primitive: wanted(Aov::Primitive) }
    }

    pub fn exr(&self) -> bool {
        #[cfg(feature = "exr")]
        return self.exr;
        #[cfg(not(feature = "exr"))]
        return false;
    }
}

/// How the octree is built.
#[derive(Clone, Debug, Args)]
pub struct OctreeOptions {
    /// A leaf that holds more primitives than this is divided [default: 8, or that of a topology]
    #[arg(long, value_name = "N")]
    leaf_size: Option<LeafSize>,
    /// Deepest octree level; the root is level 0 [default: 12, or that of a topology]
    #[arg(long, value_name = "N")]
    max_depth: Option<MaxDepth>,
}

impl OctreeOptions {
    /// What is not given is as in `others`.
    pub fn octree(&self, others: Octree) -> Octree {
        Octree {
            leaf_size: self.leaf_size.map_or(others.leaf_size, |LeafSize(size)| size),
            max_depth: self.max_depth.map_or(others.max_depth, |MaxDepth(depth)| depth),
            ..others
        }
    }
}

/// How the database's records are laid out.
#[derive(Clone, Debug, Args)]
pub struct RecordOptions {
    /// What the octree lists of a polygon: each of its triangles, or the polygon as a whole [default: triangles]
    #[arg(long, value_name = "triangles|polygons")]
    records: Option<Objects>,
    /// For which numbers the records of triangles, spheres, cones and normals have room [default: f32]
    #[arg(long, value_name = "f32|f64")]
    numbers: Option<Numbers>,
    /// Bytes of a triangle's record, or of a polygon's with --records polygons [default: as many as it needs]
    #[arg(long, value_name = "N")]
    record_bytes: Option<RecordBytes>,
}

impl RecordOptions {
    /// # Errors
    /// The records cannot have so many bytes.
    pub fn layout(&self) -> Result<RecordLayout, Failure> {
        let bytes = self.record_bytes.map(|RecordBytes(bytes)| bytes);
        RecordLayout::new(self.records.unwrap_or_default(), self.numbers.unwrap_or_default(), bytes)
            .map_err(|error| Failure::bad_input(format!("--record-bytes: {error}")))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    On,
    Off,
}

/// Width and height of an image, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSize {
    pub width: u32,
    pub height: u32,
}

impl FromStr for ImageSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        let (Side(width), Side(height)) =
            sides.ok_or("expected WIDTHxHEIGHT in pixels such as 640x480, each from 1 to 65536")?;
        Ok(Self { width, height })
    }
}

/// The name of an image file.
pub fn png_path(text: &str) -> Result<PathBuf, String> {
    let path = Path::new(text);
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        Ok(path.to_owned())
    } else {
        Err("expected a name ending in .png".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Options {
        #[command(flatten)]
        output: OutputOptions,
        #[command(flatten)]
        octree: OctreeOptions,
    }

    #[test]
    fn planes_are_those_that_were_named() {
        let aov = |arguments: &[&str]| {
            let line = ["x"].into_iter().chain(arguments.iter().copied());
            Options::try_parse_from(line).expect("parses").output.aov()
        };
        assert!(aov(&[]).is_empty());
        assert_eq!(aov(&["--aov", "normal,depth"]), AovSet { depth: true, normal: true, primitive: false });
        assert_eq!(aov(&["--aov=primitive", "--aov=depth"]), AovSet { depth: true, normal: false, primitive: true });
    }

    #[test]
    fn the_octree_is_the_topologys_default_unless_told() {
        let octree = |arguments: &[&str]| {
            let line = ["x"].into_iter().chain(arguments.iter().copied());
            Options::try_parse_from(line).expect("parses").octree.octree(Octree::DEFAULT)
        };
        assert_eq!(octree(&[]), Octree::DEFAULT);
        assert_eq!(octree(&["--leaf-size", "3"]), Octree { leaf_size: 3, ..Octree::DEFAULT });
    }

    #[test]
    fn sizes_are_two_sides() {
        assert_eq!("640x480".parse(), Ok(ImageSize { width: 640, height: 480 }));
        for text in ["", "x", "640", "640x", "640x480x3", "640X480", "0x1", "1x65537", "-1x1", "6.4x1"] {
            assert!(text.parse::<ImageSize>().is_err(), "{text}");
        }
    }
}
