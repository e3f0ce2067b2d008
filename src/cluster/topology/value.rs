//! The values of a topology file: each type reads what its key accepts and refuses all else, saying what
//! would have been accepted. The command line takes the same values in its options.

use std::fmt;
use std::str::FromStr;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use machine::hardware::specification::{BYTES_MAX, MemorySize};
use trace::database::records::Polygon;
use trace::database::strides::STRIDE_MAX;
use trace::picture::ImageSettings;
use trace::scene::procedural::SIZE_MAX;

/// The schema of a value, written where the value is used.
macro_rules! inline_schema {
    ($name:ident, |$generator:pat_param| $schema:expr) => {
        impl JsonSchema for $name {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema($generator: &mut SchemaGenerator) -> Schema {
                $schema
            }
        }
    };
}
pub(super) use inline_schema;

/// Which numbers a key accepts, both ends included.
#[derive(Clone, Copy)]
struct Range {
    kind: Kind,
    min: f64,
    max: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Integer,
    PowerOfTwo,
    Number,
}

impl Range {
    const fn integer(min: f64, max: f64) -> Self {
        Self { kind: Kind::Integer, min, max }
    }

    const fn number(min: f64, max: f64) -> Self {
        Self { kind: Kind::Number, min, max }
    }

    /// NaN is in no range.
    fn contains(self, value: f64) -> bool {
        let regular = self.kind != Kind::PowerOfTwo || (value as u64).is_power_of_two();
        self.min <= value && value <= self.max && regular
    }

    fn parse(self, text: &str) -> Result<f64, String> {
        let number = match self.kind {
            Kind::Number => text.parse().ok(),
            Kind::Integer | Kind::PowerOfTwo => text.parse::<i64>().ok().map(|integer| integer as f64),
        };
        number.filter(|&number| self.contains(number)).ok_or_else(|| format!("expected {self}"))
    }

    fn schema(self) -> Schema {
        let (min, max) = (self.min, self.max);
        match self.kind {
            Kind::Integer => json_schema!({ "type": "integer", "minimum": min as u64, "maximum": max as u64 }),
            Kind::PowerOfTwo => {
                let powers = std::iter::successors(Some(min as u64), |power| Some(power * 2));
                let powers: Vec<u64> = powers.take_while(|&power| power <= max as u64).collect();
                json_schema!({ "type": "integer", "enum": powers })
            }
            Kind::Number => json_schema!({ "type": "number", "minimum": min, "maximum": max }),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            Kind::Integer => "an integer",
            Kind::PowerOfTwo => "a power of two",
            Kind::Number => "a number",
        };
        if self.min == self.max {
            write!(f, "{}", self.min)
        } else if self.kind == Kind::Number && self.max >= 1e9 {
            write!(f, "{kind} from {:e} to {:e}", self.min, self.max)
        } else {
            write!(f, "{kind} from {} to {}", self.min, self.max)
        }
    }
}

impl Visitor<'_> for Range {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<f64, E> {
        let number = value as f64;
        if self.contains(number) { Ok(number) } else { Err(E::invalid_value(Unexpected::Signed(value), &self)) }
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<f64, E> {
        if self.kind == Kind::Number && self.contains(value) {
            Ok(value)
        } else {
            Err(E::invalid_value(Unexpected::Float(value), &self))
        }
    }
}

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident($type:ty), $range:expr) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Serialize)]
        pub struct $name(pub $type);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let range: Range = $range;
                // The range lies within the type's own.
                deserializer.deserialize_any(range).map(|number| Self(number as $type))
            }
        }

        /// For command lines.
        impl FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                let range: Range = $range;
                range.parse(text).map(|number| Self(number as $type))
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }

        inline_schema!($name, |_| {
            let range: Range = $range;
            range.schema()
        });
    };
}

quantity!(
    /// Version of the file's format.
    Version(u32),
    Range::integer(1.0, 1.0)
);
quantity!(
    /// Size factor of a procedural scene; each kind narrows it further.
    ProceduralSize(u32),
    Range::integer(1.0, SIZE_MAX as f64)
);
quantity!(
    /// World units.
    Coordinate(f64),
    Range::number(-1e12, 1e12)
);
quantity!(
    /// One channel of a linear RGB colour.
    Channel(f64),
    Range::number(0.0, 1e6)
);
quantity!(
    /// Full vertical field of view, degrees.
    Angle(f64),
    Range::number(0.001, 179.9)
);
quantity!(
    /// Pixels along one side.
    Side(u32),
    Range::integer(1.0, ImageSettings::SIDE_MAX as f64)
);
quantity!(
    /// How many reflections or refractions a ray's ancestry may hold.
    Depth(u32),
    Range::integer(0.0, ImageSettings::DEPTH_MAX as f64)
);
quantity!(
    /// Weight in the pixel that a secondary ray must exceed.
    Cutoff(f32),
    Range::number(0.0, 1.0)
);
quantity!(
    /// Primitives a leaf may hold before it is divided.
    LeafSize(u32),
    Range::integer(1.0, 1024.0)
);
quantity!(
    /// Deepest octree level.
    MaxDepth(u32),
    Range::integer(0.0, 20.0)
);
quantity!(
    /// Bytes of an object's record: a polygon's content at least; a triangle's is more.
    RecordBytes(u32),
    Range::integer(size_of::<Polygon>() as f64, STRIDE_MAX as f64)
);
quantity!(
    /// Processing nodes of a cluster.
    Nodes(u16),
    Range::integer(1.0, 256.0)
);
quantity!(
    /// Threads of a processing node.
    Threads(u16),
    Range::integer(1.0, 256.0)
);
quantity!(
    /// Clusters, each with a bus, a master and nodes of its own.
    Clusters(u16),
    Range::integer(1.0, 64.0)
);
quantity!(
    /// A cluster.
    ClusterNumber(u16),
    Range::integer(0.0, 63.0)
);
quantity!(
    /// Processing nodes of a host, of all clusters.
    HostNodes(u16),
    Range::integer(0.0, 16_384.0)
);
quantity!(
    /// A TCP port; 0: any that is free.
    Port(u16),
    Range::integer(0.0, 65_535.0)
);
quantity!(
    /// Share of the tiles that is rendered twice.
    Verify(f64),
    Range::number(0.0, 1.0)
);
quantity!(
    /// Bytes of a line.
    Line(u32),
    Range { kind: Kind::PowerOfTwo, min: 16.0, max: 256.0 }
);
quantity!(
    /// Lines of a set.
    Ways(u32),
    Range::integer(1.0, 1_048_576.0)
);
quantity!(
    /// Transactions a node may be granted in a row.
    Quantum(u32),
    Range::integer(1.0, 1024.0)
);
quantity!(
    /// What something costs.
    Cycles(u32),
    Range::integer(0.0, 1e6)
);
quantity!(
    /// Bytes of a bus word.
    Width(u32),
    Range { kind: Kind::PowerOfTwo, min: 1.0, max: 64.0 }
);
quantity!(
    /// In which a word crosses the bus.
    CyclesPerWord(u32),
    Range::integer(1.0, 1024.0)
);
quantity!(
    /// The largest is 2^53 - 1, which every reader of TOML and JSON takes exactly.
    Seed(u64),
    Range::integer(0.0, 9_007_199_254_740_991.0)
);
quantity!(
    /// A deadline.
    Seconds(f64),
    Range::number(0.1, 86_400.0)
);

