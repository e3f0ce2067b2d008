//! `--set cluster.nodes=9`: a key of the topology file and the value that it gets instead.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

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
            ["scene", "file"] => &["camera", "light", "scene.procedural", "scene.size"],
            ["scene", "procedural"] => &["camera", "light", "scene.file", "scene.size"],
            _ => &[],
        }
    }

    /// Sets the key in `root`, making the tables on the way. Everything set gets the place `span`.
    ///
    /// # Errors
    /// What stands in the way, and what was expected there.
    pub(super) fn apply<'a>(&'a self, root: &mut Spanned<DeValue<'a>>, span: Range<usize>) -> Result<(), String> {
        let mut slot = root;
        for (depth, part) in self.key.iter().enumerate() {
            let key = || self.key[..depth].join(".");
            let kind = slot.get_ref().type_str();
            slot = match slot.get_mut() {
                DeValue::Table(table) => table
                    .entry(Spanned::new(span.clone(), part.as_str().into()))
                    .or_insert_with(|| Spanned::new(span.clone(), DeValue::Table(DeTable::new()))),
                DeValue::Array(array) => {
                    let length = array.len();
                    let element = part.parse().ok().and_then(|index: usize| array.get_mut(index));
                    element
                        .ok_or_else(|| format!("{} has no element {part}, expected a number below {length}", key()))?
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
