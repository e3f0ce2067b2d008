//! What is an object of a database, and how many bytes its records take: what studies of memories vary.
//!
//! None of it changes the image. What is hit is always a triangle, a sphere or a cone, whose numbers are f32.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::records::{Cone, Normals, Sphere, Triangle};
use super::section::Section;
use super::strides::{STRIDE_MAX, Strides};

/// What the octree lists of a polygon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Objects {
    /// Each of its triangles.
    #[default]
    Triangles,
    /// The polygon as a whole, whose record names its triangles.
    Polygons,
}

/// For how many bits the records of coordinates have room.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Numbers {
    /// Those of their values.
    #[default]
    F32,
    /// Twice as many: records are padded to the size that they would have with numbers of 64 bits. Their values stay
    /// f32: it models the size alone.
    F64,
}

/// Objects, numbers and bytes of a database's records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordLayout {
    objects: Objects,
    numbers: Numbers,
    record_bytes: Option<u32>,
}

/// An object's record cannot have so many bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a record of {bytes} bytes, expected a multiple of 4 from {bytes_min} to {STRIDE_MAX}")]
pub struct RecordBytesError {
    bytes: u32,
    bytes_min: u32,
}

impl RecordLayout {
    /// Triangles of f32, nothing padded.
    pub const DEFAULT: Self = Self { objects: Objects::Triangles, numbers: Numbers::F32, record_bytes: None };

    /// The same, of polygons.
    pub const POLYGONS: Self = Self { objects: Objects::Polygons, ..Self::DEFAULT };

    /// `record_bytes`: of an object, a triangle or a polygon; `None`: as many as are needed.
    ///
    /// # Errors
    /// Objects cannot have records of so many bytes.
    pub fn new(objects: Objects, numbers: Numbers, record_bytes: Option<u32>) -> Result<Self, RecordBytesError> {
        let layout = Self { objects, numbers, record_bytes };
        let bytes_min = numbers.record_bytes(objects.section());
        match record_bytes {
            Some(bytes) if !bytes.is_multiple_of(4) || !(bytes_min..=STRIDE_MAX).contains(&bytes) => {
                Err(RecordBytesError { bytes, bytes_min })
            }
            _ => Ok(layout),
        }
    }

    pub fn objects(self) -> Objects {
        self.objects
    }

    pub fn numbers(self) -> Numbers {
        self.numbers
    }

    /// Bytes of an object's record, where they are chosen.
    pub fn record_bytes(self) -> Option<u32> {
        self.record_bytes
    }

    /// Bytes of each section's records.
    pub fn strides(self) -> Strides {
        let chosen = |section| self.record_bytes.filter(|_| section == self.objects.section());
        let bytes = |section| chosen(section).unwrap_or(self.numbers.record_bytes(section));
        // Within what `new` has checked, and else some tens of bytes.
        Strides::new(Section::ALL.map(bytes)).unwrap_or(Strides::CONTENT)
    }
}

impl Objects {
    /// As in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Triangles => "triangles",
            Self::Polygons => "polygons",
        }
    }

    /// The section of their records.
    fn section(self) -> Section {
        match self {
            Self::Triangles => Section::Triangles,
            Self::Polygons => Section::Polygons,
        }
    }
}

impl Numbers {
    /// As in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// Bytes of a section's record with such numbers. Coordinates, radii and the normals and colours of corners are numbers;
    /// indices are not, and materials, of which there are few, stay as they are.
    fn record_bytes(self, section: Section) -> u32 {
        let numbers = match section {
            Section::Triangles => size_of_val(&Triangle::ZERO.coordinates),
            Section::Spheres => size_of::<Sphere>(),
            Section::Cones => size_of::<Cone>(),
            Section::Normals => size_of::<Normals>(),
            _ => 0,
        };
        let wider = if self == Self::F64 { numbers } else { 0 };
        (section.content_bytes() + wider as u64) as u32
    }
}

impl FromStr for Objects {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = [Self::Triangles, Self::Polygons].into_iter().find(|objects| objects.name() == name);
        found.ok_or_else(|| "expected triangles or polygons".to_owned())
    }
}

impl FromStr for Numbers {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = [Self::F32, Self::F64].into_iter().find(|numbers| numbers.name() == name);
        found.ok_or_else(|| "expected f32 or f64".to_owned())
    }
}

/// In words: `records of polygons of 300 bytes, numbers of f64`.
impl fmt::Display for RecordLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "records of {}", self.objects.name())?;
        if let Some(bytes) = self.record_bytes {
            write!(f, " of {bytes} bytes")?;
        }
        write!(f, ", numbers of {}", self.numbers.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_have_room_for_what_was_asked() {
        let strides = |objects, numbers, bytes| {
            let layout = RecordLayout::new(objects, numbers, bytes).expect("possible");
            Section::ALL.map(|section| layout.strides().of(section))
        };
        use {Numbers::*, Objects::*};
        assert_eq!(strides(Triangles, F32, None), [4, 4, 40, 16, 32, 8, 36, 48, 8]);
        // A tag, and nine, four, eight and nine numbers of 8 bytes.
        assert_eq!(strides(Triangles, F64, None), [4, 4, 76, 32, 64, 8, 72, 48, 8]);
        assert_eq!(strides(Triangles, F32, Some(40)), strides(Triangles, F32, None));
        assert_eq!(strides(Triangles, F64, Some(300)), [4, 4, 300, 32, 64, 8, 72, 48, 8]);
        assert_eq!(strides(Polygons, F32, Some(496)), [4, 4, 40, 16, 32, 8, 36, 48, 496]);
        assert_eq!(strides(Polygons, F64, None), [4, 4, 76, 32, 64, 8, 72, 48, 8]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        use {Numbers::*, Objects::*};
        for (objects, numbers, bytes, bytes_min) in [
            (Triangles, F32, 36, 40),
            (Triangles, F32, 42, 40),
            (Triangles, F64, 72, 76),
            (Polygons, F64, 4, 8),
            (Polygons, F32, 500, 8),
            (Polygons, F32, u32::MAX, 8),
        ] {
            let error = RecordLayout::new(objects, numbers, Some(bytes)).expect_err("does not fit");
            assert_eq!(error, RecordBytesError { bytes, bytes_min });
        }
        let error = RecordLayout::new(Triangles, F32, Some(36)).expect_err("does not fit");
        assert_eq!(error.to_string(), "a record of 36 bytes, expected a multiple of 4 from 40 to 496");
    }
}