#[expect(clippy::derivable_impls, reason = "the macro derives for all quantities alike, and few have a default")]
impl Default for Port {
    fn default() -> Self {
        Self(0)
    }
}

impl Port {
    pub(super) fn is_any(&self) -> bool {
        self.0 == 0
    }
}

/// Width and height of a tile, pixels: one number for a square, or `[width, height]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tile(pub u32, pub u32);

impl<'de> Deserialize<'de> for Tile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TileVisitor)
    }
}

struct TileVisitor;

impl<'de> Visitor<'de> for TileVisitor {
    type Value = Tile;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an integer or [width, height], each from 1 to {}", ImageSettings::SIDE_MAX)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Tile, E> {
        match u32::try_from(value) {
            Ok(side @ 1..=ImageSettings::SIDE_MAX) => Ok(Tile(side, side)),
            _ => Err(E::invalid_value(Unexpected::Signed(value), &self)),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sides: A) -> Result<Tile, A::Error> {
        let missing = |length: usize| de::Error::invalid_length(length, &self);
        let Side(width) = sides.next_element()?.ok_or_else(|| missing(0))?;
        let Side(height) = sides.next_element()?.ok_or_else(|| missing(1))?;
        match sides.next_element::<de::IgnoredAny>()? {
            None => Ok(Tile(width, height)),
            Some(_) => Err(missing(3)),
        }
    }
}

impl Serialize for Tile {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        [self.0, self.1].serialize(serializer)
    }
}

inline_schema!(Tile, |generator| {
    let side = Side::json_schema(generator);
    json_schema!({ "oneOf": [side, { "type": "array", "items": side, "minItems": 2, "maxItems": 2 }] })
});

/// Size of a local memory: [`MemorySize`] as a person writes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size(pub MemorySize);

impl<'de> Deserialize<'de> for Size {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SizeVisitor).map(Self)
    }
}

struct SizeVisitor;

impl Visitor<'_> for SizeVisitor {
    type Value = MemorySize;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(MemorySize::ACCEPTED)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<MemorySize, E> {
        match u64::try_from(value) {
            Ok(bytes @ 1..=BYTES_MAX) => Ok(MemorySize::Bytes(bytes)),
            _ => Err(E::invalid_value(Unexpected::Signed(value), &self)),
        }
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<MemorySize, E> {
        value.parse().map_err(|_| E::invalid_value(Unexpected::Str(value), &self))
    }
}

impl Serialize for Size {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0)
    }
}

inline_schema!(Size, |_| {
    let written = r"^(all|[0-9]+ */ *[0-9]+|[0-9]+(\.[0-9]+)? *(B|KiB|MiB|GiB|TiB)?)$";
    json_schema!({ "oneOf": [
        { "type": "string", "pattern": written },
        { "type": "integer", "minimum": 1, "maximum": BYTES_MAX },
    ] })
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_have_the_ranges_of_the_keys() {
        assert_eq!("256".parse(), Ok(Nodes(256)));
        assert_eq!("0.25".parse(), Ok(Cutoff(0.25)));
        assert_eq!("0".parse::<Nodes>(), Err("expected an integer from 1 to 256".to_owned()));
        assert_eq!("2.0".parse::<Nodes>(), Err("expected an integer from 1 to 256".to_owned()));
        assert_eq!("48".parse::<Line>(), Err("expected a power of two from 16 to 256".to_owned()));
        for text in ["", "x", "nan", "inf", "-0.1", "1e999"] {
            assert_eq!(text.parse::<Cutoff>(), Err("expected a number from 0 to 1".to_owned()));
        }
    }

    #[test]
    fn the_largest_seed_is_exact() {
        assert_eq!("9007199254740991".parse(), Ok(Seed((1 << 53) - 1)));
        assert!("9007199254740992".parse::<Seed>().is_err());
        assert!("9007199254740993".parse::<Seed>().is_err());
    }
}
